"""The sRGB curve (IEC 61966-2-1), extended beyond 1 and mirrored below 0, so that it has an inverse."""

import numpy as np

from supersampler.frame import Array, Float32


def srgb_decoded(values: Array) -> Float32:
    """Return linear values of sRGB-encoded ones, any shape."""
    encoded = values.astype(np.float32, copy=False)
    size = np.abs(encoded)
    curve = ((size + np.float32(0.055)) / np.float32(1.055)) ** np.float32(2.4)
    return np.copysign(np.where(size <= 0.04045, size / np.float32(12.92), curve), encoded)


def srgb_encoded(values: Array) -> Float32:
    """Return sRGB-encoded values of linear ones, any shape."""
    linear = values.astype(np.float32, copy=False)
    size = np.abs(linear)
    curve = np.float32(1.055) * size ** np.float32(1 / 2.4) - np.float32(0.055)
    return np.copysign(np.where(size <= 0.0031308, size * np.float32(12.92), curve), linear)
