"""Encode an image as the RGBA bytes that OpenGL takes."""

import numpy as np
from numpy.typing import NDArray

from supersampler.backends.cpu.library import Image, cpu_library, readable
from supersampler.frame import Float32


def encode_rgba(image: Float32, pixels: NDArray[np.int32]) -> None:
    """Write an image (h, w, 3) to opaque pixels (h, w), bottom row first; values are clamped to [0, 1]."""
    height, width = pixels.shape
    source, row = readable(image), pixels.strides[0]
    last = pixels.ctypes.data + (height - 1) * row
    cpu_library().call("ss_encode_rgba", Image.of(source), width, height, last, -row)
