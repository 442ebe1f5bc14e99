"""No image at rest is worse than the method's own, in random scenes."""

import os
from collections.abc import Callable
from functools import cache
from typing import Any, cast

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from fuzzing import examples
from gpu_steps import device_or_skip
from rest_scenes import SCENES, RestScene, stripes, wave, worse_by
from supersampler import Model, Upscaler

MEAN, QUANTILE = 1.0, 4.0
"""Limits of how much worse an image may be, 1/255 of the display."""


Promise = Callable[[RestScene, str], None]
LONG = "SUPERSAMPLER_FUZZ" in os.environ


@cache
def model(method: str, executor: Any) -> Model:
    return Model.load(method, executor=executor, threads=1)


def assert_never_worse(scene: RestScene, method: str, executor: str) -> None:
    options: dict[str, Any] = {"display_size": scene.display, "validate": "off"}
    ours = Upscaler(model(method, executor), **options)
    own = Upscaler(model(method, executor), at_rest="off", **options)
    for index, (frame, truth) in enumerate(scene.frames(4 * scene.period)):
        mean, quantile = worse_by(ours.step(frame), own.step(frame), truth)
        assert mean <= MEAN, f"frame {index}: {mean:.2f}/255"
        assert quantile <= QUANTILE, f"frame {index}: {quantile:.2f}/255 in the 99.9 % quantile"


def drawn(count: int) -> Callable[[Promise], Promise]:
    """Run a test on so many scenes and methods, or in `make fuzz` on many more."""
    settled = settings(
        max_examples=examples(count),
        derandomize=not LONG,
        deadline=None,
        suppress_health_check=[HealthCheck.too_slow],
    )
    draws = given(SCENES, st.sampled_from(["taau", "classifier"]))
    return lambda test: cast(Promise, settled(draws(test)))


@drawn(6)
def test_no_image_at_rest_is_worse_than_the_methods_own_on_the_cpu(scene: RestScene, method: str) -> None:
    assert_never_worse(scene, method, "cpu")


@drawn(2)
def test_no_image_at_rest_is_worse_than_the_methods_own_in_the_graph(scene: RestScene, method: str) -> None:
    assert_never_worse(scene, method, "onnx")


@pytest.mark.skipif(not LONG, reason="without a GPU it takes minutes; make fuzz runs it")
@drawn(2)
def test_no_image_at_rest_is_worse_than_the_methods_own_on_the_gpu(scene: RestScene, method: str) -> None:
    device_or_skip()
    assert_never_worse(scene, method, "gpu")


@pytest.mark.parametrize("executor", ["cpu", "onnx"])
def test_a_spot_that_blinks_with_every_other_jitter_is_not_averaged(executor: str) -> None:
    scene = RestScene(wave, lambda t: 1.0 if t % 2 else 0.3, place="spot", ratio=1.5)
    assert_never_worse(scene, "taau", executor)


@pytest.mark.parametrize("executor", ["cpu", "onnx"])
@pytest.mark.parametrize("render", [(48, 32), (37, 27)])
def test_a_spot_that_blinks_on_fine_stripes_is_not_averaged_in_part(
    executor: str, render: tuple[int, int]
) -> None:
    scene = RestScene(stripes(3.0, 1.0), lambda t: 1.0 if t // 2 % 2 else 0.125, place="spot", render=render)
    assert_never_worse(scene, "classifier", executor)
