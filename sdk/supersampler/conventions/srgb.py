"""The sRGB curve and its inverse (IEC 61966-2-1), extended above 1 and mirrored below 0."""

import numpy as np

from supersampler.frame import Array, Float32


def srgb_decoded(values: Array) -> Float32:
    """Decode sRGB values of any shape to linear."""
    encoded = values.astype(np.float32, copy=False)
    size = np.abs(encoded)
    curve = ((size + np.float32(0.055)) / np.float32(1.055)) ** np.float32(2.4)
    return np.copysign(np.where(size <= 0.04045, size / np.float32(12.92), curve), encoded)


def srgb_encoded(values: Array) -> Float32:
    """Encode linear values of any shape as sRGB."""
    linear = values.astype(np.float32, copy=False)
    size = np.abs(linear)
    curve = np.float32(1.055) * size ** np.float32(1 / 2.4) - np.float32(0.055)
    return np.copysign(np.where(size <= 0.0031308, size * np.float32(12.92), curve), linear)
