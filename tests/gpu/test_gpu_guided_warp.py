"""`guided-warp` on the GPU draws the frames that torch and the CPU backend draw."""

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from alternating import extrapolated_by_torch
from extrapolated_noise import SIZES, extrapolated, spoilt_frames, surfaces
from gpu_steps import DISPLAY, RENDER, device_or_skip, distance, moving
from noise import Size
from supersampler import Frame, Model, Upscaler
from supersampler.errors import DeviceError
from supersampler.extrapolation import Extrapolator
from supersampler.frame import Float32
from supersampler_model.methods.guided_warp import GuidedWarp


@pytest.fixture(scope="module")
def ours() -> Extrapolator:
    return Extrapolator("guided-warp", ["CPUExecutionProvider"], 1, "gpu")


@pytest.fixture(scope="module")
def on_cpu() -> Extrapolator:
    return Extrapolator("guided-warp", ["CPUExecutionProvider"], 1, "cpu")


def by_torch(frames: Sequence[Frame], pattern: str) -> list[Float32]:
    images = extrapolated_by_torch(GuidedWarp(), frames.__getitem__, pattern)
    return [image for image in images if image is not None]


def in_halves(frame: Frame) -> Frame:
    """The frame with G-buffers that half floats hold exactly."""
    assert frame.gbuffer is not None
    with np.errstate(over="ignore"):
        gbuffer = {name: image.astype(np.float16).astype(np.float32) for name, image in frame.gbuffer.items()}
    return replace(frame, gbuffer=gbuffer)


def differences(found: Sequence[Float32], wanted: Sequence[Float32]) -> Float32:
    """All differences, relative where the image is bright."""
    for image in found:
        assert np.isfinite(image).all()
        assert image.min() >= 0.0
    apart = [
        (np.abs(one - other) / (1.0 + np.abs(other))).ravel()
        for one, other in zip(found, wanted, strict=True)
    ]
    return np.concatenate(apart)


@pytest.mark.parametrize("sizes", [*((size,) * 7 for size in SIZES), (*SIZES, SIZES[0])])
def test_images_are_those_of_torch_at_odd_and_changing_sizes(
    ours: Extrapolator, sizes: Sequence[Size]
) -> None:
    """Mean, 99.9 % quantile and largest difference, borders included."""
    frames = [in_halves(surfaces(seed, size)) for seed, size in enumerate(sizes)]
    apart = differences(extrapolated(ours, frames, "suuusuu"), by_torch(frames, "suuusuu"))
    assert apart.mean() < 1e-6
    assert np.quantile(apart, 0.999) < 1e-5
    assert apart.max() < 1e-4


@pytest.mark.parametrize("executor", ["ours", "on_cpu"])
def test_pixels_are_missing_where_all_samples_around_are(
    executor: str, request: pytest.FixtureRequest
) -> None:
    """Also in the second unshaded frame, and with the pre-exposure of each frame."""
    frames = [replace(in_halves(surfaces(seed, (61, 35))), pre_exposure=1.0 + seed) for seed in range(3)]
    color = np.array(frames[0].color)
    color[3:32, 8:40] = np.nan
    frames[0] = replace(frames[0], color=color)
    found = extrapolated(request.getfixturevalue(executor), frames, "suu")
    wanted = by_torch(frames, "suu")
    for one, other in zip(found, wanted, strict=True):
        missing = np.isnan(other)
        assert missing.any(axis=2).sum() > 50
        assert not missing.all()
        np.testing.assert_array_equal(np.isnan(one), missing)
        np.testing.assert_allclose(one[~missing], other[~missing], rtol=1e-3, atol=1e-3)


def test_gbuffers_are_rounded_to_half_floats(ours: Extrapolator) -> None:
    frames = [surfaces(seed, (61, 35)) for seed in range(7)]
    apart = differences(extrapolated(ours, frames, "suuusuu"), by_torch(frames, "suuusuu"))
    assert apart.mean() < 2e-5
    assert np.quantile(apart, 0.999) < 1e-3
    assert apart.max() < 5e-3


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, -1.0, 1e30, 1e-42])
@pytest.mark.parametrize("shaded", [True, False])
def test_hostile_pixels_do_the_same_as_in_torch(ours: Extrapolator, bad: float, *, shaded: bool) -> None:
    """Where no sample is similar, weights follow from differences of large costs, in single precision."""
    frames = [in_halves(frame) for frame in spoilt_frames(bad, shaded=shaded)]
    apart = differences(extrapolated(ours, frames, "suuu"), by_torch(frames, "suuu"))
    exact = shaded or bad not in (1e30, 1e-42)
    assert apart.mean() < (1e-6 if exact else 2e-4)
    assert np.quantile(apart, 0.999) < (1e-4 if exact else 0.05)
    assert apart.max() < (1e-4 if exact else 0.2)


@pytest.mark.parametrize("missing", ["depth", "normal"])
def test_a_shaded_frame_without_depths_is_told_apart_by_other_features(
    ours: Extrapolator, missing: str
) -> None:
    """Depths of samples without a normal are no depths."""
    frames = [in_halves(surfaces(seed)) for seed in range(3)]
    nothing = np.full((18, 32, 3), np.nan, np.float32)
    if missing == "depth":
        frames[0] = replace(frames[0], depth=nothing[..., 0])
    else:
        frames[0] = replace(frames[0], gbuffer={**(frames[0].gbuffer or {}), "normal": nothing})
    assert differences(extrapolated(ours, frames, "suu"), by_torch(frames, "suu")).max() < 1e-4


def test_a_shaded_frame_without_depth_does_not_concern_the_next_one(ours: Extrapolator) -> None:
    frames = [in_halves(surfaces(seed)) for seed in range(3)]
    wanted = extrapolated(ours, frames[1:], "su")
    blind = replace(frames[0], depth=np.full((18, 32), np.nan, np.float32))
    found = extrapolated(ours, [blind, frames[1], *frames[1:]], "susu")
    np.testing.assert_array_equal(found[-1], wanted[-1])


def test_pre_exposure_multiplies_the_colour(ours: Extrapolator) -> None:
    frames = [surfaces(seed) for seed in range(2)]
    plain = extrapolated(ours, frames, "su")[0]
    assert frames[0].color is not None
    lit = replace(frames[0], color=frames[0].color * np.float32(4.0), pre_exposure=4.0)
    exposed = extrapolated(ours, [lit, replace(frames[1], pre_exposure=2.0)], "su")[0]
    np.testing.assert_allclose(exposed, 2.0 * plain, rtol=1e-5)


def test_a_history_goes_to_the_cpu_backend_and_back(ours: Extrapolator, on_cpu: Extrapolator) -> None:
    frames = [in_halves(surfaces(seed)) for seed in range(4)]
    last = replace(frames[2], color=None)
    for one, other in ((ours, on_cpu), (on_cpu, ours)):
        _, history = one.extrapolate(replace(frames[1], color=None), one.after_shaded(frames[0]))
        apart = differences(
            [other.extrapolate(last, other.load(one.save(history)))[0]], [one.extrapolate(last, history)[0]]
        )
        assert apart.max() < 1e-4


def test_a_history_is_not_changed_by_what_is_extrapolated_from_it(ours: Extrapolator) -> None:
    frames = [surfaces(seed) for seed in range(3)]
    history, last = ours.after_shaded(frames[0]), replace(frames[2], color=None)
    first = ours.extrapolate(last, history)[0]
    ours.extrapolate(replace(frames[1], color=None), history)
    np.testing.assert_array_equal(ours.extrapolate(last, history)[0], first)


def test_frames_that_were_not_shaded_run_on_the_device_of_the_model(device: Any) -> None:
    own = device.adapter.request_device_sync()
    guides = {name: np.full((*RENDER[::-1], 3), 0.5, np.float32) for name in ("base_color", "normal")}
    upscaler, other = (
        Upscaler(model, display_size=DISPLAY, extrapolation="guided-warp", validate="off")
        for model in (Model.load("taau", executor="gpu", device=own), Model.load("taau", executor="cpu"))
    )
    assert upscaler._extrapolator is not None
    assert upscaler._extrapolator.executor == "gpu"
    for index in range(6):
        frame = replace(moving(index), gbuffer=guides)
        if index % 2:
            images = [each.extrapolate(replace(frame, color=None)) for each in (upscaler, other)]
        else:
            images = [each.step(frame) for each in (upscaler, other)]
        assert distance(images[0], images[1]) <= 2e-3


def test_a_model_without_shaders_extrapolates_beside_the_gpu_backend() -> None:
    upscaler = Upscaler("taau", display_size=DISPLAY, extrapolation="guided-flow", executor="gpu")
    assert upscaler._extrapolator is not None
    assert upscaler._extrapolator.executor == "onnx"


def test_a_frame_beyond_the_device_is_one_typed_error(
    ours: Extrapolator, monkeypatch: pytest.MonkeyPatch
) -> None:
    import wgpu

    def refuse(*_: Any, **__: Any) -> None:
        raise wgpu.GPUOutOfMemoryError("not enough memory left")

    monkeypatch.setattr(type(device_or_skip()), "create_buffer", refuse)
    with pytest.raises(DeviceError, match="ran out of memory"):
        ours.after_shaded(surfaces(0))
