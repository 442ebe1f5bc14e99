"""Frames that lie on a device go into a graph, and images out, where they are."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from noise import noise
from shared_models import shared_model
from supersampler import ArgumentError, Frame, FrameError, Upscaler
from supersampler.backends.onnx.session import planes_of

DISPLAY = (64, 36)


def tensors_of(frame: Frame) -> dict[str, torch.Tensor]:
    names = [name for name in ("color", "depth", "motion", "reactive") if getattr(frame, name) is not None]
    return {name: torch.from_numpy(planes_of(getattr(frame, name))) for name in names}


def stepped(upscaler: Upscaler, frame: Frame) -> NDArray[np.float32]:
    """Return the image (h, w, 3) of a frame's tensors."""
    names = "jitter", "exposure", "reset", "pre_exposure"
    image = upscaler.step_tensors(tensors_of(frame), **{name: getattr(frame, name) for name in names})
    return np.asarray(np.asarray(np.from_dlpack(image))[0].transpose(1, 2, 0))


def upscaler(method: str = "taau", executor: Any = "onnx") -> Upscaler:
    return Upscaler(shared_model(method, executor), display_size=DISPLAY, validate="off")


@pytest.mark.parametrize("method", ["bilinear", "taau", "classifier"])
def test_tensors_give_the_image_that_arrays_give(method: str) -> None:
    one, other = upscaler(method), upscaler(method)
    for seed in (0, 1, 2, 0, 3):
        mask = np.full((18, 32), 0.25, np.float32) if seed == 2 else None
        frame = noise(seed, pre_exposure=4.0**seed, reactive=mask)
        np.testing.assert_array_equal(one.step(frame), stepped(other, frame))
    assert other.stats.resets == one.stats.resets


def test_an_image_is_written_into_the_given_buffer() -> None:
    frame, out = noise(1), torch.zeros(1, 3, *DISPLAY[::-1])
    assert upscaler().step_tensors(tensors_of(frame), jitter=frame.jitter, out=out) is out
    np.testing.assert_array_equal(out[0].permute(1, 2, 0).numpy(), upscaler().step(frame))


@pytest.mark.parametrize(
    "out",
    [
        torch.zeros(1, 3, 35, 64),
        torch.zeros(1, 3, 36, 64, dtype=torch.float16),
        torch.zeros(1, 36, 64, 3).permute(0, 3, 1, 2),
        7,
    ],
)
def test_a_buffer_that_cannot_hold_the_image_is_refused(out: Any) -> None:
    with pytest.raises(ArgumentError, match="out is "):
        upscaler().step_tensors(tensors_of(noise(1)), jitter=(0.0, 0.0), out=out)


def test_a_mask_may_be_none_and_a_misspelt_one_is_refused() -> None:
    one, other, frame = upscaler(), upscaler(), noise(1)
    mask = torch.full((1, 1, 18, 32), 0.5)
    with pytest.raises(FrameError, match=r"frame\.tensors\['reactve'\] is .* Did you mean 'reactive'\?"):
        one.step_tensors({**tensors_of(frame), "reactve": mask}, jitter=frame.jitter)
    nothing: dict[str, Any] = {"reactive": None}
    image: Any = one.step_tensors(tensors_of(frame), jitter=frame.jitter)
    masked: Any = other.step_tensors({**tensors_of(frame), **nothing}, jitter=frame.jitter)
    np.testing.assert_array_equal(np.from_dlpack(image), np.from_dlpack(masked))


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


@pytest.mark.parametrize("spoilt", [{"jitter": (3.0, 0.0)}, {"exposure": -1.0}])
def test_jitter_and_exposure_are_checked_as_those_of_frames_are(spoilt: dict[str, Any]) -> None:
    with pytest.raises(FrameError, match=rf"frame\.{next(iter(spoilt))} is"):
        upscaler().step_tensors(tensors_of(noise(1)), **{"jitter": (0.0, 0.0), **spoilt})


def test_kernels_take_no_tensors() -> None:
    with pytest.raises(ArgumentError, match="onnx"):
        upscaler(executor="cpu").step_tensors(tensors_of(noise(1)), jitter=(0.0, 0.0))


def test_tensors_and_arrays_may_take_turns() -> None:
    one, other = upscaler(), upscaler()
    for frame in map(noise, range(4)):
        image = other.step(frame) if frame.reset else stepped(other, frame)
        np.testing.assert_array_equal(image, one.step(frame))
    np.testing.assert_array_equal(other.step(noise(4)), one.step(noise(4)))
