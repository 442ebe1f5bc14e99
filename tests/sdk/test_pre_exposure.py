"""Pre-exposure: k times the colour gives k times the image, whatever k is in each frame."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from method_backends import BACKENDS, DISPLAY, RENDER, frame_for, make
from noise import noise
from supersampler import Frame, FrameError, Upscaler
from supersampler.backends.onnx.tensors import tensors_of_frame
from supersampler.frame import Float32
from supersampler.io.display import display_transform
from supersampler.methods.model_file import extrapolation_names
from supersampler.sequence.frame_store import FrameStore

POWERS = st.lists(st.integers(-20, 20).map(lambda power: 2.0**power), min_size=3, max_size=5)


@cache
def plain_images(method: str, executor: str, count: int, exposure: float | None) -> list[Float32]:
    """Images without pre-exposure."""
    return images(method, executor, [1.0] * count, exposure)


def images(method: str, executor: str, factors: Sequence[float], exposure: float | None) -> list[Float32]:
    """Images of frames with these pre-exposures."""
    upscaler = make(method, executor)
    return [upscaler.step(exposed(upscaler, index, k, exposure)) for index, k in enumerate(factors)]


def exposed(upscaler: Upscaler, index: int, factor: float, exposure: float | None) -> Frame:
    frame = frame_for(upscaler, index)
    color = np.asarray(frame.color) * np.float32(factor)
    return replace(frame, color=color, pre_exposure=factor, exposure=exposure)


@pytest.mark.parametrize(("method", "executor"), BACKENDS)
@settings(max_examples=4, deadline=None)
@given(factors=POWERS, exposure=st.sampled_from([None, 1.5]))
def test_a_power_of_two_changes_nothing_but_the_unit(
    method: str, executor: str, factors: list[float], exposure: float | None
) -> None:
    plain = plain_images(method, executor, len(factors), exposure)
    for image, factor, expected in zip(
        images(method, executor, factors, exposure), factors, plain, strict=True
    ):
        np.testing.assert_array_equal(image, np.float32(factor) * expected)


@pytest.mark.parametrize(("method", "executor"), BACKENDS)
@settings(max_examples=3, deadline=None)
@given(factors=st.lists(st.floats(2.0**-20, 2.0**20), min_size=4, max_size=4))
def test_any_factor_changes_the_unit_of_its_frame(method: str, executor: str, factors: list[float]) -> None:
    """Rounding makes k c / k differ from c, which can flip a comparison; so both steps start from k c / k."""
    upscaler, plain = make(method, executor), make(method, executor)
    for index, factor in enumerate(factors):
        frame = exposed(upscaler, index, factor, 1.0)
        quotient = np.asarray(frame.color) / np.float32(factor)
        expected = plain.step(replace(frame, color=quotient, pre_exposure=1.0))
        image = upscaler.step(frame) / np.float32(factor)
        np.testing.assert_allclose(display_transform(image), display_transform(expected), atol=1e-6)


def test_light_is_limited_after_the_division() -> None:
    """A colour that only its pre-exposure makes larger than half floats is no brighter than it was."""
    upscaler = make("bilinear", "onnx")
    color = np.full((*RENDER[::-1], 3), 3e5, np.float32)
    dim = upscaler.step(noise(0, RENDER, color=color, pre_exposure=1024.0))
    np.testing.assert_allclose(dim, 3e5, rtol=1e-6)
    bright = upscaler.step(noise(0, RENDER, color=color, pre_exposure=2.0))
    np.testing.assert_allclose(bright, 2.0 * 65504.0, rtol=1e-6)


@pytest.mark.parametrize("extrapolation", extrapolation_names())
@pytest.mark.parametrize("executor", ["onnx", "cpu"])
def test_an_unshaded_frame_is_in_its_own_unit(executor: str, extrapolation: str) -> None:
    def run(factors: Sequence[float]) -> list[Float32]:
        upscaler = make("taau", executor, extrapolation=extrapolation)
        made = []
        for index, factor in enumerate(factors):
            frame = exposed(upscaler, index, factor, 1.0)
            unshaded = index % 2 == 1
            made.append(
                upscaler.extrapolate(replace(frame, color=None)) if unshaded else upscaler.step(frame)
            )
        return made

    factors = [4.0, 0.5, 2.0, 64.0]
    for image, factor, expected in zip(run(factors), factors, run([1.0] * 4), strict=True):
        np.testing.assert_array_equal(image, np.float32(factor) * expected)


@pytest.mark.parametrize("bad", [0.0, -1.0, float("nan"), float("inf"), 1e-9, "2", None])
def test_another_pre_exposure_is_refused_and_the_history_is_as_it_was(bad: Any) -> None:
    ours, theirs = make("taau", "onnx"), make("taau", "onnx")
    for upscaler in (ours, theirs):
        upscaler.step(noise(0, RENDER))
    with pytest.raises(
        FrameError, match=r"frame\.pre_exposure is .*; want a number > 0, in .* It is the factor"
    ):
        ours.step(noise(1, RENDER, pre_exposure=bad))
    tensors = tensors_of_frame(noise(1, RENDER), "cpu")
    with pytest.raises(FrameError, match=r"frame\.pre_exposure is"):
        ours.step_tensors(tensors, jitter=(0.0, 0.0), pre_exposure=bad)
    np.testing.assert_array_equal(ours.step(noise(1, RENDER)), theirs.step(noise(1, RENDER)))


def test_two_passes_and_the_display_of_a_run_are_in_the_unit_of_the_frame() -> None:
    from supersampler import upscale_sequence

    frames = [noise(index, RENDER, exposure=1.0) for index in range(4)]
    brighter = [replace(f, color=np.asarray(f.color) * np.float32(4.0), pre_exposure=4.0) for f in frames]
    made = (
        list(upscale_sequence(each, display_size=DISPLAY, model="taau", passes=2))
        for each in (frames, brighter)
    )
    for plain, image in zip(*made, strict=True):
        np.testing.assert_array_equal(image, 4.0 * plain)


@pytest.mark.parametrize("memory", [0.0, 2.0**20])
def test_frames_that_wait_for_their_turn_keep_it_and_their_mask(memory: float) -> None:
    frame = noise(0, RENDER, pre_exposure=3.0, reactive=np.full(RENDER[::-1], 0.5, np.float16))
    with FrameStore(memory=memory, names=frozenset()) as store:
        kept: Any = store.get_frame(store.put_frame(frame))
    assert kept.pre_exposure == 3.0
    np.testing.assert_array_equal(kept.reactive, frame.reactive)
