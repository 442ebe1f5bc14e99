"""Render one sequence of a set, frame by frame; a run that is stopped goes on after the last whole frame."""

from collections.abc import Callable

import numpy as np

from supersampler import halton_jitter
from supersampler_model.data.dataset.description import Dataset, SequenceEntry
from supersampler_model.data.dataset.frame_file import TrainingFrame, write_training_frame
from supersampler_model.data.gl.renderer import Renderer
from supersampler_model.data.labels import LabelThresholds, label
from supersampler_model.data.rendered import Rendered
from supersampler_model.data.sequences import Sequence, make_sequence


def render_sequence(
    dataset: Dataset,
    entry: SequenceEntry,
    renderer: Renderer,
    *,
    thresholds: LabelThresholds | None = None,
    on_frame: Callable[[], None] = lambda: None,
) -> None:
    """Render the frames of `entry` that are not there yet.

    Args:
        dataset: where they go.
        entry: which sequence.
        renderer: of the set's display size and samples.
        thresholds: of the labels.
        on_frame: called after each frame that was written.

    Raises:
        OSError: the disk refused; all frames before are whole.
    """
    first = dataset.complete(entry)
    if first == entry.spec.frames:
        return
    sequence = make_sequence(entry.spec)
    before = _rendered(dataset, entry, sequence, renderer, max(first - 1, 0))  # by an earlier run, if at all
    for index in range(first, entry.spec.frames):
        rendered = before if index == 0 else _rendered(dataset, entry, sequence, renderer, index)
        exposure = rendered.exposure  # of both: a change of exposure is no change of light
        evidence = rendered.evidence(exposure), before.evidence(exposure)
        labels = label(*evidence, thresholds or LabelThresholds())
        frame = TrainingFrame(
            color=rendered.color,
            depth=rendered.render.depth,
            motion=rendered.render.motion.astype(np.float16),
            jitter=rendered.jitter,
            reset=rendered.reset,
            exposure=rendered.exposure,
            reference=rendered.reference.color.astype(np.float16),
            ghost=labels.ghost,
            alias=labels.alias,
            gbuffer_display=_gbuffers(rendered) if dataset.description.gbuffers else None,
        )
        write_training_frame(dataset.path(entry, index), frame)
        before = rendered
        on_frame()


def _rendered(
    dataset: Dataset, entry: SequenceEntry, sequence: Sequence, renderer: Renderer, index: int
) -> Rendered:
    return renderer.render(
        sequence.scene(index),
        entry.render_size(dataset.description.display_size),
        jitter=halton_jitter(index, entry.ratio),
        reset=sequence.cut(index),
    )


def _gbuffers(rendered: Rendered) -> dict[str, "np.ndarray[tuple[int, ...], np.dtype[np.floating]]"]:
    return {**rendered.display.gbuffer(), "depth": rendered.display.depth}
