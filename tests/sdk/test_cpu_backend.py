"""The CPU backend computes what the ONNX backend computes."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from cpu_models import cpu_model
from extrapolated_noise import spoilt
from method_lists import WITH_KERNELS as METHODS
from noise import Size, noise
from rest_scenes import RestScene, wave
from shared_models import shared_model
from supersampler import ArgumentError, Frame, Model, Upscaler
from supersampler.arguments import ExecutorName
from supersampler.backends.cpu.library import encode_rgba
from supersampler.frame import Float32
from supersampler.io.display import auto_exposure, display_transform
from supersampler.methods.registry import methods
from supersampler_bench.stress.scenes import still

Models = dict[tuple[str, str], Model]
EXECUTORS: tuple[ExecutorName, ...] = ("onnx", "cpu")
SIZES = [
    ((32, 18), (64, 36)), ((33, 17), (50, 26)), ((61, 35), (61, 35)), ((21, 13), (63, 39)),
    ((5, 40), (11, 93)), ((1, 1), (2, 2)),
]  # fmt: skip
BYTES, LARGE, ROUNDING = (3e-3, 0.03), (3.3e-3, 0.03), (1e-5, 1e-3)
"""Mean difference, and that at 99 % of the pixels, of images in [0, 1]: with an int8 network, with one whose
history is larger, without."""
WITH_EXPOSURE = [method for method in METHODS if "exposure" in methods()[method].history]
NETWORKS = {"classifier": BYTES, "classifier-small": BYTES, "classifier-large": LARGE}
BRIGHT = (2e-5, 1e-3)
"""Without a network, where light is beyond half floats: toned, it is a few steps of rounding below 1."""


@pytest.fixture(scope="module")
def models() -> Models:
    return {(m, e): shared_model(m, threads=2, executor=e) for m in METHODS for e in EXECUTORS}


def pair_of(models: Models, method: str, display: Size = (64, 36)) -> list[Upscaler]:
    return [Upscaler(models[method, name], display_size=display, validate="off") for name in EXECUTORS]


def step_both(models: Models, method: str, frames: list[Frame], display: Size) -> list[list[Any]]:
    pair = pair_of(models, method, display)
    return [[upscaler.step(frame, outputs=("weight",)) for upscaler in pair] for frame in frames]


def history_of(upscaler: Upscaler) -> Mapping[str, Any]:
    return upscaler.save_state().history or {}


def compare(one: Float32, other: Float32, method: str, rounding: tuple[float, float] = ROUNDING) -> None:
    off = np.abs(display_transform(one) - display_transform(other))
    mean, most = NETWORKS.get(method, rounding)
    assert off.mean() <= mean
    assert np.quantile(off, 0.99) <= most


def hostile(render: Size) -> list[Frame]:
    """Make noisy frames, one with missing, negative and infinite samples, another with a reactive mask."""
    frames = [noise(index, render) for index in range(5)]
    color, depth, motion = (np.array(a) for a in (frames[1].color, frames[1].depth, frames[1].motion))
    if render[1] > 9:
        color[2:5], color[6], color[7], color[8], color[1, 1] = np.nan, np.inf, -1.0, 1e6, np.nan
        depth[3], depth[4], depth[5] = np.nan, -1.0, np.inf
        motion[0], motion[1] = np.nan, np.inf
    mask = np.linspace(0.0, 1.0, depth.size, dtype=np.float32).reshape(depth.shape)
    frames[1] = replace(frames[1], color=color, depth=depth, motion=motion)
    frames[3] = replace(frames[3], reactive=mask)
    return frames


@pytest.mark.parametrize("value", [0.5, 0.7, 1.0])
def test_frames_after_a_title_card_of_one_colour_are_alike(models: Models, value: float) -> None:
    """Rounding does not decide whether the light of the first frame after the card is a flash."""
    frames = [noise(index, exposure=1.0) for index in range(6)]
    frames[:3] = [replace(frame, color=np.full_like(frame.color, value)) for frame in frames[:3]]
    for ours, theirs in step_both(models, "taau", frames, (64, 36)):
        compare(ours.image, theirs.image, "taau")


@pytest.mark.parametrize("instructions", ["", "avx2", "portable"])
@pytest.mark.parametrize("method", ["bilinear", "bicubic", *METHODS])
def test_every_instruction_set_computes_what_the_onnx_backend_computes(
    method: str, instructions: str
) -> None:
    kernels = cpu_model(method, threads=2, instructions=instructions)
    outputs = ("weight",) if method in METHODS else ()
    for render, display in SIZES:
        if method == "classifier-large" and 2 * render[1] < display[1]:
            continue
        ours, theirs = (
            Upscaler(model, display_size=display, validate="off")
            for model in (kernels, shared_model(method, "onnx"))
        )
        for frame in map(noise, range(4), [render] * 4) if method in NETWORKS else hostile(render):
            results: list[Any] = [upscaler.step(frame, outputs=outputs) for upscaler in (ours, theirs)]
            one, other = results
            if outputs:
                assert np.abs(one.weight - other.weight).mean() <= 0.05
                one, other = one.image, other.image
            compare(one, other, method)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("bad", [np.nan, np.inf, -1.0, 1e30, 1e-42])
def test_hostile_pixels_are_alike_on_both(models: Models, method: str, bad: float) -> None:
    frames = [noise(seed) for seed in range(5)]
    spots = np.random.default_rng(0).random((18, 32)) < 0.05
    fields = {n: spoilt(getattr(frames[2], n), spots, bad) for n in ("color", "depth", "motion")}
    frames[2] = replace(frames[2], **fields)  # type: ignore[arg-type]
    for one, other in step_both(models, method, frames, (64, 36)):
        assert np.isfinite(other.image).all()
        assert other.image.min() >= 0
        compare(one.image, other.image, method, BRIGHT if bad > 1e4 else ROUNDING)


def test_what_stands_still_converges_on_both(models: Models) -> None:
    scene = RestScene(wave, mover=True, render=(40, 24))
    one, other = pair_of(models, "taau", scene.display)
    for frame, _ in scene.frames(75):
        compare(one.step(frame), other.step(frame), "taau", (1e-4, 6e-3))
    ages = [history_of(upscaler)["history.static_blocks"][0, 0] for upscaler in (one, other)]
    assert (ages[0] < 0.0).any()
    np.testing.assert_array_equal(ages[0] < 0.0, ages[1] < 0.0)


def test_a_frame_that_is_a_flash_does_the_same_on_both(models: Models) -> None:
    frames = [replace(frame, exposure=1.0) for frame in still((32, 18))[:8]]
    for index in (4, 5):
        spots = np.random.default_rng(index).random((18, 32)) < 0.1
        frames[index] = replace(frames[index], color=spoilt(frames[index].color, spots, 100.0))
    upscalers, flashes = pair_of(models, "taau"), []
    for frame in frames:
        one, other = (upscaler.step(frame) for upscaler in upscalers)
        compare(one, other, "taau")
        light, same = (history_of(upscaler)["history.light"] for upscaler in upscalers)
        np.testing.assert_allclose(light, same, rtol=1e-4)
        flashes.append(light[0, 3])
    assert flashes == [0, 0, 0, 0, 1, 2, 0, 0]


def test_taa_keeps_its_history_where_a_sample_is_not_usable(models: Models) -> None:
    frames = list(still((32, 18))[:8])
    rows = np.zeros((18, 32), bool)
    rows[9] = True
    bad = replace(frames[6], color=spoilt(frames[6].color, rows, np.nan))
    for upscaler in pair_of(models, "taa"):
        for frame in frames[:6]:
            before = upscaler.step(frame)
        kept = np.abs(upscaler.step(bad) - before).max(axis=(1, 2)) < 1e-5
        assert kept[18:20].all(), "the row itself"
        assert not kept[:14].any()
        assert not kept[24:].any()
        alone = upscaler.step(replace(bad, reset=True))[18:20]
        assert alone.min() > 0.5 * np.asarray(frames[6].color).min(), "what is near, without a history"


@pytest.mark.parametrize("method", ["classifier", "classifier-small"])
def test_sparse_flashes_are_not_accumulated(models: Models, method: str) -> None:
    frames = [replace(frame, exposure=1.0) for frame in still((32, 18))[:10]]
    spots = np.random.default_rng(0).random((18, 32)) < 0.1
    for index in (6, 7):
        frames[index] = replace(frames[index], color=spoilt(frames[index].color, spots, 10.0))
    restarted = []
    for upscaler in pair_of(models, method):
        counts = []
        for frame in frames:
            upscaler.step(frame)
            counts.append(history_of(upscaler)["history.state"][0, 0] == 0.0)
        restarted.append(np.stack(counts))
    one, other = restarted
    assert (one == other).mean() > 0.995
    assert (one[6:8].mean(axis=(1, 2)) > 0.05).all()
    assert not one[:6].any()
    assert not one[8:].any()


def test_a_frame_of_outlying_exposure_is_not_accumulated(models: Models) -> None:
    frames = [replace(frame, exposure=None) for frame in still((32, 18))[:5]]
    frames[3] = replace(frames[3], color=np.full((18, 32, 3), 300.0, np.float32))
    for upscaler in pair_of(models, "classifier"):
        counts = []
        for frame in frames:
            image = upscaler.step(frame)
            counts.append(history_of(upscaler)["history.state"][0, 0])
            if frame is frames[3]:
                assert display_transform(image).min() > 0.9, "it is shown"
        assert counts[2].min() > 0.0
        assert counts[3].max() == 0.0
        assert counts[4].min() > 0.0


@pytest.mark.parametrize("method", WITH_EXPOSURE)
def test_black_around_a_picture_does_not_change_the_measured_exposure(models: Models, method: str) -> None:
    color = np.array(noise(0).color)
    color[:, 5:] = 0.0
    frames = [replace(noise(0), color=each, exposure=None, reset=False) for each in (color, 0.0 * color)]
    for upscaler in pair_of(models, method):
        for frame in frames:  # the second one is black
            upscaler.step(frame)
            (exposure,) = history_of(upscaler)["history.exposure"]
            assert abs(exposure) == pytest.approx(auto_exposure(color[:, :5]), rel=1e-4)


@pytest.mark.parametrize("method", METHODS)
def test_a_state_goes_from_one_backend_to_the_other(models: Models, method: str) -> None:
    one, other = pair_of(models, method)
    for seed in range(3):
        one.step(noise(seed))
    other.load_state(one.save_state())
    compare(one.step(noise(3)), other.step(noise(3)), method)
    one.load_state(other.save_state())
    compare(one.step(noise(4)), other.step(noise(4)), method)


@pytest.mark.parametrize("method", ["taau", "classifier", "classifier-small"])
def test_a_state_holds_what_the_history_knows_of_glaring_light(models: Models, method: str) -> None:
    frames = [replace(frame, exposure=1.0) for frame in still((32, 18))[:12]]
    spots = np.random.default_rng(0).random((18, 32)) < 0.1
    for index, light in ((6, 5000.0), (7, 500.0)):
        frames[index] = replace(frames[index], color=spoilt(frames[index].color, spots, light))
    for index in range(7, 12):  # counts of glaring frames are interpolated
        frames[index] = replace(frames[index], motion=np.full((18, 32, 2), 0.4, np.float32))
    onnx, upscaler = pair_of(models, method)
    for frame in frames:
        loaded = pair_of(models, method)[1]
        loaded.load_state(upscaler.save_state())
        image = upscaler.step(frame)
        np.testing.assert_array_equal(loaded.step(frame), image)
        if method == "taau":  # int8 differs more where light glares
            compare(onnx.step(frame), image, method, BRIGHT)


@pytest.mark.parametrize(
    ("method", "asked", "found"),
    [
        *((method, {}, ("cpu", "int8" if "classifier" in method else "fp32")) for method in METHODS),
        ("gbuffer-small", {}, ("onnx", "fp32")),
        ("classifier", {"precision": "fp32"}, ("onnx", "fp32")),
        ("classifier", {"precision": "fp16"}, ("onnx", "fp16")),
    ],
)
def test_a_cpu_runs_kernels_where_there_are_some_and_a_network_in_int8(
    method: str, asked: dict[str, Any], found: tuple[str, str]
) -> None:
    model = Model.load(method, **asked)
    assert (model.executor, model.precision) == found


@pytest.mark.parametrize(
    ("method", "asked"),
    [
        ("gbuffer-small", {"executor": "cpu"}),
        ("taau", {"precision": "int8"}),
        ("taau", {"precision": "fp16"}),
        ("classifier", {"executor": "cpu", "precision": "fp16"}),
        ("classifier", {"executor": "onnx", "precision": "int8"}),
    ],
)
def test_what_a_model_cannot_do_is_refused(method: str, asked: dict[str, Any]) -> None:
    with pytest.raises(ArgumentError, match="executor"):
        Model.load(method, **asked)


# --- images for OpenGL ---


@pytest.mark.parametrize("size", [(1, 1), (2, 2), (5, 3), (6, 3), (7, 2), (9, 4), (17, 3), (1030, 2)])
def test_an_image_becomes_opaque_bytes_from_the_bottom_row_up(size: tuple[int, int]) -> None:
    width, height = size
    image = np.random.default_rng(4).uniform(-0.2, 1.4, (height, width, 3)).astype(np.float32)
    for given in (image, np.asfortranarray(image)):
        pixels = np.zeros((height, width), np.int32)
        encode_rgba(given, pixels)
        channels = pixels.view(np.uint8).reshape(height, width, 4)
        expected = np.floor(image.clip(0, 1)[::-1] * np.float32(255) + 0.5)
        np.testing.assert_array_equal(channels[..., :3], expected)
        assert (channels[..., 3] == 255).all()
