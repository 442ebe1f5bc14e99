"""Which pixels hold a part of a thin object: from the depths of their samples."""

from collections.abc import Sequence

import numpy as np

from supersampler.frame import Float32
from supersampler_model.data.labels.rules import Mask, plane_slope
from supersampler_model.data.labels.statistics import PixelStatistics

_REACH = 2  # pixels from the corner of a surface, of 90 degrees or more, to its nearest solid square, at most
_CLOSER = 0.01  # fraction of the closer reversed depth, as T_D^A of equation 7


def thin(pixels: PixelStatistics) -> Mask:
    """Return where a pixel holds a part of an object less than about two pixels wide, (H, W).

    Two display pixels are one render pixel at a ratio of 2. A surface is solid in squares of 2x2 pixels in
    which all samples hit it. At any angle, a bar wider than four pixels has solid squares, and a bar narrower
    than two has none. A pixel is thin where its closest sample is in front of all solid squares within
    `_REACH` pixels: by more than 1 %, and by more than the slope of a plane explains, as in the other labels.
    """
    solid = -_largest(-pixels.depth_min, (0, 1))  # of the square whose first pixel this is
    nearest = _largest(solid, range(-_REACH - 1, _REACH + 1))
    reach = range(-_REACH, _REACH + 1)
    slope = (_REACH + 2) * _largest(plane_slope(pixels), reach)  # to the far side of the square
    return np.asarray(pixels.depth_max - nearest - slope > _CLOSER * pixels.depth_max)


def _largest(values: Float32, offsets: Sequence[int]) -> Float32:
    """Return the largest value at these offsets from each pixel, along both axes; borders are repeated."""
    for axis in (0, 1):
        places = np.arange(values.shape[axis])
        shifted = (np.take(values, places + offset, axis, mode="clip") for offset in offsets)
        values = np.maximum.reduce(list(shifted))
    return values
