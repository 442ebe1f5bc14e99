"""No image at rest is worse than the method's own, in random scenes and in those that once were."""

import os
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from fuzzing import examples
from gpu_steps import device_or_skip
from rest_scenes import SCENES, RestScene, cells, flat, stripes, wave, worse_by
from shared_models import shared_model
from supersampler import Upscaler

MEAN, QUANTILE = 1.0, 8.2
"""Limits of how much worse an image may be, 1/255 of the display. At the rim of a spot that blinks with the
jitter, the mean at rest is 8.1 off, while `taau` itself follows the light at once."""
LONG = "SUPERSAMPLER_FUZZ" in os.environ
ON_GPU = pytest.mark.skipif(not LONG, reason="without a GPU it takes minutes; make fuzz runs it")


SMALL = (32, 24)


@pytest.mark.parametrize("executor", ["cpu", "onnx", pytest.param("gpu", marks=ON_GPU)])
@settings(
    max_examples=examples(4),
    derandomize=not LONG,
    deadline=None,
    suppress_health_check=[HealthCheck.too_slow],
)
@given(scene=SCENES, method=st.sampled_from(["taau", "classifier"]))
# light that fades, pulses and blinks with the jitter, in a spot too, and a screen
@example(RestScene(flat, lambda t: 1.0 - 0.5 * min(max(0, t - 66), 64) / 64, render=SMALL), "taau")
@example(RestScene(wave, lambda t: 1.0 + 0.2 * np.sin(2 * np.pi * t / 32), render=SMALL), "taau")
@example(RestScene(wave, lambda t: 1.0 if t // 8 % 2 else 0.4, render=SMALL), "taau")
@example(RestScene(cells, lambda t: 1.0 if t // 4 % 2 else 0.4, place="spot", render=SMALL), "taau")
@example(RestScene(wave, place="spot", speed=1.0, render=SMALL), "taau")
# spots that blink with every other jitter: windows at the rim have a part of them, the mover hides another
@example(RestScene(flat, lambda t: 1.0 if t % 2 else 0.5, place="spot", mover=True, ratio=1.5), "taau")
@example(RestScene(wave, lambda t: 1.0 if t % 2 else 0.3, place="spot", ratio=1.5), "taau")
# a spot that blinks on fine stripes
@example(RestScene(stripes(3.0, 1.0), lambda t: 1.0 if t // 2 % 2 else 0.125, place="spot"), "classifier")
@example(
    RestScene(stripes(3.0, 1.0), lambda t: 1.0 if t // 2 % 2 else 0.125, place="spot", render=(37, 27)),
    "classifier",
)
def test_no_image_at_rest_is_worse_than_the_methods_own(executor: str, scene: RestScene, method: str) -> None:
    if executor == "gpu":
        device_or_skip()
    options: dict[str, Any] = {"display_size": scene.display, "validate": "off"}
    ours = Upscaler(shared_model(method, executor), **options)
    own = Upscaler(shared_model(method, executor), at_rest="off", **options)
    for index, (frame, truth) in enumerate(scene.frames(4 * scene.period)):
        mean, quantile = worse_by(ours.step(frame), own.step(frame), truth)
        assert mean <= MEAN, f"frame {index}: {mean:.2f}/255"
        assert quantile <= QUANTILE, f"frame {index}: {quantile:.2f}/255 in the 99.9 % quantile"
