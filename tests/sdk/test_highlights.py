"""Lamps before a blue sky: no image is brighter than its samples, in any method and backend."""

from typing import Any

import numpy as np
import pytest

from gpu_steps import device_or_skip
from method_backends import BACKENDS
from shared_models import shared_model
from supersampler import Frame, Upscaler, halton_jitter
from supersampler.frame import Float32
from supersampler.methods.constants import MAX_TONED

RENDER, DISPLAY = (32, 20), (64, 40)
SKY, RADIUS = (0.4, 0.6, 1.2), 3.2
METHODS = ("taau", "classifier", "classifier-small", "classifier-large")
PAIRS = [pair for pair in BACKENDS if pair[0] in METHODS]


def lamp(index: int, light: float, speed: float, exposure: float = 1.0) -> Frame:
    """A white disc of `light` that moves by `speed` render pixels a frame."""
    width, height = RENDER
    jitter = halton_jitter(index, 2.0)
    y, x = np.mgrid[:height, :width]
    lit = np.hypot(x + jitter[0] - 11 - speed * index, y + jitter[1] - 9) < RADIUS
    motion = np.zeros((height, width, 2), np.float32)
    motion[lit] = -speed, 0.0
    return Frame(
        color=np.where(lit[..., None], light, SKY).astype(np.float32),
        depth=np.where(lit, 0.1, 0.01).astype(np.float32),
        motion=motion,
        jitter=jitter,
        exposure=exposure,
        reset=index == 0,
    )


def images(method: str, executor: Any, count: int, *scene: float) -> list[Float32]:
    """Return the images of so many frames of `lamp`."""
    upscaler = Upscaler(shared_model(method, executor), display_size=DISPLAY, at_rest="off", validate="off")
    return [upscaler.step(lamp(index, *scene)).copy() for index in range(count)]


def gain(image: Float32, light: float) -> float:
    """Return the light of the lamp in an image, relative to its light."""
    sky = np.asarray(SKY)
    return float((image - sky).sum() / (np.pi * (2.0 * RADIUS) ** 2 * (light - sky).sum()))


@pytest.mark.parametrize(
    ("method", "executor", "light", "speed"),
    [
        *((*pair, light, speed) for pair in PAIRS for light in (20.0, 120.0, 1000.0) for speed in (0.0, 0.6)),
        *(
            pytest.param(method, "gpu", light, 0.6, marks=pytest.mark.long)  # software Vulkan
            for method in METHODS
            for light in (20.0, 1000.0)
        ),
    ],
)
def test_a_lamp_gains_no_light(method: str, executor: str, light: float, speed: float) -> None:
    if executor == "gpu":
        device_or_skip()
    shown = images(method, executor, 6, light, speed)
    assert shown[0].max() <= 1.02 * light  # one frame alone
    for image in shown:
        assert gain(image, light) < 1.1
        if method == "taau":  # the classifiers sharpen the history: single pixels may be brighter
            assert image.max() < 1.2 * light


@pytest.mark.parametrize(("light", "exposure", "gain"), [(5000.0, 1.0, 1.1), (60000.0, 1000.0, 6.6)])
@pytest.mark.parametrize("method", ["classifier", "classifier-small"])
def test_light_beyond_half_floats_stays_as_bright(
    method: str, light: float, exposure: float, gain: float
) -> None:
    brightest = MAX_TONED / (1.0 - MAX_TONED) / exposure
    for image in images(method, "cpu", 12, light, 0.0, exposure)[4:]:
        core = image[16:22, 20:26] / min(light, brightest)  # inside the disc
        assert core.min() > 0.3
        assert 0.85 < core.mean() < gain
