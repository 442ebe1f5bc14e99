"""Crops at any ratio of which some frames are to be drawn, with the G-buffers of render size that takes."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from supersampler.errors import ArgumentError
from supersampler.methods.gbuffers import GBUFFERS
from supersampler_model.data.dataset import Dataset, TrainingFrame
from supersampler_model.data.dataset.description import SequenceEntry
from supersampler_model.training.crops import Sample, Stream, draw_region
from supersampler_model.training.gbuffer_crops import GBufferRegion, draw_rotation

TWO = 0.25
"""Share of the crops of which two frames are hidden after each shaded one; of the others one is."""


class RenderGBufferRegion(GBufferRegion):
    """A cut with G-buffers of render size, of the samples that its colour has."""

    def sample(self, frame: TrainingFrame, *, reset: bool) -> Sample:
        """Cut the crop out of one frame."""
        across, down = self._seen(frame)
        found = self._surfaces(frame, across, down)
        gbuffer = {name: buffer for name, buffer in found.items() if not GBUFFERS[name].of_display}
        return self._part(frame, across, down, reset=reset)._replace(gbuffer=gbuffer)


class UnshadedStream(Stream):
    """Crops of which every second frame is hidden, of some two of three, of those without G-buffers none."""

    def __iter__(self) -> Iterator[Sample]:
        for sample in super().__iter__():
            random = np.random.default_rng([*self._seed, self.place.window, 0, 1])
            hidden = 2 if random.random() < TWO else 1
            number = self.place.frame - 1  # this frame is counted already
            hides = number % (hidden + 1) > 0 and bool(sample.gbuffer) and not sample.reset
            yield sample._replace(hidden=hides)


def draw_render_region(
    random: np.random.Generator, entry: SequenceEntry, display_size: tuple[int, int], size: int
) -> RenderGBufferRegion:
    """Draw a crop of a sequence: turned and coloured at random, and its world turned."""
    return RenderGBufferRegion(
        **vars(draw_region(random, entry, display_size, size)), world=draw_rotation(random)
    )


def unshaded_set(dataset: Dataset, ratios: tuple[float, float]) -> Dataset:
    """Return a set with all sequences at each ratio within `ratios` that they are drawn again at.

    Raises:
        ArgumentError: at none, so that no frame has G-buffers of render size.
    """
    slack, entries = 0.02, dataset.entries()
    found = [r for r in _ratios_drawn(dataset) if ratios[0] - slack <= r <= ratios[1] + slack]
    if not found:
        want = "a set made by `supersampler render --gbuffers --also 2`"
        got = f"{dataset.folder}, without G-buffers of render size at a ratio from {ratios[0]} to {ratios[1]}"
        raise ArgumentError("data", got=got, want=want)
    sequences = tuple(replace(entry, ratio=ratio) for ratio in found for entry in entries)
    return Dataset(dataset.folder, replace(dataset.description, sequences=sequences), own=dataset)


def _ratios_drawn(dataset: Dataset) -> list[float]:
    """Ratios that any sequence's first frame is drawn again at."""
    there = set()
    for entry in dataset.entries():
        first = dataset.path(entry, 0)
        for path in first.parent.glob(f"{first.stem}.*x{first.suffix}"):
            there.add(float(path.name.removeprefix(f"{first.stem}.").removesuffix(f"x{first.suffix}")))
    return sorted(there)
