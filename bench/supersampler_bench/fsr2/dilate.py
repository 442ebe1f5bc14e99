"""Pass 2, reconstruct and dilate: depth and motion of the nearest neighbour, and the depth that the previous
frame had where these pixels were.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from supersampler.frame import Array
from supersampler_bench.fsr2.buffers import View
from supersampler_bench.fsr2.sampling import centres, shifted

BILINEAR_THRESHOLD = 0.01
"""fReconstructedDepthBilinearWeightThreshold: texels of a smaller bilinear weight count as untouched."""
_STILL = 0.1  # display pixels; less motion counts as none
_ORDER = ((1, 0), (0, 1), (0, -1), (-1, 0), (-1, 1), (1, 1), (-1, -1), (1, -1))


class Dilated(NamedTuple):
    """Results of the pass, at render size.

    Attributes:
        depth: (h, w), of the closest of 3x3.
        motion: (h, w, 2), of the same pixel.
        previous: (h, w) depth of the previous frame, from this frame's; 0 where nothing came from.
    """

    depth: Array
    motion: Array
    previous: Array


def dilate(depth: Array, motion: Array, view: View) -> Dilated:
    """Run the pass on a frame's depth and motion."""
    near_depth, near_motion = depth, motion
    for dx, dy in _ORDER:
        other = shifted(depth, dx, dy)
        closer = other > near_depth
        near_depth = np.where(closer, other, near_depth)
        near_motion = np.where(closer[..., None], shifted(motion, dx, dy), near_motion)
    return Dilated(near_depth, near_motion, _reconstructed(near_depth, near_motion, view))


class Texel(NamedTuple):
    """One of the four texels around each reprojected pixel: row, column, weight, and whether it counts."""

    row: NDArray[np.int64]
    column: NDArray[np.int64]
    weight: Array
    counts: NDArray[np.bool_]


def texels_around(motion: Array, view: View) -> list[Texel]:
    """Return the texels of the previous frame around each pixel plus its motion; indices are clamped."""
    width, height = view.render
    x, y = (centre + motion[..., axis] - np.float32(0.5) for axis, centre in enumerate(centres(view.render)))
    left, top = np.floor(x), np.floor(y)
    found = []
    for dx, dy in ((0, 0), (1, 0), (0, 1), (1, 1)):
        weight = (1.0 - np.abs(left + dx - x)) * (1.0 - np.abs(top + dy - y))
        on_screen = (left + dx >= 0) & (left + dx < width) & (top + dy >= 0) & (top + dy < height)
        row = np.clip(top + dy, 0, height - 1).astype(np.int64)
        column = np.clip(left + dx, 0, width - 1).astype(np.int64)
        found.append(Texel(row, column, weight, on_screen & (weight > BILINEAR_THRESHOLD)))
    return found


def moving(motion: Array, view: View, least: float) -> Array:
    """Return motion, 0 where it is not above `least` display pixels."""
    return motion * (view.speed(motion) > least)[..., None]


def _reconstructed(depth: Array, motion: Array, view: View) -> Array:
    previous = np.zeros_like(depth)
    for texel in texels_around(moving(motion, view, _STILL), view):
        counts = texel.counts
        np.maximum.at(previous, (texel.row[counts], texel.column[counts]), depth[counts])
    return previous
