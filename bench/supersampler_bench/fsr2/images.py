"""Images of `fsr2-like`: sizes of a frame, colour spaces, texture reads. Arrays of floats are float32.

Positions of texture reads are texels: the centre of the first one is 0.5. Reads beyond the edge clamp.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from supersampler.errors import FrameError
from supersampler.frame import Array, Frame, Size
from supersampler.io.display import BT709, MAX_HALF

Indices = NDArray[np.int64]
EPSILON = 1e-3
"""FSR2_EPSILON."""
_TONEMAP_EPSILON = 1.0 / MAX_HALF
_TO_YCOCG = np.array([[0.25, 0.5, 0.25], [0.5, 0.0, -0.5], [-0.25, 0.5, -0.25]], np.float32)
_FROM_YCOCG = np.array([[1.0, 1.0, -1.0], [1.0, 0.0, 1.0], [1.0, -1.0, -1.0]], np.float32)


@dataclass(frozen=True)
class FrameSizes:
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


class FrameBuffers(NamedTuple):
    """Buffers of a frame at render size, of finite numbers.

    Attributes:
        color: (h, w, 3) linear RGB in [0, 65504].
        depth: (h, w) reversed, infinite far plane, >= 0.
        motion: (h, w, 2) render pixels, previous minus current.
    """

    color: Array
    depth: Array
    motion: Array


def buffers_of(frame: Frame) -> FrameBuffers:
    """Return a frame's buffers; NaN counts as 0, as in HLSL's max(0, NaN).

    Raises:
        FrameError: the frame has no colour.
    """
    if frame.color is None:
        raise FrameError("color", got=None, want="a shaded frame")
    return FrameBuffers(
        _finite(frame.color, 0.0, MAX_HALF),
        _finite(frame.depth, 0.0, float(np.finfo(np.float32).max)),
        _finite(frame.motion, -MAX_HALF, MAX_HALF),
    )


def _finite(array: Array, low: float, high: float) -> Array:
    return np.clip(np.nan_to_num(array.astype(np.float32), nan=0.0), np.float32(low), np.float32(high))


def length(vectors: Array) -> Array:
    """Return the lengths (...) of vectors (..., n)."""
    return np.asarray(np.sqrt((vectors * vectors).sum(axis=-1)))


def lerp(a: Array | float, b: Array | float, t: Array | float) -> Array:
    """Return a where t is 0, b where it is 1."""
    return np.asarray(a + (b - a) * t)


def saturate(values: Array) -> Array:
    """Clamp to [0, 1]."""
    return np.clip(values, np.float32(0.0), np.float32(1.0))


def prepared(rgb: Array, exposure: float) -> Array:
    """Return exposed linear RGB in [0, 65504] of scene-linear RGB."""
    return np.asarray(np.clip(rgb * np.float32(exposure), 0.0, MAX_HALF))


def to_ycocg(rgb: Array) -> Array:
    """Convert RGB to YCoCg."""
    return np.asarray(rgb @ _TO_YCOCG.T)


def from_ycocg(ycocg: Array) -> Array:
    """Convert YCoCg to RGB."""
    return np.asarray(ycocg @ _FROM_YCOCG.T)


def luma(rgb: Array) -> Array:
    """Return the BT.709 luminance (...)."""
    return np.asarray(rgb @ BT709)


def perceived_luma(rgb: Array) -> Array:
    """Return CIE lightness / 100 (...) of linear RGB."""
    y = luma(rgb)
    lightness = np.where(y <= 216.0 / 24389.0, y * (24389.0 / 27.0), np.cbrt(y) * 116.0 - 16.0)
    return lightness.astype(np.float32) * np.float32(0.01)


def tonemap(rgb: Array) -> Array:
    """Divide by 1 + the largest component, or by 1 where all are negative."""
    return np.asarray(rgb / (np.maximum(rgb.max(axis=-1, keepdims=True), 0.0) + 1.0))


def inverse_tonemap(rgb: Array) -> Array:
    """Undo `tonemap`."""
    return np.asarray(rgb / np.maximum(1.0 - rgb.max(axis=-1, keepdims=True), _TONEMAP_EPSILON))


def centres(size: Size) -> tuple[Array, Array]:
    """Return the pixel centres x (1, w) and y (h, 1) of an image of (w, h)."""
    x, y = (np.arange(side, dtype=np.float32) + np.float32(0.5) for side in size)
    return x[None], y[:, None]


def shifted(image: Array, dx: int, dy: int) -> Array:
    """Return the image whose pixel (x, y) is that of (x + dx, y + dy)."""
    h, w = image.shape[:2]
    rows, columns = np.clip(np.arange(h) + dy, 0, h - 1), np.clip(np.arange(w) + dx, 0, w - 1)
    return image[rows][:, columns]


def neighbours(image: Array) -> Iterator[tuple[tuple[int, int], Array]]:
    """Yield ((dx, dy), shifted image) of the 3x3 neighbourhood, row by row."""
    for dy in (-1, 0, 1):
        for dx in (-1, 0, 1):
            yield (dx, dy), shifted(image, dx, dy)


def bilinear(image: Array, x: Array, y: Array) -> Array:
    """Sample (h, w, c) at positions that broadcast to (H, W); returns (H, W, c)."""
    (left, right), fx = _footprint(x, image.shape[1], 1)
    (top, bottom), fy = _footprint(y, image.shape[0], 1)
    above = lerp(image[top, left], image[top, right], fx)
    below = lerp(image[bottom, left], image[bottom, right], fx)
    return lerp(above, below, fy)


def lanczos(image: Array, x: Array, y: Array) -> Array:
    """Sample as `bilinear`, by 4x4 texels of Lanczos2, clamped to the range of the central 2x2."""
    columns, fx = _footprint(x, image.shape[1], 2)
    rows, fy = _footprint(y, image.shape[0], 2)
    texels = [[image[row, column] for column in columns] for row in rows]
    sampled = _weighted([_weighted(line, fx) for line in texels], fy)
    inner = [texels[i][j] for i in (1, 2) for j in (1, 2)]
    return np.clip(sampled, np.minimum.reduce(inner), np.maximum.reduce(inner))


def lanczos2_of_square(squared: Array) -> Array:
    """Return FSR1's approximation of Lanczos2 of a distance, given its square; 0 from 2 on."""
    x2 = np.minimum(squared, np.float32(4.0))
    a, b = 2.0 / 5.0 * x2 - 1.0, 1.0 / 4.0 * x2 - 1.0
    return (25.0 / 16.0 * a * a - (25.0 / 16.0 - 1.0)) * (b * b)


def _lanczos2(x: Array) -> Array:
    inside = np.minimum(np.abs(x), np.float32(2.0))
    found = np.sinc(inside) * np.sinc(inside / 2.0)
    return np.where(inside < EPSILON, np.float32(1.0), found).astype(np.float32)


def _footprint(position: Array, side: int, reach: int) -> tuple[list[Indices], Array]:
    """Return the indices of the 2 reach texels around positions, and the distance from the inner left one."""
    first = np.floor(position - np.float32(0.5))
    fraction = (position - np.float32(0.5) - first)[..., None]
    offsets = range(1 - reach, reach + 1)
    return [np.clip(first.astype(np.int64) + k, 0, side - 1) for k in offsets], fraction


def _weighted(texels: list[Array], fraction: Array) -> Array:
    weights = [_lanczos2(offset - fraction) for offset in (-1.0, 0.0, 1.0, 2.0)]
    total = sum(w * texel for w, texel in zip(weights, texels, strict=True))
    return np.asarray(total / np.sum(weights, axis=0), np.float32)
