"""Tests of the RGBA encoding for OpenGL."""

import numpy as np
import pytest

from supersampler.backends.cpu.library import encode_rgba


@pytest.mark.parametrize("size", [(1, 1), (2, 2), (5, 3), (6, 3), (7, 2), (9, 4), (17, 3), (1030, 2)])
def test_an_image_becomes_opaque_bytes_from_the_bottom_row_up(size: tuple[int, int]) -> None:
    width, height = size
    image = np.random.default_rng(4).uniform(-0.2, 1.4, (height, width, 3)).astype(np.float32)
    for given in (image, np.asfortranarray(image)):
        pixels = np.zeros((height, width), np.int32)
        encode_rgba(given, pixels)
        channels = pixels.view(np.uint8).reshape(height, width, 4)
        expected = np.floor(image.clip(0, 1)[::-1] * np.float32(255) + 0.5)
        np.testing.assert_array_equal(channels[..., :3], expected)
        assert (channels[..., 3] == 255).all()
