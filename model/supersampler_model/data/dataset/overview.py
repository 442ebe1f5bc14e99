"""Overviews of a training set: class maps, and the rows of `supersampler info DATASET`.

Class maps show the colours of `supersampler.aux_outputs` over an image.
"""

from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from supersampler.aux_outputs import class_colors
from supersampler.io.display import BT709_WEIGHTS, display_transform, to_uint8
from supersampler.io.images import write_png
from supersampler.io.shot import ClassMaps
from supersampler_model.data.dataset.storage import Dataset, SequenceEntry, Split, open_dataset
from supersampler_model.data.labels import Alias, Ghost
from supersampler_model.data.specs import SHOT

Image = NDArray[np.uint8]

OPACITY = 0.6
_SPLITS: tuple[Split, ...] = ("train", "validation", "test")


def overlay(labels: ClassMaps, image: NDArray[Any]) -> Image:
    """Return the colours of the classes over a grey tone-mapped image, both (H, W, 3) uint8 sRGB."""
    grey = np.repeat((image.astype(np.float32) @ np.array(BT709_WEIGHTS))[..., None], 3, axis=-1)
    one = np.eye(3, dtype=np.float32)
    colors = class_colors(np.concatenate([one[labels.ghost], one[labels.alias]], axis=-1))
    has_class = (labels.ghost != Ghost.NONE) | (labels.alias != Alias.NONE)
    tinted = grey + OPACITY * has_class[..., None] * (colors - grey)
    return np.asarray(np.clip(np.rint(tinted), 0, 255), np.uint8)


def write_class_maps(dataset: Dataset, folder: Path) -> None:
    """Write the class map of the middle frame of each sequence that has one."""
    for entry in dataset.entries():
        complete = dataset.complete(entry)
        if complete:
            frame = dataset.read(entry, complete // 2)
            image = overlay(
                ClassMaps(frame.ghost, frame.alias),
                to_uint8(display_transform(frame.reference, frame.exposure)),
            )
            write_png(folder / f"{entry.spec.family}-{entry.spec.seed}.png", image)


def rows(folder: Path) -> dict[str, str]:
    """Return the text of each row by name.

    Raises:
        DatasetError: the folder is not a training set, or a frame is damaged.
    """
    dataset = open_dataset(folder)
    width, height = dataset.description.display_size
    ratios = Counter(entry.ratio for entry in dataset.entries())
    families = Counter(entry.spec.family for entry in dataset.entries())
    samples = "" if SHOT in families else f", {dataset.description.samples} samples a pixel"
    return {
        "training set": str(folder),
        "display size": f"{width}x{height}{samples}",
        "sequences": "\n".join(_counts(dataset)),
        "ratios": ", ".join(f"{ratio:g} in {count}" for ratio, count in sorted(ratios.items())),
        "families": ", ".join(f"{family} {count}" for family, count in sorted(families.items())),
        "classes": "\n".join(_classes(dataset)),
    }


def _counts(dataset: Dataset) -> Iterator[str]:
    for split in _SPLITS:
        if entries := dataset.entries(split):
            complete, total = sum(map(dataset.complete, entries)), sum(e.spec.frames for e in entries)
            yield f"{split}: {len(entries)} sequences, {complete} of {total} frames"


def _classes(dataset: Dataset) -> Iterator[str]:
    """Yield a line for each split, and one for each of its families."""
    for split in _SPLITS:
        entries = [entry for entry in dataset.entries(split) if dataset.complete(entry)]
        if entries:
            yield f"{split}: {_percentages(dataset, entries)}"
            for family in sorted({entry.spec.family for entry in entries}):
                of_family = [entry for entry in entries if entry.spec.family == family]
                yield f"  {family}: {_percentages(dataset, of_family)}"
        elif dataset.entries(split):
            yield f"{split}: nothing rendered"


def _percentages(dataset: Dataset, entries: list[SequenceEntry]) -> str:
    found = frequencies(dataset, entries)
    if np.isnan([*found.values()]).any():
        return "not known"
    return ", ".join(f"{name} {fraction:.2%}" for name, fraction in found.items())


def frequencies(dataset: Dataset, entries: Sequence[SequenceEntry]) -> dict[str, float]:
    """Return the fraction of each class over the pixels of known classes; NaN without such pixels.

    First frames after cuts are skipped: all of their pixels are disoccluded.
    """
    counts, pixels = dict.fromkeys(("visibility", "shading", "geometry", "texture"), 0), 0
    for frame in (frame for entry in entries for frame in dataset.frames(entry) if not frame.reset):
        pixels += int((frame.ghost <= max(Ghost)).sum())
        masks = (classes == value for classes in (frame.ghost, frame.alias) for value in (1, 2))
        for name, mask in zip(counts, masks, strict=True):
            counts[name] += int(mask.sum())
    return {name: count / pixels if pixels else float("nan") for name, count in counts.items()}
