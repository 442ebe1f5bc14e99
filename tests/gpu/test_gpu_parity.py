"""The GPU backend computes the images of torch and of the other backends."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from gpu_steps import (
    DISPLAY,
    INT8,
    METHODS,
    RENDER,
    TOLERANCES,
    assert_alike,
    distance,
    make,
    moving,
)
from method_lists import WITH_SHADERS
from noise import Size, noise
from supersampler import Frame
from supersampler_bench.parity import stepper_of_torch

SIZES = [
    ((1, 1), (1, 1)),
    ((1, 1), (2, 3)),
    ((2, 3), (5, 7)),
    ((17, 9), (17, 9)),
    ((17, 9), (23, 12)),
    ((9, 21), (18, 42)),
    ((33, 2), (97, 5)),
    ((7, 11), (21, 33)),
]
SIZES_OF_LARGE = [
    ((1, 1), (1, 1)),
    ((1, 1), (2, 2)),
    ((2, 3), (4, 5)),
    ((17, 9), (17, 9)),
    ((17, 9), (34, 17)),
]
"""`classifier-large` has ratios to 2."""
FRAMES = 100
LEARNED_FRAMES = 15  # of a network in torch and ONNX Runtime, which are slow; `bench parity` compares more


def lit(index: int) -> Frame:
    """Exposure is given in every other 25 frames; cuts in frames 90 and 91."""
    exposure = 1.5 if index // 25 % 2 else None
    return replace(moving(index), exposure=exposure, reset=index in (0, 90, 91))


@pytest.mark.parametrize("method", METHODS)
def test_hundreds_of_images_stay_with_those_of_torch_onnx_and_the_cpu(method: str) -> None:
    steppers: dict[str, Callable[[Frame], Any]] = {
        executor: make(method, executor).step for executor in ("gpu", "cpu", "onnx")
    }
    steppers["torch"] = stepper_of_torch(method, RENDER, DISPLAY)
    exact = TOLERANCES[method] if method in ("taa", "taau") else INT8
    for index in range(FRAMES):
        frame = lit(index)
        if method.startswith("classifier") and index == LEARNED_FRAMES:
            del steppers["torch"], steppers["onnx"]
        if frame.reset and "torch" in steppers and index:  # torch takes a history of its own
            steppers["torch"] = stepper_of_torch(method, RENDER, DISPLAY)
        images = {executor: step(frame) for executor, step in steppers.items()}
        for other, most in (("cpu", TOLERANCES[method]), ("onnx", exact), ("torch", exact)):
            if other not in images:
                continue
            off = distance(images["gpu"], images[other], frame.exposure)
            assert off <= most, f"{other}, frame {index}"


@pytest.mark.parametrize(
    ("method", "render", "display"),
    [
        *((method, *sizes) for method in METHODS for sizes in SIZES),
        *(("classifier-large", *sizes) for sizes in SIZES_OF_LARGE),
        *((method, (9, 5), (36, 20)) for method in ("taa", "taau")),
    ],
)
def test_odd_sizes_and_ratios_have_the_images_of_the_cpu(method: str, render: Size, display: Size) -> None:
    assert_alike(method, [noise(seed, render) for seed in range(4)], display)


@pytest.mark.parametrize("method", WITH_SHADERS)
def test_render_sizes_that_change_keep_the_history_as_on_the_cpu(method: str) -> None:
    sizes = [(20, 12), (20, 12), (31, 19), (31, 19), (40, 24), (20, 12), (33, 13), (14, 9), (33, 8), (20, 12)]
    if method == "classifier-large":
        del sizes[7:]
    assert_alike(method, [moving(index, size) for index, size in enumerate(sizes)])
    ours = make(method)
    ours.step(moving(0))
    kept, fresh = ours.step(moving(1, (31, 19))), make(method).step(moving(1, (31, 19)))
    assert np.abs(kept - fresh).max() > 1e-3, "the history has an effect"


@pytest.mark.parametrize("method", WITH_SHADERS)
def test_jumps_of_exposure_are_followed_as_on_the_cpu(method: str) -> None:
    exposures = [None, None, 1.0, 1.0, 300.0, 300.0, 0.001, None, None, 1e30, 1.0, 1e-40, 1.0, None]
    frames = [replace(moving(index), exposure=value) for index, value in enumerate(exposures)]
    dark = [replace(frame, color=np.asarray(frame.color) * 1e-3) for frame in frames[:4]]
    sudden = [replace(frame, exposure=None, reset=False) for frame in (*dark, *frames[:4])]
    bars = [
        replace(frame, color=np.asarray(frame.color) * (np.arange(20) < x)[:, None])
        for frame, x in zip(sudden[4:], (5, 5, 0, 9), strict=True)
    ]
    assert_alike(method, [*frames, *sudden, *bars])


def test_colours_of_one_chroma_keep_the_history_as_on_the_cpu() -> None:
    """Their boxes are flat in YCoCg, because green is the mean of red and blue."""
    tint = np.array([1.0, 0.75, 0.5], np.float32)
    ours, theirs = make("taau"), make("taau", "cpu")
    for index in range(8):
        frame = moving(index)
        frame = replace(frame, color=np.asarray(frame.color)[..., :1] * tint)
        assert distance(ours.step(frame), theirs.step(frame)) <= 5e-4, f"frame {index}"
