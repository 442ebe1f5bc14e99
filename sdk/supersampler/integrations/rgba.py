"""Encode an image as the RGBA bytes that OpenGL takes."""

from typing import NamedTuple

import numpy as np

from supersampler.backends.cpu.kernel_loader import kernel_if_possible
from supersampler.backends.cpu.structs import Floats, Words, pack
from supersampler.frame import Float32


class EncodedImage(NamedTuple):
    """An image and its pixels.

    Attributes:
        image: (height, width, 3) display values.
        pixels: (height, width) words of RGBA bytes, written to; row 0 is the bottom one.
        width, height: size of both.
    """

    image: Floats
    pixels: Words
    width: int
    height: int


def encode_rgba(image: Float32, pixels: Words) -> None:
    """Write an image (h, w, 3) to opaque pixels (h, w), bottom row first; values are clamped to [0, 1]."""
    height, width = pixels.shape
    kernel = kernel_if_possible("integrations.kernels.encode_image")
    if kernel is not None:
        kernel(pack(EncodedImage(np.ascontiguousarray(image), pixels, width, height)))
        return
    channels = pixels.view(np.uint8).reshape(height, width, 4)
    channels[..., :3] = np.clip(image[::-1], 0.0, 1.0) * np.float32(255.0) + np.float32(0.5)
    channels[..., 3] = 255
