"""Converts a user's shots into a training set; they have references, but usually no class labels."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from supersampler.errors import ShotError
from supersampler.io.display import auto_exposure
from supersampler.io.shot import Shot, ShotFrame
from supersampler_model.data.dataset import Dataset, TrainingFrame, create_dataset
from supersampler_model.data.dataset.description import Description, SequenceEntry, Split
from supersampler_model.data.dataset.frame_file import write_training_frame
from supersampler_model.data.specs import SequenceSpec

UNKNOWN = 255
"""Value of unknown classes."""
FAMILY = "shot"


def dataset_of_shots(shots: Sequence[Shot], folder: Path, split: Split) -> Dataset:
    """Copy shots to a training set for fast reads of crops; existing frames are kept.

    Frames without a reference stay, as history; their references are NaN.

    Args:
        shots: of one display size, each with some references.
        folder: of the data set.
        split: its split.

    Raises:
        ShotError: a shot has no reference, or another display size than the first.
        OSError: writing failed.
    """
    size = shots[0].display_size
    for shot in shots:
        if not shot.reference_indices or shot.display_size is None or size is None:
            hint = "Render some frames with many samples a pixel at display size and list them in shot.json."
            raise ShotError(shot.path, "no frame has a reference to learn from", hint)
        if shot.display_size != size:
            raise ShotError(shot.path, f"references are {shot.display_size}, those of the others {size}")
    assert size is not None  # noqa: S101 - the loop has seen to it
    entries = tuple(
        SequenceEntry(
            spec=SequenceSpec(
                family=FAMILY, seed=index, frames=len(shot), frame_rate=shot.frame_rate or 30.0
            ),
            ratio=size[0] / shot.render_size[0],
            split=split,
        )
        for index, shot in enumerate(shots)
    )
    description = Description(display_size=size, samples=1, gbuffers=False, seed=0, sequences=entries)
    dataset = create_dataset(folder, description)
    for shot, entry in zip(shots, entries, strict=True):
        for item in shot.frames(dataset.complete(entry)):
            write_training_frame(dataset.path(entry, item.index), _training_frame(shot, item))
    return dataset


def _training_frame(shot: Shot, item: ShotFrame) -> TrainingFrame:
    frame = item.frame
    if frame.color is None:
        raise ShotError(shot.path, f"frame {item.index} has no colour to learn from")
    assert shot.display_size is not None  # noqa: S101 - checked by the caller
    shape = shot.display_size[::-1]
    classes = shot.read_classes(item.index)
    unknown = np.full(shape, UNKNOWN, np.uint8)
    truth = np.full((*shape, 3), np.nan, np.float16) if item.reference is None else item.reference
    return TrainingFrame(
        color=frame.color.astype(np.float16),
        depth=frame.depth,
        motion=frame.motion.astype(np.float16),
        jitter=frame.jitter,
        reset=frame.reset,
        exposure=frame.exposure or auto_exposure(frame.color),
        reference=truth.astype(np.float16),
        ghost=unknown if classes is None else classes.ghost,
        alias=unknown if classes is None else classes.alias,
    )
