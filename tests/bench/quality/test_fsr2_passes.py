"""The passes of `fsr2-like`, one at a time: FSR2's formulas on small buffers whose results are known."""

import math
from typing import Any

import numpy as np
import pytest

from supersampler.frame import Array, Float32, Size
from supersampler_bench import fsr2
from supersampler_bench.fsr2 import (
    ColorBox,
    DepthClip,
    FrameBuffers,
    FrameSizes,
    Fsr2History,
    LockUpdate,
    Prepared,
    accumulate,
    aged,
    buffers_of,
    depth_clip,
    dilate,
    luma_instability,
    rectify,
    update_locks,
    upsample,
)
from supersampler_model.data.scenes.analytic import FAR, NEAR, DiscOverPlane

VIEW = FrameSizes((12, 10), (24, 20), (0.0, 0.0))


def flat(size: Size, *values: float) -> Float32:
    """Return an image of one value, or of one vector, (width, height) of `size`."""
    shape = (size[1], size[0], len(values)) if len(values) > 1 else (size[1], size[0])
    return np.full(shape, values if len(values) > 1 else values[0], np.float32)


# --- luminance pyramid ---


def test_log_luminance_is_that_of_pixel_centres() -> None:
    x, y = fsr2.centres((12, 10))
    sampled = np.repeat((11.0 + (x + 0.3) - 0.5 * (y - 0.2))[..., None], 3, axis=-1)
    logs = fsr2.log_luma(sampled, FrameSizes((12, 10), (24, 20), (0.3, -0.2)))
    np.testing.assert_allclose(logs[1:-1, 1:-1], np.log(11.0 + x - 0.5 * y)[1:-1, 1:-1], rtol=1e-5)


def test_the_luma_of_shading_is_the_sixth_root_of_exposed_luminance() -> None:
    shading = fsr2.shading_luma(flat((2, 1), math.log(0.4)), 3.0, VIEW)
    np.testing.assert_allclose(shading, flat((24, 20), 1.2 ** (1.0 / 6.0)), rtol=1e-5)


def test_the_grid_of_shading_has_whole_cells_of_32_pixels() -> None:
    logs = np.zeros((180, 320), np.float32)
    logs[32:64, 64:96] = 1.0
    grid = fsr2.shading_grid(logs)
    assert grid.shape == (5, 10)
    assert grid[1, 2] == grid.sum() == 1.0


def test_exposure_is_the_published_formula_and_follows_the_light_slowly() -> None:
    assert fsr2.auto_exposure(math.log(0.18)) == pytest.approx(1.0 / (9.6 * 0.18))
    logs = np.full((4, 4), 2.0, np.float32)
    assert fsr2.followed_average(logs, None, 0.1) == 2.0
    assert fsr2.followed_average(logs, 0.0, 0.1) == pytest.approx(2.0 * (1.0 - math.exp(-0.1)))


# --- reconstruct and dilate, depth clip ---


def test_dilation_takes_depth_and_motion_of_the_closest_neighbour() -> None:
    depth, motion = np.full((5, 6), FAR, np.float32), np.zeros((5, 6, 2), np.float32)
    depth[2, 3], motion[2, 3] = NEAR, (1.0, 0.0)
    dilated = dilate(depth, motion, FrameSizes((6, 5), (12, 10), (0.0, 0.0)))
    near = np.zeros((5, 6), bool)
    near[1:4, 2:5] = True
    assert ((dilated.depth == np.float32(NEAR)) == near).all()
    assert ((dilated.motion[..., 0] == 1.0) == near).all()
    moved = np.zeros((5, 6), bool)
    moved[1:4, 3:6] = True  # where those nine pixels were
    assert ((dilated.previous == np.float32(NEAR)) == moved).all()


def test_what_a_moving_disc_uncovers_is_marked_and_the_rest_is_not() -> None:
    scene = DiscOverPlane(velocity=(2.0, 0.0), background_velocity=(0.0, 0.0))
    frame, view = scene.frame(6, (64, 36)), FrameSizes((64, 36), (128, 72), (0.0, 0.0))
    inputs = buffers_of(frame)
    dilated = dilate(inputs.depth, inputs.motion, view)
    clip = depth_clip(inputs, dilated, view.of_image(dilated.motion), view).disoccluded
    uncovered = scene.disoccluded(6, (64, 36))
    assert clip[uncovered & (dilated.depth == np.float32(FAR))].mean() > 0.9
    assert (clip[~uncovered] > 0.5).mean() < 0.02  # beside the edge, which dilation moves by a pixel


def clip_of(depth: Array, motion: Array, previous_motion: Array) -> DepthClip:
    """Return the depth clip of a frame; motion in render pixels."""
    inputs = FrameBuffers(flat(VIEW.render, 0.5, 0.5, 0.5), depth, motion)
    return depth_clip(inputs, dilate(depth, motion, VIEW), VIEW.of_image(previous_motion), VIEW)


def test_a_floor_that_recedes_upwards_is_not_taken_for_uncovered() -> None:
    motion = flat(VIEW.render, 0.0, 0.5)
    nearer = 0.1 * 1.04 ** np.arange(10, dtype=np.float32)
    floor = np.repeat(nearer[:, None], 12, axis=1)
    assert clip_of(floor, motion, motion).disoccluded[2:-2].max() == 0.0
    assert clip_of(floor[::-1].copy(), motion, motion).disoccluded[2:-2].min() > 0.2


def test_the_mask_is_where_neighbours_move_apart() -> None:
    motion = flat(VIEW.render, 2.0, 0.0)
    assert clip_of(flat(VIEW.render, 0.1), motion, motion).mask.max() == 0.0
    motion[:, 6:] *= -1.0
    mask = clip_of(flat(VIEW.render, 0.1), motion, motion).mask
    assert (mask[:, 5:7] == 1.0).all()
    assert mask[:, :5].max() == mask[:, 7:].max() == 0.0


def test_the_mask_is_where_motion_sets_in_on_a_surface() -> None:
    fast, still = flat(VIEW.render, 10.0, 0.0), flat(VIEW.render, 0.0, 0.0)  # 20 display pixels
    surface = flat(VIEW.render, 0.1)
    assert (clip_of(surface, fast, still).mask[1:-1, 1:-1] == 1.0).all()
    assert clip_of(surface, fast, fast).mask.max() == 0.0
    assert clip_of(surface, 0.25 * fast, still).mask.max() < 0.02
    larger = depth_clip(
        FrameBuffers(flat(VIEW.render, 0.5, 0.5, 0.5), surface, fast),
        dilate(surface, fast, VIEW),
        flat((24, 7), 10.0 / 12.0, 0.0),  # the same motion at another render size
        VIEW,
    )
    assert larger.mask.max() < 1e-6
    surface[:, 6:] = 0.01
    edge = clip_of(surface, fast, still).mask[5, 1:-1]
    assert edge[0] == edge[-1] == 1.0
    assert edge.min() == pytest.approx(0.1, rel=1e-4)  # closest / farthest


# --- locks ---


@pytest.mark.parametrize(
    ("pattern", "is_thin"),
    [
        (["010", "010", "010"], True),
        (["001", "010", "100"], True),
        (["000", "010", "000"], True),
        (["101", "101", "101"], True),  # darker than both sides
        (["011", "011", "000"], False),  # two pixels wide
        (["110", "110", "110"], False),
        (["111", "111", "111"], False),
        (["020", "010", "000"], False),  # below one, above others
    ],
)
def test_ridges_of_one_pixel_are_thin_features(pattern: list[str], is_thin: bool) -> None:
    luma = np.array([[(0.3, 0.6, 0.9)[int(c)] for c in row] for row in pattern], np.float32)
    assert fsr2.thin_features(luma)[1, 1] == is_thin


def test_a_sample_lands_on_the_display_pixel_that_its_jitter_says() -> None:
    luma = np.full((5, 5), 0.2, np.float32)
    luma[2, 2] = 0.8
    for jitter, place in (((-0.4, -0.4), (4, 4)), ((0.4, -0.4), (4, 5)), ((-0.4, 0.4), (5, 4))):
        made = fsr2.new_locks(luma, FrameSizes((5, 5), (10, 10), jitter))
        assert np.argwhere(made).tolist() == [[*place]]


def updated(
    lifetime: float, luma: float, *, made: bool = False, mask: float = 0.0, clip: float = 0.0
) -> list[float]:
    """Return lifetime, luma, contribution and reactive factor of a lock, after a frame of shading 0.5."""
    one = np.ones((1, 1), np.float32)
    lock = np.array([[[lifetime, luma]]], np.float32)
    update = update_locks(lock, made * one > 0.0, 0.5 * one, 0.0 * one, mask * one, clip * one)
    return [float(v[0, 0]) for v in (update.lifetime, update.luma, update.contribution, update.reactive)]


def test_a_lock_holds_from_its_second_sample_on_until_the_shading_changes() -> None:
    assert updated(0.0, 0.0, made=True) == pytest.approx([1.0, 0.5, 0.0, 0.0])
    assert updated(0.7, 0.5, made=True) == pytest.approx([2.0, 0.5, 1.0, 0.0])
    assert updated(1.1, 0.5) == pytest.approx([1.1, 0.5, 0.4, 0.0])
    assert updated(0.7, 0.48) == pytest.approx([0.7, 0.49, 0.0, 0.0])  # follows the shading
    assert updated(1.9, 0.44)[0] == 0.0  # changed by more than a tenth
    assert updated(1.9, 0.44)[3] == pytest.approx(0.2)
    assert updated(2.0, 0.5, mask=0.25)[0] == pytest.approx(1.5)
    assert updated(2.0, 0.5, clip=0.2)[0] == 0.0


def test_a_lock_ages_by_one_in_a_jitter_period_and_ends_at_the_border() -> None:
    one = np.ones((1, 1), np.float32)
    update = LockUpdate(2.0 * one, 0.5 * one, one, one, one)
    average = np.full((1, 1), 0.74 / 12.0, np.float32)
    np.testing.assert_allclose(aged(update, 32.0 * average, one > 0.0, VIEW), [[[1.0, 0.5]]], rtol=1e-5)
    np.testing.assert_allclose(aged(update, 99.0 * average, one > 0.0, VIEW), [[[0.0, 0.5]]])
    np.testing.assert_allclose(aged(update, average, one < 0.0, VIEW), [[[0.0, 0.5]]])


# --- colour ---


def test_the_tone_curve_is_undone_up_to_the_largest_half_float() -> None:
    light = np.array([[0.1, 2.0, 30.0], [0.0, 0.0, 0.0]], np.float32)
    np.testing.assert_allclose(fsr2.inverse_tonemap(fsr2.tonemap(light)), light, rtol=1e-4)
    np.testing.assert_allclose(fsr2.inverse_tonemap(np.ones((1, 3), np.float32)), 65504.0)
    np.testing.assert_allclose(fsr2.from_ycocg(fsr2.to_ycocg(light)), light, rtol=1e-6)


# --- upsampling and sampling ---


def test_one_colour_stays_and_its_box_is_a_point() -> None:
    zero = flat(VIEW.display, 0.0)
    ycocg = flat(VIEW.render, 0.4, -0.1, 0.2)
    sizes = FrameSizes(VIEW.render, VIEW.display, (0.2, -0.4))
    color, _, box = upsample(ycocg, zero, zero, zero, sizes)
    wanted = flat(VIEW.display, 0.4, -0.1, 0.2)
    np.testing.assert_allclose(color, wanted, rtol=1e-5)
    np.testing.assert_allclose(box.centre, wanted, rtol=1e-5)
    assert box.deviation.max() < 1e-3


def test_a_kernel_without_history_reaches_every_pixel_and_counts_samples_on_screen_only() -> None:
    zero, one = flat(VIEW.display, 0.0), flat(VIEW.display, 1.0)
    ycocg = flat(VIEW.render, 0.4, 0.0, 0.0)
    (_, wide, _), (_, narrow, _) = (upsample(ycocg, new, zero, zero, VIEW) for new in (one, zero))
    assert wide.min() > 0.02
    assert wide[0, 0] == pytest.approx(_weight_of((0.25, 1.25), (0.25, 1.25)))
    assert wide[2, 2] == pytest.approx(_weight_of((0.25, 0.75, 1.25), (0.25, 0.75, 1.25)))
    assert narrow.max() < wide.max()


def _weight_of(dx: tuple[float, ...], dy: tuple[float, ...]) -> float:
    squares = np.array([x * x + y * y for x in dx for y in dy], np.float32)
    return float(fsr2.lanczos2_of_square(squares).sum() / 12.0)


def test_the_approximation_of_lanczos2_is_near_it() -> None:
    x = np.linspace(0.0, 2.5, 51, dtype=np.float32)
    exact = np.where(x < 2.0, np.sinc(x) * np.sinc(x / 2.0), 0.0)
    np.testing.assert_allclose(fsr2.lanczos2_of_square(x * x), exact, atol=0.06)


@pytest.mark.parametrize("sample", [fsr2.bilinear, fsr2.lanczos])
def test_reads_at_texel_centres_return_the_texels(sample: object) -> None:
    image = np.random.default_rng(0).uniform(size=(5, 7, 2)).astype(np.float32)
    assert callable(sample)
    np.testing.assert_allclose(sample(image, *fsr2.centres((7, 5))), image, atol=1e-6)


def test_lanczos_does_not_ring() -> None:
    step = np.repeat([[0.0, 0.0, 0.0, 1.0, 1.0, 1.0]], 4, axis=0).astype(np.float32)[..., None]
    x = np.linspace(0.5, 5.5, 41, dtype=np.float32)[None]
    sampled = fsr2.lanczos(step, x, np.full_like(x, 2.0))
    assert sampled.min() == 0.0
    assert sampled.max() == 1.0
    assert 0.4 < sampled[0, 20, 0] < 0.6


# --- rectification ---


def rectified(value: float, *, kept: float = 0.0, untrusted: float = 0.0, speed: float = 0.0) -> list[float]:
    """Return luma and weight of a history of weight 1, after a box of 0.5 +- 0.05 within [0.1, 0.9]."""
    one = np.ones((1, 1), np.float32)
    box = ColorBox(*(np.array([[[v, 0.0, 0.0]]], np.float32) for v in (0.5, 0.05, 0.1, 0.9)))
    history = np.array([[[value, 0.0, 0.0]]], np.float32)
    luma, weight = rectify(history, one, box, kept * one, VIEW, untrusted=untrusted * one, speed=speed * one)
    return [float(luma[0, 0, 0]), float(weight[0, 0])]


def test_history_is_clamped_to_a_box_that_is_wide_only_at_rest() -> None:
    assert rectified(0.85) == pytest.approx([0.85, 1.0])
    assert rectified(1.5) == pytest.approx([0.9, 0.1])
    assert rectified(0.85, untrusted=1.0) == pytest.approx([0.55, 0.1])
    assert rectified(0.85, speed=20.0) == pytest.approx([0.55, 0.1])
    assert rectified(1.5, kept=1.0) == pytest.approx([1.5, 1.0])
    assert rectified(1.5, kept=0.5) == pytest.approx([1.2, 0.55])


def unstable(now: float, lumas: tuple[float, ...], *, deviation: float = 0.2, reactive: float = 0.0) -> float:
    """Return the instability of a luma (after the tone curve) that followed others, the latest first."""
    light = now / (1.0 - now)
    box = ColorBox(*(np.array([[[v, 0.0, 0.0]]], np.float32) for v in (light, deviation, 0.0, 9.0)))
    plane = np.ones((1, 1), np.float32)
    factor, after = luma_instability(box, np.array([[lumas]], np.float32), reactive * plane, 0.0 * plane)
    np.testing.assert_allclose(after[0, 0], [now, *lumas[:3]], atol=1.0 / 255.0)
    return float(factor[0, 0])


def test_luma_that_comes_back_is_unstable() -> None:
    assert unstable(0.2, (0.8, 0.3, 0.8, 0.8)) == 1.0
    assert unstable(0.2, (0.8, 0.3, 0.8, 0.8), reactive=2.0**-6) == pytest.approx(0.5)
    assert unstable(0.2, (0.8, 0.9, 0.9, 0.9)) == 0.0  # further off before
    assert unstable(0.2, (0.8, 0.1, 0.1, 0.1)) == 0.0  # on the other side before
    assert unstable(0.2, (0.201, 0.2, 0.2, 0.2)) == 0.0  # no step of 8 bits
    assert unstable(0.2, (0.8, 0.3, 0.0, 0.0)) == 0.0  # no three frames yet
    assert unstable(0.2, (0.8, 0.3, 0.8, 0.8), deviation=0.03) == 0.0  # flat


# --- accumulation ---

NATIVE = FrameSizes((9, 9), (9, 9), (0.0, 0.0))


def step_of(
    view: FrameSizes,
    *,
    speed: float = 0.0,
    clip: Float32 | None = None,
    reactive: float = 0.0,
    light: float = 0.5,
    lock: tuple[float, float] = (0.0, 0.5),
    lumas: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0),
) -> tuple[Float32, Fsr2History]:
    """Accumulate a checkerboard of pixels of 0 and 1 on a history of one light; return board and result."""
    width, height = view.render
    board = (np.indices((height, width)).sum(axis=0) % 2).astype(np.float32)
    none, display = np.zeros((height, width), np.float32), flat(view.display, 0.0)
    passed = Prepared(
        color=np.repeat(board[..., None], 3, axis=-1),
        motion=flat(view.render, speed, 0.0),
        clip=DepthClip(none if clip is None else clip, none),
        locked=display > 0.0,
        shading=display + 0.5,
        exposure=1.0,
    )
    lit = flat(view.display, light, light, light, reactive)
    history = Fsr2History(lit, flat(view.display, *lock), flat(view.display, *lumas))
    return board, accumulate(passed, history, view)


WEIGHT = (
    1.0 - 4.0 * 0.125
) / 12.0  # of the samples around a pixel at a ratio of 1: itself, and four diagonal ones


@pytest.mark.parametrize(
    ("setting", "alpha"),
    [
        ({}, WEIGHT / (1.0 + WEIGHT)),
        ({"reactive": -1e-9}, 1.0 / 11.0),  # it moved a frame ago
        ({"speed": 1.0}, 1.0 / (1.0 + 10.0 - 9.0 / 20.0)),
        ({"clip": np.ones((9, 9), np.float32)}, 1.0),
    ],
)
def test_the_weight_of_the_history_falls_with_motion_and_disocclusion(
    setting: dict[str, Any], alpha: float
) -> None:
    board, found = step_of(NATIVE, **setting)
    image, before, now = (v / (1.0 + v) for v in (found.color[2:-2, 2:-2, 0], 0.5, board[2:-2, 2:-2]))
    np.testing.assert_allclose((image - before) / (now - before), np.full((5, 5), alpha), rtol=1e-3)


def test_the_reactive_factor_fades_and_tells_of_motion() -> None:
    assert step_of(NATIVE, reactive=0.5)[1].color[4, 4, 3] == pytest.approx(0.25)
    assert step_of(NATIVE, reactive=-1.0)[1].color[4, 4, 3] == pytest.approx(0.99**2)
    assert step_of(NATIVE, speed=1.0)[1].color[4, 4, 3] == pytest.approx(-(0.4**2))
    assert step_of(NATIVE, speed=1.0)[1].color[4, -1, 3] == -1.0  # came from off screen


def test_the_depth_clip_of_a_sample_lies_where_its_jitter_says() -> None:
    clip = np.zeros((9, 9), np.float32)
    clip[4, 3] = 1.0
    _, found = step_of(FrameSizes((9, 9), (18, 18), (0.4, -0.3)), clip=clip)
    factor = found.color[..., 3]  # a tenth of the clip, for the next frame
    x, y = fsr2.centres((18, 18))
    total = factor.sum()
    assert total == pytest.approx(0.4)
    assert (factor * x).sum() / total == pytest.approx(2.0 * (3.5 + 0.4), abs=1e-3)
    assert (factor * y).sum() / total == pytest.approx(2.0 * (4.5 - 0.3), abs=1e-3)


def test_history_beyond_the_samples_stays_where_a_lock_or_flicker_keeps_it() -> None:
    assert step_of(NATIVE, light=5.0)[1].color[2:-2, 2:-2, 0].max() < 1.5
    assert step_of(NATIVE, light=5.0, lock=(1.5, 0.5))[1].color[2:-2, 2:-2, 0].min() > 3.0
    assert step_of(NATIVE, light=5.0, lumas=(0.9, 0.5, 0.5, 0.5))[1].color[2:-2, 2:-2, 0].min() > 3.0


def test_locks_end_where_the_next_frame_has_no_place_for_them() -> None:
    lifetime = step_of(NATIVE, speed=2.0, lock=(1.5, 0.5))[1].locks[4, :, 0]
    assert (lifetime[:2] == 0.0).all()  # leave the screen
    assert (lifetime[-2:] == 0.0).all()  # came from off screen
    assert lifetime[2:-2].min() > 1.0
