"""Sizes that follow from that of the display, and nearest resampling between them."""

import numpy as np

from supersampler.frame import Float32, Size


def half_size(size: Size) -> Size:
    """Return half of a (width, height), rounded up."""
    return (size[0] + 1) // 2, (size[1] + 1) // 2


def large_size(display: Size) -> Size:
    """Return 1.4 times a display's (width, height), rounded up."""
    return (7 * display[0] + 4) // 5, (7 * display[1] + 4) // 5


def resized(planes: Float32, size: Size) -> Float32:
    """Return the nearest pixels of planes (1, c, h, w) at another (width, height)."""
    if planes.shape[:1:-1] == tuple(size):
        return planes
    rows, columns = (
        (np.arange(extent) * 2 + 1) * own // (2 * extent)
        for extent, own in zip(size[::-1], planes.shape[2:], strict=True)
    )
    return np.ascontiguousarray(planes[:, :, rows[:, None], columns])
