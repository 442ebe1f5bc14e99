"""Evidence for the kind of a depth buffer: planes, the sky's value, and disocclusions."""

from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from supersampler.frame import Array
from supersampler.validation.evidence import Places

DepthOrder = Literal["reversed", "forward", "linear"]
ORDERS: tuple[DepthOrder, ...] = ("reversed", "forward", "linear")

_SKY = {"reversed": 0.0, "forward": 1.0}
_SKY_DISTANCE = 1e6  # from here on linear depth is sky
_DISTANCE_RATIO = 1.1  # of distances that separates two surfaces; one that approaches changes less in a frame
_MIN_PLACES = 100  # minimum number of places for a median
_CROP_SIDE = 400  # side in pixels of the square in the middle that `bend` reads
_ROUNDING = 1e-6  # relative rounding error of float32 depth


def inverse_distance(depth: Array, order: DepthOrder) -> NDArray[np.float64]:
    """Return 1 / distance up to a factor and, for a finite far plane, an offset; NaN at the sky."""
    values = depth.astype(np.float64)
    with np.errstate(divide="ignore", invalid="ignore"):
        if order == "linear":
            inverse = np.where(values < _SKY_DISTANCE, 1 / values, np.nan)
        else:
            inverse = values if order == "reversed" else 1 - values
        return np.where((inverse > 0) & np.isfinite(inverse), inverse, np.nan)


def bend(depth: Array, order: DepthOrder) -> float:
    """Return how curved 1 / distance is in screen space: it is linear along a plane.

    The median second difference divided by the first, beyond rounding errors, in the middle of the image; NaN
    where no neighbours differ.
    """
    height, width = depth.shape
    top, left = max(0, height // 2 - _CROP_SIDE // 2), max(0, width // 2 - _CROP_SIDE // 2)
    inverse = inverse_distance(depth[top : top + _CROP_SIDE, left : left + _CROP_SIDE], order)
    scale = np.ones_like(inverse) if order == "forward" else inverse
    parts = []
    for axis in (0, 1):
        first = np.diff(inverse, axis=axis)
        before, after = (np.delete(first, end, axis=axis) for end in (-1, 0))
        slope = np.abs(before) + np.abs(after)
        rounding = _ROUNDING * np.take(scale, range(1, scale.shape[axis] - 1), axis=axis)
        excess = np.abs(after - before) - rounding
        known = slope > 20 * rounding  # False where NaN
        parts.append(np.maximum(excess[known], 0) / slope[known])
    values = np.concatenate(parts)
    return float(np.median(values)) if values.size else float("nan")


def sky_share(depth: Array, order: DepthOrder) -> float:
    """Return the fraction of pixels with the sky's value in this order."""
    if order == "linear":
        return float(np.mean(depth >= _SKY_DISTANCE))
    return float(np.mean(depth == _SKY[order]))


def disoccluded(
    now: Array, before: Array, order: DepthOrder, places: Places, offset: NDArray[np.floating[Any]]
) -> tuple[int, int]:
    """Count disoccluded places whose occluder in the previous frame is (closer, farther) than themselves.

    With the right depth order, occluders are closer.

    Args:
        now: (h, w) depth.
        before: (h, w) depth of the previous frame.
        order: order of both.
        places: rows and columns (n,) of this frame.
        offset: (n, 2) pixels from each place to its place in the previous frame.
    """
    height, width = now.shape
    rows, columns = places
    inside = np.isfinite(offset).all(axis=1)
    offset = np.where(inside[:, None], offset, 0)
    previous_rows = np.rint(rows + offset[:, 1]).astype(np.intp)
    previous_columns = np.rint(columns + offset[:, 0]).astype(np.intp)
    inside &= (previous_rows >= 0) & (previous_rows < height)
    inside &= (previous_columns >= 0) & (previous_columns < width)
    lowest, highest = _range(now, order, rows, columns)
    previous_lowest, previous_highest = _range(before, order, previous_rows, previous_columns)
    ratio = lowest[inside] / previous_lowest[inside]
    if np.isfinite(ratio).sum() >= _MIN_PLACES:  # a camera that moves ahead brings everything closer
        scale = np.nanmedian(ratio)
        previous_lowest, previous_highest = scale * previous_lowest, scale * previous_highest
    with np.errstate(invalid="ignore"):
        closer = inside & (previous_lowest > _DISTANCE_RATIO * highest)
        farther = inside & (lowest > _DISTANCE_RATIO * previous_highest)
    return int(closer.sum()), int(farther.sum())


def _range(
    depth: Array, order: DepthOrder, rows: NDArray[np.intp], columns: NDArray[np.intp]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the minimum and maximum 1 / distance of each place's 3 x 3 pixels; NaN with sky in them."""
    height, width = depth.shape
    near = [
        depth[np.clip(rows + dy, 0, height - 1), np.clip(columns + dx, 0, width - 1)]
        for dy in (-1, 0, 1)
        for dx in (-1, 0, 1)
    ]
    inverse = inverse_distance(np.stack(near), order)
    return inverse.min(axis=0), inverse.max(axis=0)
