"""Upscalers on the GPU and on other backends, and the tolerances between their images."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest

from method_lists import WITH_SHADERS
from noise import Size
from shared_models import shared_model
from supersampler import Frame, Upscaler, halton_jitter
from supersampler.backends.gpu.device import default_device
from supersampler.errors import DeviceError
from supersampler.frame import Float32
from supersampler.io.display import display_transform
from supersampler_bench.stress.scenes import Orbit

METHODS = [name for name in WITH_SHADERS if name != "classifier-large"]
RENDER, DISPLAY = (20, 12), (40, 24)
TOLERANCES = dict.fromkeys(WITH_SHADERS, 4e-3)
"""Mean difference of display values, in [0, 1], from the CPU backend: histories have 14 bits a channel, and
samples are half floats."""
INT8 = 6e-3
"""Tolerance between int8 networks and the fp32 networks of torch and ONNX, on small and noisy images."""


def device_or_skip() -> Any:
    """Return the device of this process; without one, skip the tests that use it, with the reason."""
    try:
        return default_device()
    except DeviceError as error:
        pytest.skip(str(error))


def make(method: str, executor: Any = "gpu", display: Size = DISPLAY, **options: Any) -> Upscaler:
    fixed: dict[str, Any] = {"validate": "off", **options}
    return Upscaler(shared_model(method, executor), display_size=display, **fixed)


@cache
def moving(index: int, render: Size = RENDER, ratio: float = 2.0) -> Frame:
    """A disc before a plane, both moving, with measured exposure."""
    frame = Orbit().frame(index, render, halton_jitter(index, ratio))
    return replace(frame, reset=index == 0, exposure=None)


def distance(one: Float32, other: Float32, exposure: float | None = None) -> float:
    shown = [display_transform(image, exposure or 1.0) for image in (one, other)]
    return float(np.abs(shown[0] - shown[1]).mean())


def assert_alike(method: str, frames: Sequence[Frame], display: Size = DISPLAY) -> None:
    """Step the GPU and the CPU backend through the same frames; compare each image."""
    ours, theirs = make(method, display=display), make(method, "cpu", display)
    for index, frame in enumerate(frames):
        image = ours.step(frame)
        assert np.isfinite(image).all(), f"frame {index}"
        assert image.min() >= 0.0, f"frame {index}"
        off = distance(image, theirs.step(frame), frame.exposure)
        assert off <= TOLERANCES[method], f"frame {index}"


def with_aovs(frame: Frame, index: int, channels: int = 3) -> Frame:
    """AOVs of noise; some of them are missing."""
    random = np.random.default_rng(index)
    values = random.random((*frame.size[::-1], channels), np.float32)
    values[random.random(values.shape) < 0.1] = np.nan
    return replace(frame, aovs=values)


def aovs_of(upscaler: Upscaler, frame: Frame) -> Float32:
    aovs = upscaler.step(frame, outputs=("aovs",)).aovs
    assert aovs is not None
    return aovs
