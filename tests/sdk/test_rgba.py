"""Tests of the RGBA encoding for OpenGL: the kernel and numpy give the same bytes."""

import numpy as np
import pytest

from supersampler.integrations import rgba


@pytest.mark.parametrize("compiled", [True, False])
@pytest.mark.parametrize("size", [(1, 1), (2, 2), (5, 3), (6, 3), (7, 2), (9, 4), (17, 3)])
def test_an_image_becomes_opaque_bytes_from_the_bottom_row_up(
    size: tuple[int, int], compiled: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    if not compiled:
        monkeypatch.setattr(rgba, "kernel_if_possible", lambda _: None)
    width, height = size
    image = np.random.default_rng(4).uniform(-0.2, 1.4, (height, width, 3)).astype(np.float32)
    pixels = np.zeros((height, width), np.int32)
    rgba.encode_rgba(image, pixels)
    channels = pixels.view(np.uint8).reshape(height, width, 4)
    np.testing.assert_array_equal(channels[..., :3], np.floor(image.clip(0, 1)[::-1] * np.float32(255) + 0.5))
    assert (channels[..., 3] == 255).all()
