"""The reactive mask and pre-exposure on the GPU: the images of the other backends, and none without them."""

from dataclasses import replace

import numpy as np
import pytest

from gpu_steps import make
from method_lists import WITH_SHADERS
from noise import Size, noise
from supersampler import Frame
from supersampler.io.display import display_transform

SIZES: list[tuple[Size, Size]] = [((17, 9), (33, 18)), ((21, 13), (21, 13)), ((3, 9), (5, 17))]


def masked(index: int, size: Size) -> Frame:
    """Noise with a mask, and another pre-exposure in each frame; a sample in some is missing."""
    random, frame = np.random.default_rng(index), noise(index, size, exposure=1.5)
    factor = 1.7**index
    color = np.asarray(frame.color) * np.float32(factor)
    if index % 3 == 2:
        color[random.random(color.shape[:2]) < 0.1] = np.nan
    mask = random.random(color.shape[:2], np.float32).round(1)
    return replace(frame, color=color, pre_exposure=factor, reactive=mask)


@pytest.mark.parametrize(("render", "display"), SIZES)
@pytest.mark.parametrize("method", WITH_SHADERS)
def test_images_are_those_of_the_cpu_backend(method: str, render: Size, display: Size) -> None:
    """Mean, 99.9 % quantile and largest difference of display values."""
    exact, off = method in ("taa", "taau"), []
    ours, theirs = make(method, display=display), make(method, "cpu", display)
    for index in range(6):
        frame = masked(index, render)
        images = [display_transform(each.step(frame) / frame.pre_exposure) for each in (ours, theirs)]
        off.append(np.abs(images[0] - images[1]).ravel())
    differences = np.concatenate(off)
    assert differences.mean() < (1e-3 if exact else 4e-3)
    assert np.quantile(differences, 0.999) < (0.01 if exact else 0.05)
    assert differences.max() < (0.06 if exact else 0.15)


@pytest.mark.parametrize("method", WITH_SHADERS)
def test_a_mask_of_zeros_and_a_power_of_two_change_no_bit(method: str) -> None:
    ours, theirs = make(method), make(method)
    for index in range(4):
        frame, factor = noise(index, (20, 12)), 2.0 ** (3 * index - 4)
        zeros = np.zeros((12, 20), np.float32)
        color = np.asarray(frame.color) * np.float32(factor)
        image = ours.step(replace(frame, color=color, pre_exposure=factor, reactive=zeros))
        np.testing.assert_array_equal(image, np.float32(factor) * theirs.step(frame))
