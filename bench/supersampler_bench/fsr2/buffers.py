"""What the passes share: sizes and jitter of a frame, sanitized inputs, linear interpolation.

All arrays of floats in this package are float32.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from supersampler.errors import FrameError
from supersampler.frame import Array, Frame, Size
from supersampler.io.display import MAX_HALF

EPSILON = 1e-3
"""FSR2_EPSILON."""


@dataclass(frozen=True)
class View:
    """Sizes and jitter of a frame.

    Attributes:
        render: (width, height).
        display: (width, height).
        jitter: (x, y) render pixels; samples were taken at pixel centre + jitter. FSR2 has the other sign.
    """

    render: Size
    display: Size
    jitter: tuple[float, float]

    @property
    def upscale(self) -> Array:
        """Display size / render size, (x, y)."""
        return np.divide(self.display, self.render, dtype=np.float32)

    def of_image(self, motion: Array) -> Array:
        """Return motion (..., 2), in render pixels, as fractions of the image's size: FSR2's unit."""
        return np.divide(motion, self.render, dtype=np.float32)

    def speed(self, motion: Array) -> Array:
        """Return the length (...) in display pixels of motion (..., 2) in render pixels."""
        return length(motion * self.upscale)


class Inputs(NamedTuple):
    """Buffers of a frame at render size, of finite numbers.

    Attributes:
        color: (h, w, 3) linear RGB in [0, 65504].
        depth: (h, w) reversed, infinite far plane, >= 0.
        motion: (h, w, 2) render pixels, previous minus current.
    """

    color: Array
    depth: Array
    motion: Array


def inputs_of(frame: Frame) -> Inputs:
    """Return a frame's buffers; NaN counts as 0, as in HLSL's max(0, NaN).

    Raises:
        FrameError: the frame has no colour.
    """
    if frame.color is None:
        raise FrameError("color", got=None, want="a shaded frame")
    return Inputs(
        _finite(frame.color, 0.0, MAX_HALF),
        _finite(frame.depth, 0.0, float(np.finfo(np.float32).max)),
        _finite(frame.motion, -MAX_HALF, MAX_HALF),
    )


def _finite(array: Array, least: float, most: float) -> Array:
    return np.clip(np.nan_to_num(array.astype(np.float32), nan=0.0), np.float32(least), np.float32(most))


def length(vectors: Array) -> Array:
    """Return the lengths (...) of vectors (..., n)."""
    return np.asarray(np.sqrt((vectors * vectors).sum(axis=-1)))


def lerp(a: Array | float, b: Array | float, t: Array | float) -> Array:
    """Return a where t is 0, b where it is 1."""
    return np.asarray(a + (b - a) * t)


def saturate(values: Array) -> Array:
    """Clamp to [0, 1]."""
    return np.clip(values, np.float32(0.0), np.float32(1.0))
