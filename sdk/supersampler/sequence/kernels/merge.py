"""Kernel of `merge_images`: compiled, never called from Python."""

import numpy as np

from supersampler.sequence.kernels.structs import MergedImages


def merge_images(images: MergedImages):
    """Write the weighted mean of two images, taken after the tone curve c / (1 + max(c))."""
    image, other, one = images.image, images.other, np.float32(1.0)
    for pixel in range(images.pixels):
        at = 3 * pixel
        a, b = images.weight[pixel], images.other_weight[pixel]
        a = a / (one + images.exposure * max(max(image[at], image[at + 1]), image[at + 2]))
        b = b / (one + images.exposure * max(max(other[at], other[at + 1]), other[at + 2]))
        share = b / max(a + b, np.float32(1e-30))
        for channel in range(3):
            value = image[at + channel]
            image[at + channel] = value + share * (other[at + channel] - value)
