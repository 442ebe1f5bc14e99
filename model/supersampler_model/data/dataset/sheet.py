"""Overviews of a training set: a contact sheet, and class maps."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from supersampler.io.display import display_transform, to_uint8
from supersampler.io.images import write_png
from supersampler_model.data.class_map import overlay, with_legend
from supersampler_model.data.dataset.description import Dataset, SequenceEntry
from supersampler_model.data.labels import Labels

Image = NDArray[np.uint8]
_ACROSS, _WIDTH = 6, 240  # images per row, maximum width of each


def write_sheet(dataset: Dataset, folder: Path) -> None:
    """Write the class map of the middle frame of each sequence that has one, with a legend."""
    for entry in dataset.entries():
        complete = dataset.complete(entry)
        if complete:
            frame = dataset.read(entry, complete // 2)
            labels = Labels(ghost=np.array(frame.ghost), alias=np.array(frame.alias))
            image = overlay(labels, _displayed(frame.reference, frame.exposure))
            name = f"{entry.spec.family}-{entry.spec.seed}.png"
            write_png(folder / name, with_legend(image, labels))


def contact_sheet(dataset: Dataset) -> Image:
    """(h, w, 3) sRGB: the middle frame of each sequence, row by row."""
    images = [_small(dataset, entry) for entry in dataset.entries() if dataset.complete(entry)]
    if not images:
        return np.zeros((1, 1, 3), np.uint8)
    height, width = images[0].shape[:2]
    rows = -(-len(images) // _ACROSS)
    sheet = np.zeros((rows * height, min(len(images), _ACROSS) * width, 3), np.uint8)
    for index, image in enumerate(images):
        y, x = index // _ACROSS * height, index % _ACROSS * width
        sheet[y : y + height, x : x + width] = image
    return sheet


def _small(dataset: Dataset, entry: SequenceEntry) -> Image:
    frame = dataset.read(entry, dataset.complete(entry) // 2)
    step = -(-frame.reference.shape[1] // _WIDTH)
    height, width = (n // step * step for n in frame.reference.shape[:2])
    blocks = np.asarray(frame.reference[:height, :width], np.float32)
    mean = blocks.reshape(height // step, step, width // step, step, 3).mean(axis=(1, 3))
    return _displayed(mean, frame.exposure)


def _displayed(color: NDArray[Any], exposure: float) -> Image:
    return to_uint8(display_transform(color, exposure))
