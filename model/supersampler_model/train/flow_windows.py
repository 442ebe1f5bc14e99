"""Crops of frames at render size, of which some are hidden: drawn from those before, and then compared.

A hidden frame's truth is the colour that it would have been shaded with, sample by sample, so that nothing of
display size is looked at.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch

from supersampler.errors import ArgumentError
from supersampler_model.data.dataset import Dataset, TrainingFrame
from supersampler_model.data.dataset.description import SequenceEntry
from supersampler_model.data.labels import Ghost
from supersampler_model.train.gbuffer_windows import GBufferCut, draw_gbuffer_cut
from supersampler_model.train.hidden_windows import HiddenStream
from supersampler_model.train.windows import Sample


@dataclass(frozen=True, eq=False)
class FlowCut(GBufferCut):
    """A cut of a frame as it was rendered: corner and size are in render pixels."""

    def sample(self, frame: TrainingFrame, *, reset: bool) -> Sample:
        """Cut the crop out of one frame, with its own colour as reference."""
        return super().sample(at_render_size(frame), reset=reset)

    def worth(self, frame: TrainingFrame) -> int:
        """How many pixels there are on which light changes."""
        return int((at_render_size(frame).ghost[self.display] == Ghost.SHADING).sum())


def at_render_size(frame: TrainingFrame) -> TrainingFrame:
    """Return the frame with all that is of display size as it is at its samples."""
    axes = zip(frame.depth.shape[::-1], frame.ghost.shape[::-1], frame.jitter, strict=True)
    places = [((np.arange(few) + 0.5 + moved) * many / few, many) for few, many, moved in axes]
    columns, rows = (at.astype(np.int64).clip(0, many - 1) for at, many in places)
    here = np.ix_(rows, columns)
    ghost, alias = frame.ghost[here], frame.alias[here]
    return replace(frame, reference=frame.color, ghost=ghost, alias=alias, gbuffer_display=None)


class FlowStream(HiddenStream):
    """Windows of which what is hidden has a truth, and nothing else."""

    def __iter__(self) -> Iterator[Sample]:
        for sample in super().__iter__():
            if sample.hidden:
                yield sample
            else:
                yield sample._replace(reference=torch.full_like(sample.reference, torch.nan))


def draw_flow_cut(
    random: np.random.Generator, entry: SequenceEntry, display_size: tuple[int, int], size: int
) -> FlowCut:
    """Draw a crop of a sequence's frames as they were rendered, turned and coloured at random."""
    cut = draw_gbuffer_cut(random, replace(entry, ratio=1.0), entry.render_size(display_size), size)
    return FlowCut(**vars(cut))


def flow_stream(datasets: Sequence[Dataset], *, ratio: int, size: int, seed: Sequence[int]) -> FlowStream:
    """Crops of sets that `gbuffer_set` returned; see `Stream`.

    Raises:
        ArgumentError: as `Stream`, and where a crop is larger than what was rendered.
    """
    smallest = min(min(dataset.description.display_size) // ratio for dataset in datasets)
    if size > smallest:
        raise ArgumentError("size", got=size, want=f"at most {smallest}, the smaller side of a frame")
    return FlowStream(datasets, ratios=(ratio, ratio), size=size, seed=seed, draw=draw_flow_cut)
