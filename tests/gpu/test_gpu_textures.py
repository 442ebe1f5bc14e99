"""Frames and images on the caller's device: textures and buffers in and out, without a copy."""

from dataclasses import replace
from typing import Any
from weakref import WeakSet

import numpy as np
import pytest

from gpu_steps import DISPLAY, RENDER, aovs_of, device_or_skip, make, moving, with_aovs
from supersampler import ArgumentError, Frame, FrameError, Model, Upscaler
from supersampler.backends.gpu.passes import MAX_GROUPS
from supersampler.errors import DeviceError
from texture_frames import (
    COPY_DST,
    COPY_SRC,
    RENDERED,
    SAMPLED,
    STORAGE,
    STORED,
    buffer_of,
    buffers_of,
    pixels_of,
    texture_of,
    textures_of,
)


@pytest.fixture(scope="module")
def device() -> Any:
    return device_or_skip().adapter.request_device_sync()


@pytest.fixture(scope="module")
def ours(device: Any) -> Model:
    return Model.load("taau", executor="gpu", device=device)


@pytest.mark.parametrize("kind", [textures_of, buffers_of])
def test_textures_and_buffers_take_a_mask_and_a_pre_exposure(device: Any, ours: Model, kind: Any) -> None:
    upscaler, arrays = Upscaler(ours, display_size=DISPLAY), make("taau")
    for index, factor in enumerate((1.0, 4.0, 0.5, 2.0)):
        frame = moving(index)
        mask = np.full(RENDER[::-1], 0.5, np.float32) if index > 1 else None
        color = np.asarray(frame.color) * np.float32(factor)
        frame = replace(frame, color=color, pre_exposure=factor, reactive=mask)
        image = upscaler.step_textures(
            kind(device, frame),
            jitter=frame.jitter,
            pre_exposure=factor,
            reset=frame.reset,
            render_size=RENDER if kind is buffers_of else None,
        )
        np.testing.assert_allclose(pixels_of(device, image), arrays.step(frame), rtol=2e-3, atol=1e-6)


def test_buffers_give_the_images_of_arrays_bit_for_bit(device: Any, ours: Model) -> None:
    upscaler, arrays = Upscaler(ours, display_size=DISPLAY), make("taau")
    out = device.create_buffer(size=12 * DISPLAY[0] * DISPLAY[1], usage=STORAGE | 4)
    for index in range(4):
        frame = moving(index)
        buffers = buffers_of(device, frame)
        found = upscaler.step_textures(
            buffers, jitter=frame.jitter, reset=frame.reset, render_size=RENDER, out=out
        )
        assert found is out
        image = np.frombuffer(device.queue.read_buffer(out), np.float32).reshape(*DISPLAY[::-1], 3)
        np.testing.assert_array_equal(image, arrays.step(frame))


def test_a_method_that_reads_no_depth_asks_for_none(device: Any) -> None:
    upscaler = Upscaler(Model.load("taa", executor="gpu", device=device), display_size=DISPLAY)
    images = textures_of(device, moving(0))
    del images["depth"]
    assert upscaler.step_textures(images, jitter=(0.0, 0.0)).size[:2] == DISPLAY


def test_steps_encoded_into_one_encoder_run_in_order(device: Any, ours: Model) -> None:
    upscaler, arrays = Upscaler(ours, display_size=DISPLAY), make("taau")
    encoder = device.create_command_encoder()
    for index in range(3):
        frame = moving(index)
        images = textures_of(device, frame)
        last = upscaler.encode_into(encoder, images, jitter=frame.jitter, reset=frame.reset)
        wanted = arrays.step(frame)
    device.queue.submit([encoder.finish()])
    np.testing.assert_allclose(pixels_of(device, last), wanted, rtol=2e-3, atol=1e-6)


def test_textures_of_earlier_frames_are_released(device: Any, ours: Model) -> None:
    upscaler, alive = Upscaler(ours, display_size=DISPLAY), WeakSet[Any]()
    for _ in range(4 * MAX_GROUPS):
        images = textures_of(device, moving(0))
        images["image"] = upscaler.step_textures(images, jitter=(0.0, 0.0))
        alive.update(images.values())
    assert len(alive) <= (2 * MAX_GROUPS + 1) * len(images)  # of steps from either history to the other


def test_wrong_images_are_refused_and_the_history_stays(device: Any, ours: Model) -> None:
    upscaler, other = Upscaler(ours, display_size=DISPLAY), Upscaler(ours, display_size=DISPLAY)
    first = moving(0)
    for one in (upscaler, other):
        one.step_textures(textures_of(device, first), jitter=first.jitter)
    good = textures_of(device, moving(1))
    depths = device.create_texture(size=(*RENDER, 1), format="depth32float", usage=SAMPLED)
    foreign = device_or_skip().create_texture(size=(*RENDER, 1), format="r32float", usage=SAMPLED)
    small = texture_of(device, np.zeros((3, 3)), "r32float", 1)
    unusable = device.create_texture(size=(*RENDER, 1), format="r32float", usage=COPY_DST)
    layers = device.create_texture(size=(*RENDER, 2), format="r32float", usage=SAMPLED)
    view = good["depth"].create_view()
    for wrong in (depths, foreign, small, unusable, layers, view, np.zeros(RENDER[::-1], np.float32), None):
        with pytest.raises(FrameError, match=r"frame\.depth is"):
            upscaler.step_textures({**good, "depth": wrong}, jitter=(0.0, 0.0))
    multisampled = device.create_texture(
        size=(*RENDER, 1), format="rgba16float", usage=SAMPLED | RENDERED, sample_count=4
    )
    for name, few in (("color", multisampled), ("color", good["motion"])):
        with pytest.raises(FrameError, match=rf"frame\.{name} is .*want a colour format of . or more"):
            upscaler.step_textures({**good, name: few}, jitter=(0.0, 0.0))
    for kind in ("rg8unorm", "rg8snorm", "rg11b10ufloat"):
        encoded = device.create_texture(size=(*RENDER, 1), format=kind, usage=SAMPLED)
        with pytest.raises(
            FrameError, match=rf"frame\.motion is {kind} .*; want a float format of 2 or more"
        ):
            upscaler.step_textures({**good, "motion": encoded}, jitter=(0.0, 0.0))
    with pytest.raises(FrameError, match=r"frame\.images\['reactve'\] is .* Did you mean 'reactive'\?"):
        upscaler.step_textures({**good, "reactve": good["depth"]}, jitter=(0.0, 0.0))
    with pytest.raises(FrameError, match=r"frame\.color is"):
        upscaler.step_textures(good, jitter=(0.0, 0.0), render_size=(RENDER[0] + 1, RENDER[1]))
    with pytest.raises(FrameError, match="render_size"):
        upscaler.step_textures(buffers_of(device, moving(1)), jitter=(0.0, 0.0))
    padded = device.create_buffer(size=256 * RENDER[1], usage=STORAGE)
    buffers = {**buffers_of(device, moving(1)), "depth": padded}
    with pytest.raises(
        FrameError, match=r"depth is .*, rows of 256; want rows of \d+ bytes, without padding"
    ):
        upscaler.step_textures(buffers, jitter=(0.0, 0.0), render_size=RENDER)
    target = device.create_texture(size=(*DISPLAY, 1), format="rgba8unorm", usage=STORED)
    with pytest.raises(ArgumentError, match="rgba16float"):
        upscaler.step_textures(good, jitter=(0.0, 0.0), out=target)
    both = device.create_texture(size=(*RENDER, 1), format="rgba16float", usage=SAMPLED | STORED)
    with pytest.raises(ArgumentError, match="out is another image of the step, too"):
        Upscaler(ours, display_size=RENDER).step_textures(
            {**good, "color": both}, jitter=(0.0, 0.0), out=both
        )
    foreign_encoder = device_or_skip().create_command_encoder()
    for encoder in (None, 1, device, foreign_encoder):
        with pytest.raises(ArgumentError, match="encoder is"):
            upscaler.encode_into(encoder, good, jitter=(0.0, 0.0))
    image, wanted = (one.step_textures(good, jitter=moving(1).jitter) for one in (upscaler, other))
    np.testing.assert_array_equal(pixels_of(device, image), pixels_of(device, wanted))


def test_commands_that_cannot_be_submitted_leave_the_history(
    device: Any, ours: Model, monkeypatch: pytest.MonkeyPatch
) -> None:
    upscaler, other = Upscaler(ours, display_size=DISPLAY), Upscaler(ours, display_size=DISPLAY)
    images = textures_of(device, moving(0))
    for one in (upscaler, other):
        one.step_textures(images, jitter=(0.0, 0.0))

    def refuse(*_: Any) -> None:
        raise RuntimeError("no memory")

    others = textures_of(device, moving(1))
    with monkeypatch.context() as patch:
        patch.setattr(type(device.queue), "submit", refuse)
        with pytest.raises(DeviceError, match="submitting a step"):
            upscaler.step_textures(others, jitter=(0.1, 0.1))
    image, wanted = (one.step_textures(images, jitter=(0.2, 0.0)) for one in (upscaler, other))
    np.testing.assert_array_equal(pixels_of(device, image), pixels_of(device, wanted))
    assert upscaler.stats.frames == other.stats.frames


def test_other_backends_take_no_textures() -> None:
    with pytest.raises(ArgumentError, match="textures"):
        make("taau", "cpu").step_textures({}, jitter=(0.0, 0.0))


def noisy(index: int, channels: int = 8) -> Frame:
    return with_aovs(moving(index), index, channels)


def targets(device: Any, count: int) -> list[Any]:
    usage = STORED | COPY_SRC
    return [
        device.create_texture(size=(*DISPLAY, 1), format="rgba16float", usage=usage) for _ in range(count)
    ]


def textures_of_aovs(device: Any, frame: Frame) -> list[Any]:
    aovs = np.asarray(frame.aovs)
    return [texture_of(device, aovs[..., i : i + 4], "rgba32float", 4) for i in range(0, aovs.shape[2], 4)]


def stepped(device: Any, upscaler: Upscaler, frame: Frame) -> Any:
    images, outs = textures_of_aovs(device, frame), targets(device, np.asarray(frame.aovs).shape[2] // 4)
    upscaler.step_textures(
        textures_of(device, frame), jitter=frame.jitter, reset=frame.reset, aovs=images, aovs_out=outs
    )
    return np.concatenate([pixels_of(device, out, 4) for out in outs], axis=2)


@pytest.mark.parametrize("method", ["taa", "taau", "classifier-small"])
def test_aovs_in_textures_are_those_of_arrays(device: Any, method: str) -> None:
    model = Model.load(method, executor="gpu", device=device)
    upscaler, arrays = (Upscaler(model, display_size=DISPLAY, validate="off") for _ in range(2))
    for index in range(4):
        frame = noisy(index)
        found, wanted = stepped(device, upscaler, frame), aovs_of(arrays, frame)
        assert np.abs(found - wanted).max() < 1e-3  # half floats


def test_a_frame_may_be_the_upper_left_part_of_larger_textures(device: Any, ours: Model) -> None:
    whole, part = (Upscaler(ours, display_size=DISPLAY, validate="off") for _ in range(2))
    for index in range(3):
        frame, results = noisy(index), []
        for upscaler, margin in ((whole, 0), (part, 5)):
            grown: Any = {}
            for name in ("color", "depth", "motion", "aovs"):
                image = np.asarray(getattr(frame, name))
                grown[name] = np.pad(image, [(0, margin)] * 2 + [(0, 0)] * (image.ndim - 2))
            larger, outs = replace(frame, **grown), targets(device, 2)
            image = upscaler.step_textures(
                textures_of(device, larger), jitter=frame.jitter, reset=frame.reset,
                render_size=RENDER, aovs=textures_of_aovs(device, larger), aovs_out=outs,
            )  # fmt: skip
            results.append(np.concatenate([pixels_of(device, each, 4) for each in (image, *outs)]))
        np.testing.assert_array_equal(results[0], results[1])


def test_aovs_in_a_buffer_are_those_of_arrays_bit_for_bit(device: Any, ours: Model) -> None:
    upscaler, arrays = Upscaler(ours, display_size=DISPLAY), make("taau")
    out = device.create_buffer(size=20 * DISPLAY[0] * DISPLAY[1], usage=8 | 4)
    for index in range(4):
        frame = noisy(index, 5)
        upscaler.step_textures(
            buffers_of(device, frame), jitter=frame.jitter, reset=frame.reset, render_size=RENDER,
            aovs=[buffer_of(device, frame.aovs)], aovs_out=[out],
        )  # fmt: skip
        found = np.frombuffer(device.queue.read_buffer(out), np.float32).reshape(*DISPLAY[::-1], 5)
        np.testing.assert_array_equal(found, aovs_of(arrays, frame))


def test_textures_and_arrays_share_one_history_of_aovs(device: Any, ours: Model) -> None:
    mixed, arrays, loaded = (Upscaler(ours, display_size=DISPLAY, validate="off") for _ in range(3))
    for index in range(3):
        wanted = aovs_of(arrays, noisy(index))
    stepped(device, mixed, noisy(0))
    aovs_of(mixed, noisy(1))
    loaded.load_state(mixed.save_state())
    for each in (mixed, loaded):
        assert np.abs(stepped(device, each, noisy(2)) - wanted).max() < 1e-3


def test_aovs_that_do_not_fit_are_refused_and_the_history_stays(device: Any, ours: Model) -> None:
    upscaler, other = (Upscaler(ours, display_size=DISPLAY, validate="off") for _ in range(2))
    for each in (upscaler, other):
        stepped(device, each, noisy(0))
    frame = noisy(1)
    images, aovs, outs = textures_of(device, frame), textures_of_aovs(device, frame), targets(device, 2)
    small = texture_of(device, np.zeros((3, 3, 4)), "rgba32float", 4)
    buffers = [buffer_of(device, frame.aovs)]

    def step(**given: Any) -> None:
        upscaler.step_textures(images, jitter=frame.jitter, **{"aovs": aovs, "aovs_out": outs, **given})

    with pytest.raises(FrameError, match="4 channels; want 8 channels as before, or a reset"):
        step(aovs=aovs[:1], aovs_out=outs[:1])
    with pytest.raises(FrameError, match="aovs is rgba32float"):
        step(aovs=[aovs[0], small])
    wrongs: list[dict[str, Any]] = [
        {"aovs_out": []},
        {"aovs": buffers},
        {"aovs": None},
        {"aovs_out": [small, small]},
    ]
    for wrong in wrongs:
        with pytest.raises(ArgumentError, match="aovs"):
            step(**wrong)
    taa = Upscaler(Model.load("taa", executor="gpu", device=device), display_size=DISPLAY)
    with pytest.raises(FrameError, match="depth"):
        taa.step_textures(
            {name: image for name, image in images.items() if name != "depth"},
            jitter=frame.jitter, aovs=aovs, aovs_out=outs,
        )  # fmt: skip
    found, wanted = (stepped(device, each, frame) for each in (upscaler, other))
    np.testing.assert_array_equal(found, wanted)
