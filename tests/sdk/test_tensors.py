"""Frames that lie on a device go into a graph, and images out, where they are."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
import torch

from noise import noise
from shared_models import shared_model
from supersampler import ArgumentError, Frame, FrameError, Upscaler
from supersampler.backends.onnx.session import planes_of

DISPLAY = (64, 36)


def tensors_of(frame: Frame) -> dict[str, torch.Tensor]:
    images = {name: getattr(frame, name) for name in ("color", "depth", "motion", "reactive")}
    return {name: torch.from_numpy(planes_of(a)) for name, a in images.items() if a is not None}


def upscaler(method: str = "taau", executor: Any = "onnx") -> Upscaler:
    return Upscaler(shared_model(method, executor), display_size=DISPLAY, validate="off")


@pytest.mark.parametrize("method", ["bilinear", "taau", "classifier"])
def test_tensors_give_the_image_that_arrays_give(method: str) -> None:
    one, other = upscaler(method), upscaler(method)
    for seed in (0, 1, 2, 0, 3):
        mask = np.full((18, 32), 0.25, np.float32) if seed == 2 else None
        frame = noise(seed, pre_exposure=4.0**seed, reactive=mask)
        image = np.from_dlpack(
            other.step_tensors(
                tensors_of(frame), jitter=frame.jitter, exposure=frame.exposure, reset=frame.reset,
                pre_exposure=frame.pre_exposure,
            )
        )  # fmt: skip
        assert tuple(image.shape) == (1, 3, *DISPLAY[::-1])
        np.testing.assert_array_equal(one.step(frame), image[0].transpose(1, 2, 0))
    assert other.stats.resets == one.stats.resets


def test_an_image_is_written_into_the_given_buffer() -> None:
    frame, out = noise(1), torch.zeros(1, 3, *DISPLAY[::-1])
    assert upscaler().step_tensors(tensors_of(frame), jitter=frame.jitter, out=out) is out
    np.testing.assert_array_equal(out[0].permute(1, 2, 0).numpy(), upscaler().step(frame))


@pytest.mark.parametrize(
    ("spoilt", "name"),
    [
        ({"color": torch.zeros(1, 3, 18, 31)}, "depth"),  # which is of another size
        ({"color": torch.zeros(1, 3, 18, 32, dtype=torch.float16)}, "color"),
        ({"motion": torch.zeros(1, 18, 32, 2).permute(0, 3, 1, 2)}, "motion"),
        ({"depth": torch.zeros(18, 32)}, "depth"),
        ({"color": torch.zeros(1, 3, 0, 32)}, "color"),
        ({"color": torch.zeros(18, 32)}, "color"),
        ({"depth": torch.zeros(1, 1, 18, 32, requires_grad=True)}, "depth"),
        ({"motion": 7}, "motion"),
        ({"motion": None}, "motion"),
    ],
)
def test_a_misshapen_tensor_is_refused_and_the_history_stays(spoilt: Mapping[str, Any], name: str) -> None:
    one, other = upscaler(), upscaler()
    first, second = noise(1), noise(2)
    for u in (one, other):
        u.step(first)
    with pytest.raises(FrameError, match=rf"frame\.{name} is"):
        other.step_tensors({**tensors_of(second), **spoilt}, jitter=second.jitter)
    color = tensors_of(second)["color"]
    with pytest.raises(ArgumentError, match="out is memory of the frame"):
        other.step_tensors({**tensors_of(second), "color": color}, jitter=second.jitter, out=color)
    without = {key: value for key, value in tensors_of(second).items() if key != name}
    with pytest.raises(FrameError, match=rf"frame\.{name} is None"):
        other.step_tensors(without, jitter=second.jitter)
    np.testing.assert_array_equal(one.step(second), other.step(second))


@pytest.mark.parametrize(
    ("spoilt", "name"), [({"jitter": (3.0, 0.0)}, "jitter"), ({"exposure": -1.0}, "exposure")]
)
def test_jitter_and_exposure_are_checked_as_those_of_frames_are(spoilt: dict[str, Any], name: str) -> None:
    with pytest.raises(FrameError, match=rf"frame\.{name} is"):
        upscaler().step_tensors(tensors_of(noise(1)), **{"jitter": (0.0, 0.0), **spoilt})


def test_kernels_take_no_tensors() -> None:
    with pytest.raises(ArgumentError, match="onnx"):
        upscaler(executor="cpu").step_tensors(tensors_of(noise(1)), jitter=(0.0, 0.0))


def test_tensors_and_arrays_may_take_turns() -> None:
    one, other = upscaler(), upscaler()
    for seed in range(4):
        frame = noise(seed)
        expected = one.step(frame)
        if seed % 2:
            image = np.from_dlpack(other.step_tensors(tensors_of(frame), jitter=frame.jitter))
            np.testing.assert_array_equal(image[0].transpose(1, 2, 0), expected)
        else:
            np.testing.assert_array_equal(other.step(frame), expected)
