"""The reactive mask: the weight w of a frame becomes w + (1 - w) reactive; without one nothing differs."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from method_backends import BACKENDS, RENDER, display_of, frame_for, make
from noise import noise
from supersampler import Frame, FrameError, StepResult, Upscaler, halton_jitter
from supersampler.conventions import jitter_phase_count
from supersampler.frame import Float32, Size
from supersampler.io.display import display_transform

TEMPORAL = [(method, kind) for method, kind in BACKENDS if method not in ("bilinear", "bicubic")]
WEIGHED = [(method, kind) for method, kind in TEMPORAL if not method.startswith("gbuffer-small")]
"""Methods with the map `weight`."""
CONVERGING = [(method, kind) for method, kind in WEIGHED if method not in ("taa", "extrapolate")]
PLACED = [(method, kind) for method, kind in TEMPORAL if method != "classifier-large"]
"""Methods whose image is not downsampled from a larger one."""
W, H = RENDER
PERIOD = jitter_phase_count(2.0)  # of the jitter of what stands still


def mask(value: float = 1.0) -> Float32:
    return np.full((H, W), value, np.float32)


def stepped(upscaler: Upscaler, index: int, reactive: Float32 | None = None) -> StepResult:
    frame = replace(frame_for(upscaler, index, exposure=1.0), reactive=reactive)
    result = upscaler.step(frame, outputs=("weight",))
    assert isinstance(result, StepResult)
    return result


def begun(method: str, executor: str) -> Upscaler:
    """An Upscaler after four frames without a mask."""
    upscaler = make(method, executor)
    for index in range(4):
        upscaler.step(frame_for(upscaler, index, exposure=1.0))
    return upscaler


def at_pixels(image: Float32, jitter: tuple[float, float], display: Size) -> NDArray[Any]:
    """Return the nearest sample of each display pixel."""
    columns, rows = (
        np.clip(np.floor((np.arange(big) + 0.5) * small / big - offset), 0, small - 1).astype(int)
        for big, small, offset in zip(display, RENDER, jitter, strict=True)
    )
    return np.asarray(image[rows[:, None], columns])


@pytest.mark.parametrize(("method", "executor"), BACKENDS)
def test_a_mask_of_zeros_changes_no_bit(method: str, executor: str) -> None:
    ours, theirs = make(method, executor), make(method, executor)
    for index in range(4):
        frame = frame_for(ours, index)
        image = ours.step(replace(frame, reactive=mask(0.0)))
        np.testing.assert_array_equal(image, theirs.step(frame))


@pytest.mark.parametrize(("method", "executor"), WEIGHED)
@settings(max_examples=5, deadline=None)
@given(value=st.floats(0.0, 1.0, width=16))
def test_the_weight_of_the_history_is_what_the_mask_leaves(method: str, executor: str, value: float) -> None:
    plain: Any = stepped(begun(method, executor), 4)
    masked: Any = stepped(begun(method, executor), 4, mask(value))
    assert plain.weight.max() > 0.2
    np.testing.assert_allclose(masked.weight, (1.0 - value) * plain.weight, rtol=2e-4, atol=1e-6)


@pytest.mark.parametrize(("method", "executor"), PLACED)
def test_a_mask_acts_only_at_its_own_samples(method: str, executor: str) -> None:
    """Half of the frame is masked: a pixel whose nearest sample is not is what it was, bit for bit."""
    half = mask()
    half[:, W // 2 :] = 0.0
    plain, masked = begun(method, executor), begun(method, executor)
    frame = frame_for(plain, 4, exposure=1.0)
    before = np.asarray(plain.step(frame))
    after = np.asarray(masked.step(replace(frame, reactive=half)))
    there = at_pixels(half, frame.jitter, display_of(method)) > 0.0
    np.testing.assert_array_equal(after[~there], before[~there])
    assert (np.abs(after[there] - before[there]).max(axis=-1) > 0.0).mean() > 0.5


@pytest.mark.parametrize(("method", "executor"), WEIGHED)
def test_a_fully_reactive_mask_removes_the_history(method: str, executor: str) -> None:
    images = []
    for light in (0.0, 50.0):
        upscaler = make(method, executor)
        frame = frame_for(upscaler, 0, exposure=1.0)
        dark = np.full((H, W, 3), light, np.float32)
        upscaler.step(replace(frame, color=dark))
        upscaler.step(replace(frame, color=dark, reset=False))
        images.append(stepped(upscaler, 4, mask()).image)
    off = np.abs(display_transform(images[0]) - display_transform(images[1]))
    # A network sees the history, and weighs the samples of this frame by it.
    assert off.max() < 1e-4 if method in ("taa", "taau") else off.mean() < 0.05


@pytest.mark.parametrize(("method", "executor"), PLACED)
def test_a_missing_sample_shows_the_history_under_any_mask(method: str, executor: str) -> None:
    plain, masked = begun(method, executor), begun(method, executor)
    frame = frame_for(plain, 4, exposure=1.0)
    color = np.full((H, W, 3), np.nan, np.float32)
    color[: H // 2] = np.asarray(frame.color)[: H // 2]
    frame = replace(frame, color=color)
    before, after = plain.step(frame), masked.step(replace(frame, reactive=mask()))
    there = at_pixels(np.isnan(color[..., 0]), frame.jitter, display_of(method))
    np.testing.assert_array_equal(np.asarray(after)[there], np.asarray(before)[there])


def at_rest(upscaler: Upscaler) -> Any:
    """Step through two periods of what stands still, and one frame more."""
    for index in range(2 * PERIOD + 1):
        result: Any = upscaler.step(still(upscaler, index), outputs=("converged",))
    assert result.converged.mean() > 0.9
    return result


@pytest.mark.parametrize(("method", "executor"), CONVERGING)
def test_at_rest_any_value_over_zero_ends_what_is_frozen_around_it(method: str, executor: str) -> None:
    upscaler, corner = make(method, executor), mask(0.0)
    corner[0, 0] = 1e-3
    before = at_rest(upscaler)
    frame = replace(still(upscaler, 2 * PERIOD + 1), reactive=corner)
    after: Any = upscaler.step(frame, outputs=("converged",))
    assert after.converged[:15, :15].max() == 0.0  # of its block and the next ones, of four samples each
    np.testing.assert_array_equal(after.converged[:, 17:], before.converged[:, 17:])
    kept = after.converged > 0.0
    np.testing.assert_array_equal(after.image[kept], before.image[kept])


@pytest.mark.parametrize("method", sorted({method for method, kind in CONVERGING if kind == "cpu"}))
def test_no_tile_of_a_masked_frame_is_a_copy(method: str) -> None:
    ours, theirs = make(method, "cpu"), make(method, "cpu", skip=False)
    at_rest(ours)
    before = at_rest(theirs)
    frame = replace(still(ours, 2 * PERIOD + 1), reactive=mask())
    image = ours.step(frame)
    np.testing.assert_array_equal(image, theirs.step(frame))
    assert (np.abs(image - before.image).max(axis=-1) > 0.0).mean() > 0.9


def still(upscaler: Upscaler, index: int) -> Frame:
    """A frame of fine stripes that stand still, of even light."""
    jitter = halton_jitter(index, 2.0)
    x, y = np.arange(W) + 0.5 + jitter[0], np.arange(H)[:, None] + 0.5 + jitter[1]
    light = 0.5 + 0.1 * np.sin(1.1 * x + 0.7 * y)
    color = light[..., None].repeat(3, -1).astype(np.float32)
    zeros = np.zeros((H, W, 2), np.float32)
    frame = frame_for(upscaler, 0, exposure=1.0)
    return replace(frame, color=color, motion=zeros, depth=mask(0.1), jitter=jitter, reset=index == 0)


@pytest.mark.parametrize("method", sorted({method for method, kind in TEMPORAL if kind == "cpu"}))
def test_the_cpu_backend_treats_a_mask_as_the_graph_does(method: str) -> None:
    """At odd sizes, with pre-exposure: mean, 99.9 % quantile and largest difference of display values."""
    exact = method in ("taa", "taau")
    backends, off = (make(method, "cpu"), make(method, "onnx")), []
    for index in range(8):
        random = np.random.default_rng(index)
        frame = frame_for(backends[0], index, exposure=1.0, pre_exposure=1.7)
        frame = replace(frame, reactive=random.random((H, W), np.float32).round(1))
        ours, theirs = (np.asarray(each.step(frame)) for each in backends)
        off.append(np.abs(display_transform(ours) - display_transform(theirs)))
    differences = np.stack(off)
    assert differences.mean() < (1e-5 if exact else 4e-3)
    assert np.quantile(differences, 0.999) < (1e-3 if exact else 0.04)
    assert differences.max() < (0.01 if exact else 0.1)


@pytest.mark.parametrize(
    ("bad", "message"),
    [
        (np.zeros((H + 1, W), np.float32), r"\(14, 17\) float32; want \(13, 17\) float16 or float32"),
        (np.zeros((H, W, 1), np.float32), r"Drop the last axis: array\[..., 0\]"),
        (np.zeros((H, W), np.uint8), r"uint8; want .* Scale integers to the range"),
        (np.ones((H, W), bool), r"bool; want .* Convert it: array.astype\(np.float32\)\.$"),
        (mask(1.5), r"from 1.5 to 1.5; want values in \[0, 1\]. 0 keeps the history"),
        (mask(-0.1), r"from -0.1 to -0.1; want values in \[0, 1\]"),
        (mask(np.nan), r"from nan to nan; want values in \[0, 1\]"),
        ("x", "is str; want a numpy array"),
    ],
)
def test_another_mask_is_refused_and_the_history_is_as_it_was(bad: Any, message: str) -> None:
    ours, theirs = make("taau", "cpu"), make("taau", "cpu")
    for upscaler in (ours, theirs):
        upscaler.step(noise(0, RENDER))
    with pytest.raises(FrameError, match=rf"frame\.reactive .*{message}"):
        ours.step(noise(1, RENDER, reactive=bad))
    np.testing.assert_array_equal(ours.step(noise(1, RENDER)), theirs.step(noise(1, RENDER)))


def test_half_floats_are_taken() -> None:
    first, second = (make("taau", "onnx") for _ in range(2))
    for index in range(3):
        frame = noise(index, RENDER, exposure=1.0, reactive=mask(0.25))
        image = first.step(frame)
        half = replace(frame, reactive=mask(0.25).astype(np.float16))
        np.testing.assert_array_equal(second.step(half), image)
