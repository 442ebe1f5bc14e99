"""What a training set looks like: a contact sheet, and its class maps as pictures."""

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from supersampler.io.display import display_transform, to_uint8
from supersampler.io.images import write_png
from supersampler_model.data.class_map import overlay, with_legend
from supersampler_model.data.dataset.description import Dataset, SequenceEntry
from supersampler_model.data.labels import Labels

Picture = NDArray[np.uint8]
_ACROSS, _WIDTH = 6, 240  # pictures a row, pixels each at most


def write_sheet(dataset: Dataset, folder: Path) -> None:
    """Write the class map of the middle frame of each sequence that has one, with a legend."""
    for entry in dataset.entries():
        complete = dataset.complete(entry)
        if complete:
            frame = dataset.read(entry, complete // 2)
            labels = Labels(ghost=np.array(frame.ghost), alias=np.array(frame.alias))
            picture = overlay(labels, _shown(frame.reference, frame.exposure))
            name = f"{entry.spec.family}-{entry.spec.seed}.png"
            write_png(folder / name, with_legend(picture, labels))


def contact_sheet(dataset: Dataset) -> Picture:
    """(h, w, 3) sRGB: the middle frame of each sequence, as far as it is rendered, row by row."""
    pictures = [_small(dataset, entry) for entry in dataset.entries() if dataset.complete(entry)]
    if not pictures:
        return np.zeros((1, 1, 3), np.uint8)
    height, width = pictures[0].shape[:2]
    rows = -(-len(pictures) // _ACROSS)
    sheet = np.zeros((rows * height, min(len(pictures), _ACROSS) * width, 3), np.uint8)
    for index, picture in enumerate(pictures):
        y, x = index // _ACROSS * height, index % _ACROSS * width
        sheet[y : y + height, x : x + width] = picture
    return sheet


def _small(dataset: Dataset, entry: SequenceEntry) -> Picture:
    frame = dataset.read(entry, dataset.complete(entry) // 2)
    step = -(-frame.reference.shape[1] // _WIDTH)
    height, width = (n // step * step for n in frame.reference.shape[:2])
    blocks = np.asarray(frame.reference[:height, :width], np.float32)
    mean = blocks.reshape(height // step, step, width // step, step, 3).mean(axis=(1, 3))
    return _shown(mean, frame.exposure)


def _shown(color: NDArray[Any], exposure: float) -> Picture:
    return to_uint8(display_transform(color, exposure))
