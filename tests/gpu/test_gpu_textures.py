"""Frames and images on the caller's device: textures and buffers in and out, without a copy."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from gpu_steps import DISPLAY, RENDER, device_or_skip, make, moving
from supersampler import Upscaler
from supersampler.errors import ArgumentError, FrameError
from supersampler.model import Model
from texture_frames import (
    COPY_DST,
    SAMPLED,
    STORAGE,
    STORED,
    buffers_of,
    pixels_of,
    texture_of,
    textures_of,
)


@pytest.fixture(scope="module")
def device() -> Any:
    """A device of the caller."""
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
    for wrong in (depths, foreign, small, unusable, None):
        with pytest.raises(FrameError, match="depth"):
            upscaler.step_textures({**good, "depth": wrong}, jitter=(0.0, 0.0))
    with pytest.raises(FrameError, match="render_size"):
        upscaler.step_textures(buffers_of(device, moving(1)), jitter=(0.0, 0.0))
    target = device.create_texture(size=(*DISPLAY, 1), format="rgba8unorm", usage=STORED)
    with pytest.raises(ArgumentError, match="rgba16float"):
        upscaler.step_textures(good, jitter=(0.0, 0.0), out=target)
    foreign_encoder = device_or_skip().create_command_encoder()
    for encoder in (None, 1, device, foreign_encoder):
        with pytest.raises(ArgumentError, match="encoder is"):
            upscaler.encode_into(encoder, good, jitter=(0.0, 0.0))
    image, wanted = (one.step_textures(good, jitter=moving(1).jitter) for one in (upscaler, other))
    np.testing.assert_array_equal(pixels_of(device, image), pixels_of(device, wanted))


def test_other_backends_take_no_textures() -> None:
    device_or_skip()
    with pytest.raises(ArgumentError, match="textures"):
        make("taau", "cpu").step_textures({}, jitter=(0.0, 0.0))
