"""AOVs on the GPU are those of the graph that other backends run."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from gpu_steps import aovs_of, make, with_aovs
from method_lists import WITH_SHADERS
from noise import Size, noise
from shared_models import shared_model
from supersampler import Frame
from supersampler.backends.base import AovRequest
from supersampler.backends.onnx.executor import AovBlender
from supersampler.errors import DeviceError
from supersampler.frame import Float32
from supersampler.methods.model_file import read_upscaling_info

SIZES: list[tuple[Size, Size]] = [
    ((1, 1), (1, 1)),
    ((2, 3), (3, 5)),
    ((17, 9), (33, 18)),
    ((21, 13), (21, 13)),
    ((9, 21), (18, 41)),
]


def noisy(index: int, size: Size, channels: int = 3, **fields: Any) -> Frame:
    return replace(with_aovs(noise(index, size, exposure=1.0), index, channels), **fields)


def blender() -> AovBlender:
    return AovBlender(read_upscaling_info("taa"), 1)


@pytest.mark.parametrize(("render", "display"), SIZES)
@pytest.mark.parametrize("method", WITH_SHADERS)
def test_blended_aovs_are_those_of_the_graph_with_the_same_weights(
    method: str, render: Size, display: Size
) -> None:
    """Mean, 99.9 % quantile and largest difference, borders included."""
    ours, silent = (make(method, display=display) for _ in range(2))
    graph, apart = blender(), []
    history: Float32 | None = None
    for index in range(6):
        frame = noisy(index, render)
        result = ours.step(frame, outputs=("aovs", "weight"))
        np.testing.assert_array_equal(result.image, silent.step(frame))
        assert result.weight is not None
        assert result.aovs is not None
        weight = None if history is None else result.weight[None, None]
        history = graph.blend(AovRequest(frame, display, weight, history))
        apart.append(np.abs(result.aovs - history[0].transpose(1, 2, 0)).ravel())
    differences = np.concatenate(apart)
    assert differences.mean() < 5e-4
    assert np.quantile(differences, 0.999) < 0.1
    assert differences.max() < 0.3


def test_infinite_values_count_as_the_largest() -> None:
    ours, graph = make("taa"), blender()
    for value in (np.inf, -np.inf, 1e30):
        aovs = np.asarray(noisy(0, (20, 12)).aovs)
        frame = noisy(0, (20, 12), aovs=np.where(aovs > 0.8, np.float32(value), aovs))
        wanted = graph.blend(AovRequest(frame, (40, 24), None, None))
        np.testing.assert_allclose(aovs_of(ours, frame), wanted[0].transpose(1, 2, 0), rtol=1e-4, atol=1e-4)


def test_a_history_of_aovs_follows_motion_and_fills_in_for_missing_samples() -> None:
    upscaler, size = make("taa", display=(40, 24)), (20, 12)
    ramp = np.linspace(0.0, 1.0, 20, dtype=np.float32) * np.ones((12, 1), np.float32)
    still = np.zeros((12, 20, 2), np.float32)
    moved = still + np.array([-2.0, 0.0], np.float32)
    first = aovs_of(upscaler, noise(0, size, motion=still, jitter=(0.0, 0.0), aovs=ramp[..., None]))
    missing = np.full((12, 20, 1), np.nan, np.float32)
    second = aovs_of(upscaler, noise(1, size, motion=moved, jitter=(0.0, 0.0), aovs=missing))
    np.testing.assert_allclose(second[:, 6:], first[:, 2:-4], atol=1e-4)


def test_a_channel_that_begins_with_missing_samples_takes_the_first_ones() -> None:
    upscaler, size = make("taa", display=(40, 24)), (20, 12)
    aovs = np.full((12, 20, 1), 0.8, np.float32)
    for index in range(4):
        given = aovs if index > 1 else np.where(np.arange(20)[:, None] < 10, np.float32(np.nan), aovs)
        blended = aovs_of(upscaler, noise(index, size, aovs=given))
        np.testing.assert_allclose(blended[:, 24:], 0.8, rtol=1e-5)
        np.testing.assert_allclose(blended[:, :14], 0.8 if index > 1 else 0.0, rtol=1e-5, atol=1e-20)


def test_a_frame_without_the_output_drops_the_history_of_aovs() -> None:
    ours, theirs = make("taau"), make("taau", "cpu")
    frames = [noisy(index, (20, 12)) for index in range(3)]
    for each in (ours, theirs):
        aovs_of(each, frames[0])
        each.step(frames[1])
    np.testing.assert_allclose(aovs_of(ours, frames[2]), aovs_of(theirs, frames[2]), atol=1e-4)


def test_a_state_takes_the_history_of_aovs_along() -> None:
    frames = [noisy(index, (20, 12)) for index in range(3)]
    upscaler, loaded, on_cpu = make("taau"), make("taau"), make("taau", "cpu")
    for frame in frames[:2]:
        aovs_of(upscaler, frame)
    loaded.load_state(upscaler.save_state())
    on_cpu.load_state(upscaler.save_state())
    wanted = aovs_of(upscaler, frames[2])
    np.testing.assert_array_equal(aovs_of(loaded, frames[2]), wanted)
    assert np.abs(aovs_of(on_cpu, frames[2]) - wanted).max() < 0.06


def test_numbers_of_channels_take_turns_after_resets() -> None:
    upscaler = make("taa")
    for index, channels in enumerate((1, 4, 2, 33)):
        frame = noisy(index, (20, 12), channels, reset=True)
        assert aovs_of(upscaler, frame).shape == (24, 40, channels)


def test_aovs_beyond_a_binding_are_refused_with_the_number_that_fits(monkeypatch: pytest.MonkeyPatch) -> None:
    limits = shared_model("taa", "gpu").gpu.device.limits
    monkeypatch.setattr(
        type(shared_model("taa", "gpu").gpu.device),
        "limits",
        {**limits, "max-storage-buffer-binding-size": 12 * 40 * 24},
    )
    with pytest.raises(DeviceError, match=r"4 channels of AOVs .* request at most 3 channels"):
        aovs_of(make("taa"), noisy(0, (20, 12), 4))
