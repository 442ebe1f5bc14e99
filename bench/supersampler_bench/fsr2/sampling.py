"""Texture reads. Positions are texels: the centre of the first one is 0.5. Reads beyond the edge clamp."""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from supersampler.frame import Array, Size
from supersampler_bench.fsr2.buffers import EPSILON, lerp

Indices = NDArray[np.int64]


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
