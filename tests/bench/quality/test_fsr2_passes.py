"""The passes of `fsr2-like`, one at a time: FSR2's formulas on small buffers whose results are known."""

import math
from typing import Any

import numpy as np
import pytest

from supersampler.frame import Array, Float32, Size
from supersampler_bench import fsr2
from supersampler_bench.fsr2 import ColorBox, FrameSizes, Fsr2History, Prepared, accumulate
from supersampler_model.data.scenes.analytic import FAR, NEAR, DiscOverPlane

VIEW = FrameSizes((12, 10), (24, 20), (0.0, 0.0))
NATIVE = FrameSizes((9, 9), (9, 9), (0.0, 0.0))
ONE = np.ones((1, 1), np.float32)


def flat(size: Size, *values: float) -> Float32:
    """Return an image of one value, or of one vector, (width, height) of `size`."""
    shape = (size[1], size[0], len(values)) if len(values) > 1 else (size[1], size[0])
    return np.full(shape, values if len(values) > 1 else values[0], np.float32)


def test_exposure_is_the_published_formula_and_follows_the_light_slowly() -> None:
    assert fsr2.auto_exposure(math.log(0.18)) == pytest.approx(1.0 / (9.6 * 0.18))
    logs = np.full((4, 4), 2.0, np.float32)
    assert fsr2.followed_average(logs, None, 0.1) == 2.0
    assert fsr2.followed_average(logs, 0.0, 0.1) == pytest.approx(2.0 * (1.0 - math.exp(-0.1)))


def test_log_luminance_is_resampled_at_pixel_centres() -> None:
    x, y = fsr2.centres((12, 10))
    sampled = np.repeat((11.0 + (x + 0.3) - 0.5 * (y - 0.2))[..., None], 3, axis=-1)
    logs = fsr2.log_luma(sampled, FrameSizes((12, 10), (24, 20), (0.3, -0.2)))
    np.testing.assert_allclose(logs[1:-1, 1:-1], np.log(11.0 + x - 0.5 * y)[1:-1, 1:-1], rtol=1e-5)


def test_dilation_takes_depth_and_motion_of_the_closest_neighbour() -> None:
    depth, motion = np.full((5, 6), FAR, np.float32), np.zeros((5, 6, 2), np.float32)
    depth[2, 3], motion[2, 3] = NEAR, (1.0, 0.0)
    near_depth, near_motion = fsr2.dilate(depth, motion)
    near, moved = np.zeros((2, 5, 6), bool)
    near[1:4, 2:5] = moved[1:4, 3:6] = True  # moved: where those nine pixels were
    assert ((near_depth == np.float32(NEAR)) == near).all()
    assert ((near_motion[..., 0] == 1.0) == near).all()
    before = fsr2.reconstructed_depth(near_depth, near_motion, FrameSizes((6, 5), (12, 10), (0.0, 0.0)))
    assert ((before == np.float32(NEAR)) == moved).all()


def test_only_surfaces_that_a_moving_disc_uncovers_are_disoccluded() -> None:
    scene = DiscOverPlane(velocity=(2.0, 0.0), background_velocity=(0.0, 0.0))
    frame, view = scene.frame(6, (64, 36)), FrameSizes((64, 36), (128, 72), (0.0, 0.0))
    depth, motion = fsr2.dilate(frame.depth, frame.motion)
    clip = fsr2.disocclusion(depth, motion, fsr2.reconstructed_depth(depth, motion, view), view)
    uncovered = scene.disoccluded(6, (64, 36))
    assert clip[uncovered & (depth == np.float32(FAR))].mean() > 0.9
    assert (clip[~uncovered] > 0.5).mean() < 0.02  # beside the edge, which dilation moves by a pixel


def test_motion_diverges_where_neighbours_move_apart_or_a_surface_starts_to_move() -> None:
    motion = flat(VIEW.render, 2.0, 0.0)
    assert fsr2.motion_divergence(motion, VIEW).max() == 0.0
    motion[:, 6:] *= -1.0
    apart = fsr2.motion_divergence(motion, VIEW)
    assert (apart[:, 5:7] == 1.0).all()
    assert apart[:, :5].max() == apart[:, 7:].max() == 0.0
    fast, still = flat(VIEW.render, 10.0, 0.0), flat(VIEW.render, 0.0, 0.0)  # 20 display pixels
    assert (fsr2.temporal_divergence(fast, still, VIEW) == 1.0).all()
    larger = flat((24, 7), 10.0 / 12.0, 0.0)  # the same motion at another render size
    assert fsr2.temporal_divergence(fast, larger, VIEW).max() < 1e-6
    assert fsr2.temporal_divergence(0.25 * fast, still, VIEW).max() < 0.02


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


def test_the_jitter_determines_the_display_pixel_of_a_sample() -> None:
    luma = np.full((5, 5), 0.2, np.float32)
    luma[2, 2] = 0.8
    for jitter, place in (((-0.4, -0.4), (4, 4)), ((0.4, -0.4), (4, 5)), ((-0.4, 0.4), (5, 4))):
        made = fsr2.new_locks(luma, FrameSizes((5, 5), (10, 10), jitter))
        assert np.argwhere(made).tolist() == [[*place]]


@pytest.mark.parametrize(
    ("lock", "setting", "wanted"),  # lifetime, luma; lifetime, luma, contribution
    [
        ((0.0, 0.0), {"made": True}, (1.0, 0.5, 0.0)),
        ((0.7, 0.5), {"made": True}, (2.0, 0.5, 1.0)),
        ((1.1, 0.5), {}, (1.1, 0.5, 0.4)),
        ((0.7, 0.48), {}, (0.7, 0.49, 0.0)),  # follows the shading
        ((1.9, 0.44), {}, (0.0, 0.44, 0.0)),  # changed by more than a tenth
        ((2.0, 0.5), {"mask": 0.25}, (1.5, 0.5, 1.0)),
        ((2.0, 0.5), {"clip": 0.2}, (0.0, 0.5, 0.0)),
    ],
)
def test_a_lock_is_active_from_its_second_sample_until_the_shading_changes(
    lock: tuple[float, float], setting: dict[str, float], wanted: tuple[float, ...]
) -> None:
    made = ONE > 0.0 if setting.get("made") else ONE < 0.0
    mask, clip = (setting.get(name, 0.0) * ONE for name in ("mask", "clip"))
    update = fsr2.update_locks(flat((1, 1), *lock)[None][0], made, 0.5 * ONE, 0.0 * ONE, mask, clip)
    assert [float(v[0, 0]) for v in update[:3]] == pytest.approx(wanted)


def test_the_tone_curve_is_undone_up_to_the_largest_half_float() -> None:
    light = np.array([[0.1, 2.0, 30.0], [0.0, 0.0, 0.0]], np.float32)
    np.testing.assert_allclose(fsr2.inverse_tonemap(fsr2.tonemap(light)), light, rtol=1e-4)
    np.testing.assert_allclose(fsr2.inverse_tonemap(np.ones((1, 3), np.float32)), 65504.0)


def test_a_uniform_colour_is_unchanged_and_its_box_is_a_point() -> None:
    zero, sizes = flat(VIEW.display, 0.0), FrameSizes(VIEW.render, VIEW.display, (0.2, -0.4))
    color, _, box = fsr2.upsample(flat(VIEW.render, 0.4, -0.1, 0.2), zero, zero, zero, sizes)
    for found in (color, box.centre):
        np.testing.assert_allclose(found, flat(VIEW.display, 0.4, -0.1, 0.2), rtol=1e-5)
    assert box.deviation.max() < 1e-3


def test_the_approximation_of_lanczos2_is_close() -> None:
    x = np.linspace(0.0, 2.5, 51, dtype=np.float32)
    exact = np.where(x < 2.0, np.sinc(x) * np.sinc(x / 2.0), 0.0)
    np.testing.assert_allclose(fsr2.lanczos2_of_square(x * x), exact, atol=0.06)


@pytest.mark.parametrize("sample", [fsr2.bilinear, fsr2.lanczos])
def test_reads_at_texel_centres_return_the_texels_and_do_not_ring(sample: Any) -> None:
    image = np.random.default_rng(0).uniform(size=(5, 7, 2)).astype(np.float32)
    np.testing.assert_allclose(sample(image, *fsr2.centres((7, 5))), image, atol=1e-6)
    step = np.repeat([[0.0, 0.0, 0.0, 1.0, 1.0, 1.0]], 4, axis=0).astype(np.float32)[..., None]
    x = np.linspace(0.5, 5.5, 41, dtype=np.float32)[None]
    sampled = sample(step, x, np.full_like(x, 2.0))
    assert (sampled.min(), sampled.max()) == (0.0, 1.0)
    assert 0.4 < sampled[0, 20, 0] < 0.6


@pytest.mark.parametrize(
    ("value", "setting", "wanted"),
    [
        (0.85, {}, [0.85, 1.0]),
        (1.5, {}, [0.9, 0.1]),
        (0.85, {"scale": 1.0}, [0.55, 0.1]),
        (1.5, {"kept": 1.0}, [1.5, 1.0]),
        (1.5, {"kept": 0.5}, [1.2, 0.55]),
    ],
)
def test_history_is_clamped_to_a_box_except_where_locks_keep_it(
    value: float, setting: dict[str, float], wanted: list[float]
) -> None:
    box = ColorBox(*(np.array([[[v, 0.0, 0.0]]], np.float32) for v in (0.5, 0.05, 0.1, 0.9)))
    planes = {name: setting.get(name, other) * ONE for name, other in (("scale", 20.0), ("kept", 0.0))}
    luma, weight = fsr2.rectify(np.array([[[value, 0.0, 0.0]]], np.float32), ONE, box, **planes)
    assert [float(luma[0, 0, 0]), float(weight[0, 0])] == pytest.approx(wanted)


@pytest.mark.parametrize(
    ("lumas", "setting", "instability"),  # the latest first
    [
        ((0.8, 0.3, 0.8, 0.8), {}, 1.0),
        ((0.8, 0.3, 0.8, 0.8), {"reactive": 2.0**-6}, 0.5),
        ((0.8, 0.9, 0.9, 0.9), {}, 0.0),  # further off before
        ((0.8, 0.1, 0.1, 0.1), {}, 0.0),  # on the other side before
        ((0.201, 0.2, 0.2, 0.2), {}, 0.0),  # no step of 8 bits
        ((0.8, 0.3, 0.0, 0.0), {}, 0.0),  # no three frames yet
        ((0.8, 0.3, 0.8, 0.8), {"deviation": 0.03}, 0.0),  # flat
    ],
)
def test_luma_that_returns_to_an_older_value_is_unstable(
    lumas: tuple[float, ...], setting: dict[str, float], instability: float
) -> None:
    light, deviation = 0.2 / 0.8, setting.get("deviation", 0.2)
    box = ColorBox(*(np.array([[[v, 0.0, 0.0]]], np.float32) for v in (light, deviation, 0.0, 9.0)))
    reactive = setting.get("reactive", 0.0) * ONE
    found, after = fsr2.luma_instability(box, np.array([[lumas]], np.float32), reactive, 0.0 * ONE)
    np.testing.assert_allclose(after[0, 0], [0.2, *lumas[:3]], atol=1.0 / 255.0)
    assert float(found[0, 0]) == pytest.approx(instability)


def step_of(
    view: FrameSizes,
    *,
    speed: float = 0.0,
    clip: Array | float = 0.0,
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
        clip=np.stack([none + np.float32(clip), none], axis=-1),
        locked=display > 0.0,
        shading=display + 0.5,
        exposure=1.0,
    )
    lit = flat(view.display, light, light, light, reactive)
    history = Fsr2History(lit, flat(view.display, *lock), flat(view.display, *lumas))
    return board, accumulate(passed, history, view)


WEIGHT = (1.0 - 4.0 * 0.125) / 12.0
"""Weight of the samples around a pixel at a ratio of 1: itself, and four diagonal ones."""


@pytest.mark.parametrize(
    ("setting", "alpha"),
    [
        ({}, WEIGHT / (1.0 + WEIGHT)),
        ({"reactive": -1e-9}, 1.0 / 11.0),  # it moved a frame ago
        ({"speed": 1.0}, 1.0 / (1.0 + 10.0 - 9.0 / 20.0)),
        ({"clip": 1.0}, 1.0),
    ],
)
def test_the_weight_of_the_history_falls_with_motion_and_disocclusion(
    setting: dict[str, Any], alpha: float
) -> None:
    board, found = step_of(NATIVE, **setting)
    image, before, now = (v / (1.0 + v) for v in (found.color[2:-2, 2:-2, 0], 0.5, board[2:-2, 2:-2]))
    np.testing.assert_allclose((image - before) / (now - before), np.full((5, 5), alpha), rtol=1e-3)


def test_the_reactive_factor_fades_and_its_sign_marks_motion() -> None:
    assert step_of(NATIVE, reactive=0.5)[1].color[4, 4, 3] == pytest.approx(0.25)
    assert step_of(NATIVE, reactive=-1.0)[1].color[4, 4, 3] == pytest.approx(0.99**2)
    assert step_of(NATIVE, speed=1.0)[1].color[4, 4, 3] == pytest.approx(-(0.4**2))
    assert step_of(NATIVE, speed=1.0)[1].color[4, -1, 3] == -1.0  # came from off screen


def test_the_jitter_determines_the_position_of_a_samples_depth_clip() -> None:
    clip = np.zeros((9, 9), np.float32)
    clip[4, 3] = 1.0
    factor = step_of(FrameSizes((9, 9), (18, 18), (0.4, -0.3)), clip=clip)[1].color[..., 3]
    x, y = fsr2.centres((18, 18))
    assert factor.sum() == pytest.approx(0.4)  # a tenth of the clip, for the next frame
    assert (factor * x).sum() / factor.sum() == pytest.approx(2.0 * (3.5 + 0.4), abs=1e-3)
    assert (factor * y).sum() / factor.sum() == pytest.approx(2.0 * (4.5 - 0.3), abs=1e-3)


def test_a_lock_or_flicker_keeps_history_beyond_the_samples_until_it_leaves_the_screen() -> None:
    assert step_of(NATIVE, light=5.0)[1].color[2:-2, 2:-2, 0].max() < 1.5
    assert step_of(NATIVE, light=5.0, lock=(1.5, 0.5))[1].color[2:-2, 2:-2, 0].min() > 3.0
    assert step_of(NATIVE, light=5.0, lumas=(0.9, 0.5, 0.5, 0.5))[1].color[2:-2, 2:-2, 0].min() > 3.0
    lifetime = step_of(NATIVE, speed=2.0, lock=(1.5, 0.5))[1].locks[4, :, 0]
    assert lifetime[:2].max() == lifetime[-2:].max() == 0.0  # leave the screen; came from off screen
    assert lifetime[2:-2].min() > 1.0
