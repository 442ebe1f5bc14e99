"""Detect buffers of few, evenly spaced values: stored in eight bits, or in half floats around an offset."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from supersampler.frame import Array, Size
from supersampler.validation.evidence import PLACES, grid

_FEWEST, _MOST = 6, 300  # distinct values of such a buffer
_PLACES_EACH = 8  # minimum mean number of places with one value
_UNEVEN = 0.1  # of a step
_MIN_UNEVEN = 0.02  # fraction of places where the change from pixel to pixel changes by a step
_COARSE_MOTION = 0.2  # render pixels


def even_values(values: NDArray[np.floating[Any]]) -> tuple[int, float]:
    """Return the number of distinct values and their spacing; (0, 0.0) if they are many or uneven."""
    distinct = np.unique(values[np.isfinite(values)].astype(np.float64))
    if not _FEWEST <= len(distinct) <= min(_MOST, len(values) // _PLACES_EACH):
        return 0, 0.0
    extent = distinct[-1] - distinct[0]
    step = extent / max(1.0, np.rint(extent / np.diff(distinct).min()))
    position = (distinct - distinct[0]) / step
    even = bool((np.abs(position - np.rint(position)) < _UNEVEN).all()) and position[-1] <= 4 * _MOST
    return (len(distinct), float(step)) if even else (0, 0.0)


def depth_values(depth: Array) -> int:
    """Return how many evenly spaced values depth, or 1 / depth, has; 0 where it is finer."""
    rows, columns = grid((max(0, depth.shape[1] - 2), depth.shape[0]), PLACES)
    line = np.stack([depth[rows, columns + x] for x in range(3)]).astype(np.float64)
    line = line[:, ((line > 0.0) & (line < 1e6)).all(axis=0)]  # no sky
    for values in (line, 1.0 / line):
        count, step = even_values(values[1])
        # Those of a plane are even, too, but change by the same from pixel to pixel; rounded ones do not.
        bend = np.abs(np.diff(values, 2, axis=0)) / max(step, 1e-30)
        if count and np.mean((bend > 0.5) & (bend < 2.5)) > _MIN_UNEVEN:
            return count
    return 0


def motion_step(motion: Array, size: Size) -> float:
    """Return the spacing in pixels of motion in few values, the larger of x and y; 0.0 if it is finer."""
    vectors = motion[grid(size, PLACES)].astype(np.float64)
    step = max(even_values(vectors[:, axis])[1] for axis in (0, 1))
    return step if step >= _COARSE_MOTION else 0.0
