"""Check of `Frame.motion_next` against the next frame's motion, which leads back."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from supersampler.validation.evidence import PLACES, Evidence, grid
from supersampler.validation.mistakes import MOTION_NEXT_MISREAD, Mistake

READINGS: Mapping[tuple[int, int], str] = {
    (1, 1): "",
    (-1, -1): "current minus next",
    (1, -1): "y flipped",
    (-1, 1): "current minus next, y flipped",
}
"""Factors of x and y, and how a reading is called."""
_SAME_SURFACE = 0.05  # relative difference of depth
_MOVES = 0.5  # pixels: shorter vectors say nothing about their sign
_LEAST = 200  # number of places
_PIXELS, _SHARE = 0.25, 0.25  # difference, of the median vector, that is a mistake


def motion_next_mistakes(before: Evidence, now: Evidence) -> list[Mistake]:
    """Return the mistake in the motion to the next frame of `before`, if it does not lead to `now`.

    A place that moves leads to one of the same surface in the next frame, from which that frame's motion
    leads back: their sum is 0, but for accelerations of what is not rigid.
    """
    if before.motion_next is None or now.reset or now.size != before.size:
        return []
    differences = _differences(before, now)
    own = differences.get((1, 1))
    if own is None:
        return []
    difference, length = own
    if difference <= max(_PIXELS, _SHARE * length):
        return []
    best = min(differences, key=lambda reading: differences[reading][0])
    fits = differences[best][0] <= max(_PIXELS, _SHARE * differences[best][1])
    text = f"; it fits if it is {READINGS[best]}" if fits and READINGS[best] else ""
    return [MOTION_NEXT_MISREAD.found(difference=difference, length=length, reading=text)]


def _differences(before: Evidence, now: Evidence) -> dict[tuple[int, int], tuple[float, float]]:
    """Return, for each reading, the median difference, and length of the vectors, pixels."""
    rows, columns = grid(before.size, PLACES)
    stated = np.asarray(before.motion_next)[rows, columns].astype(np.float64)
    there = -now.motion[rows, columns].astype(np.float64)  # where things go, nearly, if `stated` is wrong
    moves = np.isfinite(stated).all(1) & np.isfinite(there).all(1)
    moves &= np.maximum(np.abs(stated).max(1), np.abs(there).max(1)) > _MOVES
    found = {}
    for reading in READINGS:
        vectors = stated[moves] * reading
        difference, length = _difference(before, now, rows[moves], columns[moves], vectors)
        if len(difference) >= min(_LEAST, len(rows) // 20):
            found[reading] = float(np.median(difference)), float(np.median(length))
    return found


def _difference(
    before: Evidence, now: Evidence, rows: NDArray[Any], columns: NDArray[Any], vectors: NDArray[Any]
) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return lengths of vector + the motion where it leads, and of the longer of both."""
    shift = np.subtract(before.jitter, now.jitter)
    x = np.rint(columns + vectors[:, 0] + shift[0])
    y = np.rint(rows + vectors[:, 1] + shift[1])
    inside = (x >= 0) & (x < now.size[0]) & (y >= 0) & (y < now.size[1])
    row, column = y[inside].astype(np.intp), x[inside].astype(np.intp)
    here, there = before.depth[rows[inside], columns[inside]], now.depth[row, column]
    same = np.abs(here - there) <= _SAME_SURFACE * np.maximum(here, there)
    back, vectors = now.motion[row, column][same].astype(np.float64), vectors[inside][same]
    difference = np.hypot(*(vectors + back).T)
    return difference, np.maximum(np.hypot(*vectors.T), np.hypot(*back.T))
