"""No image at rest is worse than the method's own, in random scenes and in those that once were."""

import os
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from fuzzing import examples
from gpu_steps import device_or_skip
from rest_scenes import SCENES, Pattern, RestScene, cells, flat, stripes, wave, worse_by
from shared_models import shared_model
from supersampler import Upscaler

MEAN, QUANTILE = 1.0, 4.0
"""Limits of how much worse an image may be, 1/255 of the display."""
LONG = "SUPERSAMPLER_FUZZ" in os.environ
ON_GPU = pytest.mark.skipif(not LONG, reason="without a GPU it takes minutes; make fuzz runs it")


def assert_never_worse(scene: RestScene, method: str, executor: str) -> None:
    options: dict[str, Any] = {"display_size": scene.display, "validate": "off"}
    ours = Upscaler(shared_model(method, executor), **options)
    own = Upscaler(shared_model(method, executor), at_rest="off", **options)
    for index, (frame, truth) in enumerate(scene.frames(4 * scene.period)):
        mean, quantile = worse_by(ours.step(frame), own.step(frame), truth)
        assert mean <= MEAN, f"frame {index}: {mean:.2f}/255"
        assert quantile <= QUANTILE, f"frame {index}: {quantile:.2f}/255 in the 99.9 % quantile"


@pytest.mark.parametrize("executor", ["cpu", "onnx", pytest.param("gpu", marks=ON_GPU)])
@settings(
    max_examples=examples(4),
    derandomize=not LONG,
    deadline=None,
    suppress_health_check=[HealthCheck.too_slow],
)
@given(scene=SCENES, method=st.sampled_from(["taau", "classifier"]))
def test_no_image_at_rest_is_worse_than_the_methods_own(scene: RestScene, method: str, executor: str) -> None:
    if executor == "gpu":
        device_or_skip()
    assert_never_worse(scene, method, executor)


@pytest.mark.parametrize("executor", ["cpu", "onnx"])
@pytest.mark.parametrize(
    "scene",
    [
        RestScene(flat, lambda t: 1.0 - 0.5 * min(max(0, t - 66), 64) / 64),
        RestScene(wave, lambda t: 1.0 + 0.2 * np.sin(2 * np.pi * t / 32)),
        RestScene(wave, lambda t: 1.0 if t // 8 % 2 else 0.4),
        RestScene(cells, lambda t: 1.0 if t // 4 % 2 else 0.4, place="spot"),
        RestScene(wave, place="spot", speed=1.0),
    ],
    ids=["fade", "pulse with the jitter", "blink with the jitter", "spot", "screen"],
)
def test_light_that_changes_leaves_the_methods_own_image(scene: RestScene, executor: str) -> None:
    assert_never_worse(replace(scene, render=(32, 24)), "taau", executor)


@pytest.mark.parametrize("executor", ["cpu", "onnx"])
@pytest.mark.parametrize(("pattern", "low", "mover"), [(flat, 0.5, True), (wave, 0.3, False)])
def test_a_spot_that_blinks_with_every_other_jitter_is_not_averaged(
    pattern: Pattern, low: float, mover: bool, executor: str
) -> None:
    """Windows at its rim have a part of it; the mover hides another part."""
    scene = RestScene(pattern, lambda t: 1.0 if t % 2 else low, place="spot", mover=mover, ratio=1.5)
    assert_never_worse(scene, "taau", executor)


@pytest.mark.parametrize("executor", ["cpu", "onnx"])
@pytest.mark.parametrize("render", [(48, 32), (37, 27)])
def test_a_spot_that_blinks_on_fine_stripes_is_not_averaged_in_part(
    executor: str, render: tuple[int, int]
) -> None:
    scene = RestScene(stripes(3.0, 1.0), lambda t: 1.0 if t // 2 % 2 else 0.125, place="spot", render=render)
    assert_never_worse(scene, "classifier", executor)
