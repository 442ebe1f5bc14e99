"""Render one sequence of a set, frame by frame; a stopped run resumes after the last complete frame."""

from collections.abc import Callable

import numpy as np

from supersampler import halton_jitter
from supersampler_model.data.dataset.description import Dataset, SequenceEntry
from supersampler_model.data.dataset.frame_file import (
    Rerendered,
    TrainingFrame,
    write_rerendered,
    write_training_frame,
)
from supersampler_model.data.errors import DatasetError
from supersampler_model.data.rendered import Rendered, labels_of
from supersampler_model.data.renderer.renderer import Renderer
from supersampler_model.data.sequences import Sequence, make_sequence

MAX_DIFFERENCE = 0.01
"""Of the mean of two images of one frame by different drivers, relative."""


def render_sequence(
    dataset: Dataset,
    entry: SequenceEntry,
    renderer: Renderer,
    *,
    on_frame: Callable[[], None] = lambda: None,
) -> None:
    """Render the missing frames of `entry`.

    For a set at one ratio (`Dataset.at`), write the second renderings beside the existing frames.

    Args:
        dataset: the data set.
        entry: the sequence.
        renderer: of the set's display size and samples.
        on_frame: called after each written frame.

    Raises:
        OSError: writing failed; all earlier frames are complete.
        DatasetError: the scenes have changed since the existing frames were rendered.
    """
    first = dataset.complete(entry)
    if first == entry.spec.frames:
        return
    if dataset.own is not None:
        _rerender(dataset, entry, renderer, on_frame)
        return
    sequence = make_sequence(entry.spec)
    before = _rendered(dataset, entry, sequence, renderer, max(first - 1, 0))
    for index in range(first, entry.spec.frames):
        rendered = before if index == 0 else _rendered(dataset, entry, sequence, renderer, index)
        labels = labels_of(rendered, before)
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
            gbuffer_display=rendered.display.gbuffer(depth=True) if dataset.description.gbuffers else None,
        )
        write_training_frame(dataset.path(entry, index), frame)
        before = rendered
        on_frame()


def _rerender(
    dataset: Dataset, entry: SequenceEntry, renderer: Renderer, on_frame: Callable[[], None]
) -> None:
    """Render the sequence a second time at the ratio of `entry`, from the first missing frame on."""
    sequence, size = make_sequence(entry.spec), entry.render_size(dataset.description.display_size)
    _check_same_images(dataset, entry, sequence, renderer)
    for index in range(dataset.complete(entry), entry.spec.frames):
        jitter = halton_jitter(index, entry.ratio)
        color, surfaces = renderer.frame(sequence.scene(index), size, jitter=jitter)
        motion = surfaces.motion.astype(np.float16)
        path = dataset.rerendered_path(entry, index)
        assert path is not None  # noqa: S101 - checked by the caller
        write_rerendered(path, Rerendered(color, surfaces.depth, motion, jitter, surfaces.gbuffer()))
        on_frame()


def _check_same_images(
    dataset: Dataset, entry: SequenceEntry, sequence: Sequence, renderer: Renderer
) -> None:
    """Raise a DatasetError where the existing references show other images than are rendered now."""
    assert dataset.own is not None  # noqa: S101 - checked by the caller
    own = next(e for e in dataset.own.entries() if e.folder == entry.folder)
    size = own.render_size(dataset.description.display_size)
    there = dataset.own.read(own, 0).color.astype(np.float32)
    now, _ = renderer.frame(sequence.scene(0), size, jitter=halton_jitter(0, own.ratio))
    if float(np.abs(now - there).mean()) > MAX_DIFFERENCE * float(there.mean()):
        hint = "Render a new set: the scenes or the renderer have changed since this one was rendered."
        raise DatasetError(dataset.path(own, 0), "shows something else than is rendered now", hint)


def _rendered(
    dataset: Dataset, entry: SequenceEntry, sequence: Sequence, renderer: Renderer, index: int
) -> Rendered:
    return renderer.render(
        sequence.scene(index),
        entry.render_size(dataset.description.display_size),
        jitter=halton_jitter(index, entry.ratio),
        reset=sequence.cut(index),
    )
