"""Still tiles come to rest on the mean of their samples, and forget only what a disturbance disproves."""

from collections.abc import Iterable
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from supersampler import Frame, Model, Upscaler, halton_jitter
from supersampler.backends.cpu.layout import STATIC_TILE
from supersampler.backends.cpu.static_tiles import (
    PHASES,
)
from supersampler.backends.cpu.tile_state import (
    FADE_FRAMES,
    RESTING,
    SPARSE_FRAMES,
    TileState,
)
from supersampler.conventions import jitter_phase_count
from supersampler.frame import Float32, Size
from supersampler.history import StepResult
from supersampler.io.display import decibels, display_transform

RATIO = 1.5
RENDER: Size = (128, 64)
DISPLAY: Size = (192, 96)
PERIOD = jitter_phase_count(RATIO)
CENTER = (72, 36)
"""A sample in the inner tiles, four of 6 x 3, but near none of the others' samples."""


@pytest.fixture(scope="module")
def model() -> Model:
    return Model.load("taau", executor="cpu", threads=2)


def pattern(x: NDArray[np.floating], y: NDArray[np.floating], light: float = 1.0) -> Float32:
    """Colors at places in display pixels: finer than the samples of one frame resolve."""
    waves = np.sin(2.1 * x + 0.7 * y) + np.sin(0.4 * x - 1.9 * y) + 2.2
    color: Float32 = (light * waves[..., None] * [0.3, 0.2, 0.1]).astype(np.float32)
    return color


@cache
def truth(light: float = 1.0) -> Float32:
    """What a screen shows of means over display pixels."""
    places = (np.arange(8) + 0.5) / 8.0
    x, y = ((np.arange(n)[:, None] + places).reshape(-1) for n in DISPLAY)
    full = pattern(x[None], y[:, None], light)
    mean = full.reshape(DISPLAY[1], 8, DISPLAY[0], 8, 3).mean((1, 3))
    return display_transform(mean.astype(np.float32), 1.0)


def scene(
    index: int, *, jitter: tuple[float, float] | None = None, light: float = 1.0, motion: float = 0.0,
    size: Size = RENDER, **fields: object,
) -> Frame:  # fmt: skip
    jx, jy = halton_jitter(index, RATIO) if jitter is None else jitter
    (w, h), (rx, ry) = size, (DISPLAY[0] / size[0], DISPLAY[1] / size[1])
    x, y = (np.arange(w) + 0.5 + jx) * rx, (np.arange(h)[:, None] + 0.5 + jy) * ry
    return Frame(
        color=pattern(x, y, light),
        depth=np.full((h, w), 0.1, np.float32),
        motion=np.full((h, w, 2), motion, np.float32),
        jitter=(jx, jy),
        exposure=1.0,
        **fields,  # type: ignore[arg-type]
    )


def disturbed(frame: Frame, value: float, at: tuple[int, int] = CENTER) -> Frame:
    """The frame with one sample of this value."""
    color = np.array(frame.color)
    color[at[1], at[0]] = value
    return replace(frame, color=color)


def made(model: Model, **options: object) -> Upscaler:
    return Upscaler(model, display_size=DISPLAY, validate="off", **options)  # type: ignore[arg-type]


def run(upscaler: Upscaler, frames: Iterable[Frame]) -> list[Float32]:
    return [upscaler.step(frame).copy() for frame in frames]


def rested(model: Model) -> tuple[Upscaler, int, Float32]:
    """An upscaler in which the scene rests, the next frame's number, and the image."""
    upscaler = made(model)
    images = run(upscaler, map(scene, range(3 * PERIOD)))
    assert upscaler.stats.converged == 1.0
    return upscaler, 3 * PERIOD, images[-1]


def state_of(upscaler: Upscaler) -> TileState:
    history = upscaler._memory.history
    assert history is not None
    state: TileState = history.buffers.tile_state
    return state


def psnr(image: Float32, light: float = 1.0) -> float:
    return decibels(float(np.mean((display_transform(image, 1.0) - truth(light)) ** 2)))


def resumes_after(upscaler: Upscaler, index: int) -> int:
    """How many frames it takes until all rests again."""
    for count in range(1, 6 * PERIOD):
        upscaler.step(scene(index + count - 1))
        if upscaler.stats.converged == 1.0:
            return count
    raise AssertionError("never rests")


@pytest.mark.parametrize("ratio", [1.5, 2.0])
@pytest.mark.parametrize("start", [0, 6])
def test_a_still_scene_comes_to_rest_near_the_truth_without_a_worse_frame_or_a_pop(
    model: Model, ratio: float, start: int
) -> None:
    period, size = jitter_phase_count(ratio), (int(DISPLAY[0] / ratio), int(DISPLAY[1] / ratio))
    jitter = [halton_jitter(start + k, ratio) for k in range(3 * period)]
    images, alone = (
        run(made(model, skip=skip), (scene(0, jitter=place, size=size) for place in jitter))
        for skip in ("auto", "exact")
    )
    rest, own = psnr(images[-1]), [psnr(image) for image in alone]
    assert rest > 45.0
    assert rest > np.mean(own[-period:]) + 0.5
    assert np.ptp(images[-period:], axis=0).max() == 0.0
    assert all(psnr(image) > min(other, rest) - 0.1 for image, other in zip(images, own, strict=True))
    steps, own_steps = (
        np.abs(np.diff([display_transform(image, 1.0) for image in shown], axis=0))
        for shown in (images, alone)
    )
    assert steps[period:].mean((1, 2, 3)).max() < own_steps[period // 2 : period].mean((1, 2, 3)).max()
    assert steps[period:].max() < own_steps[period:].max()


def test_one_bad_sample_in_a_resting_tile_costs_what_it_reaches_and_no_sums(model: Model) -> None:
    for value in (np.nan, 900.0):
        upscaler, index, image = rested(model)
        result = upscaler.step(disturbed(scene(index), value), outputs=("work",))
        assert isinstance(result, StepResult)
        assert result.work is not None
        assert 0.0 < (result.work == 1.0).mean() < 0.7
        assert np.isfinite(result.image).all()
        assert resumes_after(upscaler, index + 1) <= FADE_FRAMES + 3
        assert np.array_equal(upscaler.step(scene(index + 100)), image)


@pytest.mark.parametrize("skipped", [2, 5])
def test_the_method_goes_on_from_the_mean_where_only_a_neighbour_of_a_tile_changed(
    model: Model, skipped: int
) -> None:
    upscaler, index, image = rested(model)
    run(upscaler, map(scene, range(index, index + skipped)))
    result = upscaler.step(disturbed(scene(index + skipped), 900.0), outputs=("work",))
    assert isinstance(result, StepResult)
    states = state_of(upscaler).records["state"]
    y, x = (np.abs(np.arange(n) - at * RATIO) for n, at in zip(DISPLAY[::-1], CENTER[::-1], strict=True))
    near = np.maximum(y[:, None], x) < 9.0  # what the firefly itself opens
    again = np.kron(states != RESTING, np.ones((STATIC_TILE, STATIC_TILE), bool)) & ~near
    assert again.sum() > 100
    change = np.abs(display_transform(result.image, 1.0) - display_transform(image, 1.0))[again]
    assert change.mean() < 0.3 / 255.0
    assert change.max() < 3.0 / 255.0
    assert psnr(result.image) > psnr(image) - 0.5


def test_nothing_pops_beside_what_moves_past_a_resting_tile(model: Model) -> None:
    upscaler, index, image = rested(model)
    before = display_transform(image, 1.0)
    for k in range(2, 8):
        frame = scene(index + k)
        motion, color = np.array(frame.motion), np.array(frame.color)
        motion[16:32, 24 + k : 40 + k], color[16:32, 24 + k : 40 + k] = 0.5, 3.0
        after = display_transform(upscaler.step(replace(frame, motion=motion, color=color)), 1.0)
    again = np.kron(state_of(upscaler).records["state"] != RESTING, np.ones((STATIC_TILE, STATIC_TILE), bool))
    again[22:50, 30:74] = False  # what the mover reaches
    assert again.sum() > 50
    change = np.abs(after - before)[again]
    assert change.mean() < 0.5 / 255.0
    assert change.max() < 4.0 / 255.0


def test_a_firefly_while_tiles_settle_restarts_only_the_tiles_that_it_reaches(model: Model) -> None:
    upscaler = made(model)
    run(upscaler, map(scene, range(PERIOD + 6)))
    before = state_of(upscaler).records["fade"].copy()
    upscaler.step(disturbed(scene(PERIOD + 6), 900.0))
    fade = state_of(upscaler).records["fade"]
    assert (fade > before).any()
    assert (fade == 0.0).any()
    run(upscaler, (scene(PERIOD + 7 + k) for k in range(3 * PERIOD)))
    assert upscaler.stats.converged == 1.0


def test_a_sample_that_is_never_a_number_is_left_out_of_the_mean(model: Model) -> None:
    upscaler = made(model)
    frames = [disturbed(scene(k), np.nan) if k % PERIOD == 3 else scene(k) for k in range(3 * PERIOD)]
    image = run(upscaler, frames)[-1]
    assert upscaler.stats.converged == 1.0
    assert psnr(image) > psnr(rested(model)[2]) - 1.0


def test_what_moves_past_leaves_the_sums_of_what_it_hid(model: Model) -> None:
    upscaler, index, image = rested(model)
    for k in range(5):
        frame = scene(index + k)
        motion, color = np.array(frame.motion), np.array(frame.color)
        motion[20:40, 20:60], color[20:40, 20:60] = 0.5, 3.0
        upscaler.step(replace(frame, motion=motion, color=color))
    assert 0.0 < (upscaler.stats.converged or 0.0) < 1.0
    assert resumes_after(upscaler, index + 5) <= FADE_FRAMES + 3
    assert np.array_equal(upscaler.step(scene(index + 100)), image)


def test_another_light_is_seen_as_soon_as_by_the_method_and_rests_after_a_period_of_it(model: Model) -> None:
    upscaler, index, before = rested(model)
    alone = made(model, skip="exact")
    run(alone, map(scene, range(index)))
    frames = [scene(index + k, light=1.5) for k in range(3 * PERIOD)]
    images, own = run(upscaler, frames), run(alone, frames)
    assert upscaler.stats.work >= PERIOD
    assert all(psnr(a, 1.5) > psnr(b, 1.5) - 0.5 for a, b in zip(images, own, strict=True))
    assert upscaler.stats.converged == 1.0
    assert psnr(images[-1], 1.5) > psnr(before) - 1.5


def test_a_light_that_blinks_in_the_first_period_leaves_no_trace(model: Model) -> None:
    upscaler = made(model)
    images = run(upscaler, (scene(k, light=2.0 if 4 <= k < 10 else 1.0) for k in range(5 * PERIOD)))
    assert upscaler.stats.converged == 1.0
    assert psnr(images[-1]) > psnr(rested(model)[2]) - 0.1


@pytest.mark.parametrize("change", ["reset", "size"])
def test_after_a_reset_or_another_size_the_scene_comes_to_rest_again(model: Model, change: str) -> None:
    upscaler, index, image = rested(model)
    size = (112, 56) if change == "size" else RENDER
    frames = (scene(index + k, size=size, reset=change == "reset" and k == 0) for k in range(4 * PERIOD))
    work = upscaler.stats.work
    again = run(upscaler, frames)[-1]
    assert upscaler.stats.work >= work + PERIOD
    assert upscaler.stats.converged == 1.0
    assert psnr(again) > min(psnr(image) - 0.1, 43.0)


@pytest.mark.parametrize("skip", ["auto", "accumulate"])
def test_a_size_that_changes_in_every_frame_is_as_good_as_the_method_alone(model: Model, skip: str) -> None:
    """Dynamic resolution in front of a still camera."""
    one, alone = made(model, skip=skip), made(model, skip="exact")
    run(one, map(scene, range(PERIOD + 8)))
    run(alone, map(scene, range(PERIOD + 8)))
    for k in range(3 * PERIOD):
        size = RENDER[0] - 16 + round(16 * np.sin(k / 3)), RENDER[1] - 8 + round(8 * np.sin(k / 3))
        frame = scene(PERIOD + 8 + k, size=size)
        assert psnr(one.step(frame)) > psnr(alone.step(frame)) - 0.1
    assert one.stats.converged == 0.0


def test_jitter_that_never_repeats_leaves_the_method_to_itself(model: Model) -> None:
    one, alone = made(model), made(model, skip="exact")
    for k in range(PHASES + 20):
        frame = scene(0, jitter=((k % 300) / 600.0, 0.25 - k / 2000.0))
        image, own = one.step(frame), alone.step(frame)
    assert one.stats.converged == 0.0
    assert one.stats.work == PHASES + 20
    assert np.array_equal(image, own)


def test_without_jitter_tiles_rest_on_the_methods_image(model: Model) -> None:
    one, alone = made(model), made(model, skip="exact")
    for _ in range(SPARSE_FRAMES + 4):
        frame = scene(0, jitter=(0.0, 0.0))
        image, own = one.step(frame), alone.step(frame)
    assert one.stats.converged == 1.0
    np.testing.assert_allclose(image, own, atol=2e-3)


def test_a_sequence_of_the_callers_own_is_learned_and_rests_one_period_later(model: Model) -> None:
    own = [(x / 4.0 - 0.375, y / 4.0 - 0.375) for y in range(4) for x in range(4)]
    upscaler = made(model)
    images = run(upscaler, (scene(k, jitter=own[k % 16]) for k in range(5 * 16)))
    assert upscaler.stats.converged == 1.0
    assert psnr(images[-1]) > 38.0


def test_noise_that_is_new_in_each_frame_adds_to_no_sums_for_long(model: Model) -> None:
    rng, upscaler = np.random.default_rng(3), made(model)
    for k in range(2 * PERIOD):
        frame = scene(k)
        color = np.array(frame.color) + rng.random(frame.depth.shape, np.float32)[..., None]
        upscaler.step(replace(frame, color=color))
    assert not state_of(upscaler).records["count"].any()
    assert state_of(upscaler).records["failed"].all()
    assert upscaler.stats.work == 2 * PERIOD


@pytest.mark.parametrize("index", [PERIOD // 2, PERIOD + 1, PERIOD + PERIOD // 2, 2 * PERIOD + 1])
def test_a_state_of_any_moment_continues_bit_for_bit(model: Model, index: int) -> None:
    one, other = made(model), made(model)
    run(one, map(scene, range(index)))
    other.load_state(one.save_state())
    for k in range(index, index + PERIOD + 4):
        frame = disturbed(scene(k), 50.0) if k == index + 3 else scene(k)
        assert np.array_equal(one.step(frame), other.step(frame))
        assert one.stats.converged == other.stats.converged


def test_the_order_of_phases_and_repeated_frames_do_not_matter(model: Model) -> None:
    rng, upscaler = np.random.default_rng(4), made(model)
    order = [*range(PERIOD), *rng.permutation(PERIOD).tolist(), *([5] * 4)]
    images = run(upscaler, map(scene, [*order, *range(2 * PERIOD)]))
    assert psnr(images[-1]) > psnr(rested(model)[2]) - 0.1
