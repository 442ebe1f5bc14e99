"""Predicted against true classes of a shot's pixels: counts and overlaps."""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from supersampler.frame import Float32
from supersampler.io.shot import ClassMaps
from supersampler_bench.quality.metrics import crop

Counts = NDArray[np.int64]
"""(2, 3, 3): pixels by group, true class and predicted class."""

GROUPS: Mapping[str, tuple[str, str, str]] = {
    "ghosting": ("none", "visibility", "shading"),
    "aliasing": ("none", "geometry", "texture"),
}
"""The classes of each group, in the order of `StepResult.class_map` and by the numbers of `ClassMaps`."""


def count(class_map: Float32, truth: ClassMaps, border: int = 0) -> Counts:
    """Count display pixels, without `border`; the prediction is the likeliest class of each block of 2x2.

    So a class that is finer than 2x2 pixels is never matched in full.

    Args:
        class_map: (H / 2, W / 2, 6), sizes rounded up, see `StepResult.class_map`.
        truth: of (H, W) pixels.
        border: display pixels.
    """
    counts = np.zeros((2, 3, 3), np.int64)
    for group, labels in enumerate((truth.ghost, truth.alias)):
        coarse = class_map[..., 3 * group : 3 * group + 3].argmax(axis=-1)
        height, width = labels.shape
        predicted = coarse.repeat(2, axis=0).repeat(2, axis=1)[:height, :width]
        true = crop(labels, border).astype(np.intp)
        cells = np.bincount((3 * true + crop(predicted, border)).ravel(), minlength=9)
        counts[group] = cells.reshape(3, 3)
    return counts


def overlap(matrix: Counts) -> NDArray[np.float64]:
    """Intersection over union of each class, (3, 3) to (3,); NaN of one neither present nor predicted."""
    together = np.diagonal(matrix).astype(np.float64)
    either = matrix.sum(axis=0) + matrix.sum(axis=1) - together
    return np.asarray(np.divide(together, either, out=np.full(3, np.nan), where=either > 0))


def shares(matrix: Counts) -> NDArray[np.float64]:
    """Share of each true class's pixels by predicted class, (3, 3); NaN of a class without pixels."""
    there = matrix.sum(axis=1, keepdims=True)
    return np.asarray(np.divide(matrix, there, out=np.full((3, 3), np.nan), where=there > 0))
