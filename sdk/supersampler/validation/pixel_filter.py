"""Check for a wide pixel filter: mixed colours at edges of depth."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from supersampler.frame import Array, Float32

_MIN_EDGES = 60  # minimum number of edges to judge by: of 31, point samples had 65 % mixed ones by chance
_MIN_CONTRAST = 0.15  # of tone-mapped luminance
_FLAT = 0.04  # of the contrast: change on either side of an edge
_MIXED = 0.12  # of the contrast: a pixel that is neither of the sides
_DEPTH_RATIO, _SAME_SURFACE = 1.1, 1.03  # of depths across an edge, and along a side


def mixed_edges(light: Float32, depth: Array) -> float:
    """Return the fraction of edges with a pixel between their two sides; 0.0 with too few edges to judge.

    Depth is sampled at a point. A pixel on one side of an edge of depth has the colour of that side,
    unless colour is filtered. Edges count where the colour of each side is even over 2x3 pixels, so that
    textures, noise and soft shadows do not.
    """
    values = np.maximum(light, 0)
    known = values[np.isfinite(values) & (values > 0)]
    middle = np.float32(np.median(known) if known.size else 1.0)
    with np.errstate(invalid="ignore"):  # Inf / Inf is NaN, which compares False
        tone = np.divide(values, values + middle, dtype=np.float32)
    sharp = mixed = 0
    for tones, depths in ((tone, depth), (tone.T, depth.T)):
        first, second = _profiles(tones, depths)
        at_first, at_second = np.abs(first) < _MIXED, np.abs(second - 1) < _MIXED
        sharp += int((at_first & at_second).sum())
        mixed += int((at_second & (first >= _MIXED) & (first < 0.7)).sum())
        mixed += int((at_first & (second <= 1 - _MIXED) & (second > 0.3)).sum())
    return mixed / (sharp + mixed) if sharp + mixed >= _MIN_EDGES else 0.0


def _profiles(tone: Float32, depth: Array) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return the two pixels at each edge along rows, from 0 (colour of one side) to 1 (of the other)."""
    height, width = tone.shape[0] - 2, tone.shape[1] - 5
    if height < 1 or width < 1:
        return np.empty(0), np.empty(0)
    z = [depth[1:-1, i : i + width] for i in range(6)]
    edge = ~_near(z[2], z[3], _DEPTH_RATIO)
    for a, b in ((0, 1), (1, 2), (3, 4), (4, 5)):
        edge &= _near(z[a], z[b], _SAME_SURFACE)
    rows, columns = np.nonzero(edge)
    around = np.stack([[tone[rows + y, columns + x] for x in range(6)] for y in range(3)])  # (3, 6, n)
    line = around[1]
    contrast = line[5] - line[0]
    allowed = _FLAT * np.abs(contrast)
    even = np.abs(contrast) > _MIN_CONTRAST
    even &= (np.abs(line[1] - line[0]) < allowed) & (np.abs(line[5] - line[4]) < allowed)
    sides = [0, 1, 4, 5]
    even &= (np.abs(around[:, sides] - line[sides]) < 2 * allowed).all(axis=(0, 1))
    line, contrast = line[:, even], contrast[even]
    return (line[2] - line[0]) / contrast, (line[3] - line[0]) / contrast


def _near(a: Array, b: Array, ratio: float) -> NDArray[np.bool_]:
    with np.errstate(invalid="ignore"):
        near: NDArray[np.bool_] = np.maximum(a, b) <= ratio * np.minimum(a, b)
    return near
