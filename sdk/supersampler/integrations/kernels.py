"""Kernel of `rgba`: compiled, never called from Python."""

import numpy as np

from supersampler.backends.cpu.simd.vector import load16, maximum, minimum, packed, to_int
from supersampler.integrations.rgba import EncodedImage


def encode_image(target: EncodedImage):
    """Write the pixels, opaque; values are clamped to [0, 1]."""
    image, pixels, width, height = target.image, target.pixels, target.width, target.height
    opaque = np.int32(-(1 << 24))
    for row in range(height):
        source, to = 3 * row * width, (height - 1 - row) * width
        whole = max(0, (width - 2) // 4 * 4)  # sixteen values are read for four pixels
        for x in range(0, whole, 4):
            values = maximum(minimum(load16(image, source + 3 * x), 1.0), 0.0) * 255.0 + 0.5
            bytes_ = to_int(values)
            pixels[to + x] = packed(bytes_, 0) | opaque
            pixels[to + x + 1] = packed(bytes_, 3) | opaque
            pixels[to + x + 2] = packed(bytes_, 6) | opaque
            pixels[to + x + 3] = packed(bytes_, 9) | opaque
        for x in range(whole, width):
            word = opaque
            for channel in range(3):
                value = max(min(image[source + 3 * x + channel], np.float32(1.0)), np.float32(0.0))
                byte = np.int32(value * np.float32(255.0) + np.float32(0.5))
                word |= byte << np.int32(8 * channel)
            pixels[to + x] = word
