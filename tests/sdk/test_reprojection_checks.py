"""Tests of measurements between two frames: reprojection error, motion of the image, disocclusion."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from supersampler import Conventions, FrameError, RawFrame
from supersampler.arguments import ieee_arithmetic
from supersampler.frame import Float32, Frame
from supersampler.validation.probe import (
    DepthOrder,
    FrameProbe,
    count_disoccluded,
    pixel_grid,
    plane_curvature,
    sky_fraction,
    tone_mapped,
)
from supersampler.validation.reprojection import FramePair, frame_pairs

OURS = Conventions()
Pixels = tuple[int, int]


def probe(light: NDArray[Any] | None, **fields: Any) -> FrameProbe:
    """Return a frame of this luminance on a card at rest."""
    shape = (60, 80) if light is None else light.shape
    plain: dict[str, Any] = {
        "light": None if light is None else light.astype(np.float32),
        "depth": np.full(shape, 0.1, np.float32),
        "motion": np.zeros((*shape, 2), np.float32),
        "jitter": (0.0, 0.0),
        "reset": False,
    }
    return FrameProbe(**plain | fields)


def view(x: int = 0, y: int = 0, size: Pixels = (80, 60), seed: int = 0) -> Float32:
    """Return a view of a wall of noise that has moved by (x, y) pixels on the screen."""
    wall = np.random.default_rng(seed).random((200, 260), np.float32)
    wall = (wall + np.roll(wall, 1, 0) + np.roll(wall, 1, 1) + np.roll(wall, (1, 1), (0, 1))) ** 3
    return wall[40 - y : 40 - y + size[1], 40 - x : 40 - x + size[0]]


def pair(before: NDArray[Any], now: NDArray[Any], **fields: Any) -> FramePair:
    return FramePair(probe(before), probe(now, **fields))


def test_luminance_is_tone_mapped_around_the_median_of_lit_pixels() -> None:
    light = np.array([[0.0, -1.0, 0.1], [0.2, np.nan, 0.6], [0.0, np.inf, 0.0]], np.float32)
    tones = ieee_arithmetic(tone_mapped)(light, 2 * light)
    np.testing.assert_allclose(tones, [[0, 0, 0.2], [1 / 3, np.nan, 0.6], [0, np.nan, 0]], rtol=1e-6)
    black = np.zeros((3, 3), np.float32)
    assert not tone_mapped(black, black).any()


# --- reprojection error ---


@pytest.mark.parametrize("moved", [(3, 0), (-2, 1), (0, -4)])
def test_the_error_is_0_at_the_place_in_the_previous_image_and_large_elsewhere(moved: Pixels) -> None:
    made, offset = pair(view(), view(*moved)), np.negative(moved).astype(np.float64)
    rows, columns = made.pixels
    inner = (np.abs(rows - 30) < 24) & (np.abs(columns - 40) < 34)  # the filter repeats pixels at the border
    assert made.error(offset, inner) < 1e-9
    assert made.error(np.broadcast_to(offset, (4800, 2)), inner) < 1e-9
    for wrong in (np.zeros(2), -offset, offset + np.eye(2)[0], offset - np.eye(2)[1]):
        assert made.error(wrong) > 0.2 * made.variance


@pytest.mark.parametrize("axis", [0, 1])
def test_places_off_the_screen_do_not_count_and_half_must_be_on_it(axis: int) -> None:
    made, offset = pair(view(), view()), np.zeros(2)
    offset[axis] = 0.45 * (80, 60)[axis]
    assert 0 < made.error(offset) < np.inf
    assert 0 < made.error(-offset) < np.inf
    offset[axis] = 0.55 * (80, 60)[axis]
    assert made.error(offset) == np.inf
    bad = pair(np.where(np.arange(60)[:, None] < 25, np.nan, view()), view())
    assert bad.error(np.zeros(2)) < 1e-9, "bad pixels do not count"


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize(("lines", "enough"), [(10, False), (50, True)])
def test_stripes_are_texture_if_they_fill_1000_pixels(turned: bool, lines: int, enough: bool) -> None:
    light = np.ones((70, 70)) + 0.2 * (np.arange(70) // 2 % 2)
    light[lines:] = 1.0
    light = light.T if turned else light
    assert pair(light, light).textured is enough
    faint = 1.0 + 0.1 * (light - 1.0)
    assert not pair(faint, faint).textured


def test_pixels_move_by_at_least_a_tenth_of_the_longest_vectors() -> None:
    motion = np.zeros((60, 80, 2), np.float32)
    motion[:10, :, 0], motion[10:20, :, 1], motion[20:30, :, 0], motion[30, :, 1] = 10.0, -1.1, 0.9, np.nan
    moves = pair(view(), view(), motion=motion).moving(OURS).reshape(60, 80)
    assert moves[:20].all()
    assert not moves[20:].any()
    assert not pair(view(), view()).moving(OURS).any()
    rounded = np.full((60, 80, 2), 5e-8 * 80, np.float32)  # of the motion of a camera at rest
    assert not pair(view(), view(), motion=rounded).moving(OURS).any()


def test_frames_are_paired_if_both_are_shaded_of_one_size_and_without_a_cut() -> None:
    first, second = probe(view()), probe(view(1, 0))
    cut, small = replace(second, reset=True), probe(view(size=(40, 30)))
    unshaded = replace(first, light=None)
    paired = [(pair.before, pair.now) for pair in frame_pairs([first, second, first])]
    assert paired == [(first, second), (second, first)]
    for frames in ([first, cut], [first, small], [first, unshaded], [unshaded, first], [first]):
        assert frame_pairs(frames) == []
    with pytest.raises(FrameError, match="color is None; want shaded frames"):
        FramePair(unshaded, first)
    with pytest.raises(FrameError, match="color is None; want shaded frames"):
        FramePair(first, unshaded)


def test_a_frame_continues_another_if_it_resembles_it_where_the_motion_leads() -> None:
    motion = np.full((60, 80, 2), (-2.0, 1.0), np.float32)
    assert pair(view(), view(2, -1), motion=motion).continues
    assert not pair(view(), view(2, -1), motion=-motion).continues
    assert not pair(view(), view(seed=1)).continues
    assert not pair(np.ones((60, 80)), np.ones((60, 80))).continues, "there is no texture"


# --- motion of the image, where all vectors are 0 ---


@pytest.mark.parametrize("moved", [(3, 0), (0, 2), (-2, 0), (0, -5), (-9, 7)])
@pytest.mark.parametrize("size", [(48, 60), (110, 96)])
def test_an_image_that_moves_lacks_motion(moved: Pixels, size: Pixels) -> None:
    assert pair(view(size=size), view(*moved, size=size)).lacks_motion
    one = np.zeros((*size[::-1], 2), np.float32)
    one[3, 5, 1] = 0.1
    assert not pair(view(size=size), view(*moved, size=size), motion=one).lacks_motion


@pytest.mark.parametrize(
    ("moved", "size", "found"),
    [
        ((0, 0), (80, 60), False), ((1, 0), (80, 60), False), ((0, -1), (80, 60), False),
        ((-1, 1), (80, 60), False), ((4, 3), (48, 48), True), ((4, 3), (47, 90), False),
        ((4, 3), (90, 47), False), ((24, 0), (110, 96), True), ((24, 0), (80, 80), False),
    ],
)  # fmt: skip
def test_images_of_48_pixels_are_searched_for_motion_of_more_than_a_pixel(
    moved: Pixels, size: Pixels, found: bool
) -> None:
    """Frames that move by one pixel might only be jittered; larger images allow a wider search."""
    assert pair(view(size=size), view(*moved, size=size)).lacks_motion is found


@pytest.mark.parametrize(("part", "found"), [(0.75, True), (0.35, False)])
@pytest.mark.parametrize("axis", [0, 1])
def test_an_image_lacks_motion_if_most_of_it_moves(part: float, found: bool, axis: int) -> None:
    now = view(size=(120, 120)).copy()
    part_moved = (slice(round(part * 120)), slice(None))
    now[part_moved] = view(6, 5, (120, 120))[part_moved]
    before = view(size=(120, 120))
    made = pair(before, now) if axis == 0 else pair(before.T, now.T)
    assert made.lacks_motion is found


def test_other_images_and_images_without_contrast_do_not_move() -> None:
    assert not pair(view(), view(seed=1)).lacks_motion
    assert not pair(np.ones((60, 80)), np.ones((60, 80))).lacks_motion
    faint = [1.0 + 0.02 * each for each in (view(), view(4, 3))]
    assert not pair(*faint).lacks_motion
    patch = [np.where((np.mgrid[:96, :96] < 12).all(0), view(x, 0, (96, 96)), 1.0) for x in (0, 4)]
    assert not pair(*patch).lacks_motion, "a single tile"


def test_bad_pixels_do_not_hide_that_an_image_moves() -> None:
    before, now = view().copy(), view(5, 3).copy()
    before[20, 30], now[40, 50] = np.nan, np.inf
    assert ieee_arithmetic(pair)(before, now).lacks_motion


# --- depth ---


def plane(size: int = 60) -> Float32:
    y, x = np.mgrid[:size, :size]
    return np.asarray(0.3 + 0.001 * x + 0.002 * y, np.float32)


@pytest.mark.parametrize(
    ("order", "depth", "sky"),
    [("reversed", plane(), 0.0), ("forward", 1 - plane(), 1.0), ("linear", 1 / plane(), 1e6)],
)
def test_planes_are_not_curved_in_their_own_order(order: DepthOrder, depth: Float32, sky: float) -> None:
    assert plane_curvature(depth, order) < 1e-4
    striped = depth.copy()
    striped[:, ::4] = sky  # without it, three pixels in a row
    with np.errstate(all="ignore"):
        assert plane_curvature(striped, order) < 1e-4
    assert sky_fraction(striped, order) == 0.25
    assert sky_fraction(depth, order) == 0.0


def test_depth_without_slopes_has_no_curvature() -> None:
    flat = np.full((40, 40), 0.3, np.float32)
    assert np.isnan(plane_curvature(flat, "reversed"))
    rounded = flat.copy()
    rounded[::2, ::3] = np.nextafter(np.float32(0.3), np.float32(1))
    assert np.isnan(plane_curvature(rounded, "reversed"))


def disocclusion(near: float = 0.2, far: float = 0.1) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return depth now and before of a card, of 20 x 20 pixels, that has moved away over a background."""
    now = np.full((60, 80), far, np.float32)
    before = now.copy()
    before[10:30, 15:35] = near
    return now, before


def counted(
    now: NDArray[Any], before: NDArray[Any], order: DepthOrder = "reversed", offset: Any = (0.0, 0.0)
) -> Pixels:
    pixels = pixel_grid((80, 60))
    with np.errstate(all="ignore"):
        return count_disoccluded(now, before, order, pixels, np.broadcast_to(offset, (len(pixels[0]), 2)))


def test_pixels_that_a_closer_surface_hid_are_disoccluded() -> None:
    now, before = disocclusion()
    assert counted(now, before) == counted(1 / now, 1 / before, "linear") == (18 * 18, 0)
    assert counted(now, before, "forward") == counted(now, before, "linear") == (0, 18 * 18)
    assert counted(now, now) == (0, 0)
    assert counted(*disocclusion(near=0.112)) == (18 * 18, 0)
    assert counted(*disocclusion(near=0.108)) == (0, 0), "a slope"
    assert counted(*disocclusion(near=0.088)) == (0, 18 * 18)
    assert counted(now, np.float32(0.5) * before) == (18 * 18, 0), "the camera moves forward"
    assert counted(0 * now, before) == (0, 0), "the sky neither hides"
    assert counted(now, np.where(before > 0.15, np.float32(0.0), before)) == (0, 0), "nor is it hidden"


@pytest.mark.parametrize(("x", "y", "count"), [
    (0.4, -0.4, 18 * 18), (-20.0, 0.0, 18 * 18), (20.4, 0.0, 14 * 18), (0.0, 14.6, 14 * 18),
    (-50.0, 0.0, 14 * 18), (0.0, -36.0, 13 * 18), (50.0, 0.0, 0), (np.nan, 0.0, 0), (0.0, np.inf, 0),
])  # fmt: skip
def test_pixels_are_compared_with_their_previous_places(x: float, y: float, count: int) -> None:
    """The card was in columns 15 to 34 and rows 10 to 29; its outer pixels do not count."""
    assert counted(*disocclusion(), offset=(x, y)) == (count, 0)


@pytest.mark.parametrize(
    ("part", "offset", "count"),
    [
        (np.s_[:, :10], (-20, 0), 9 * 60), (np.s_[:, 70:], (20, 0), 9 * 60),
        (np.s_[:10], (0, -20), 9 * 80), (np.s_[50:], (0, 20), 9 * 80),
    ],
)  # fmt: skip
def test_places_off_the_screen_are_not_the_nearest_ones_on_it(part: Any, offset: Pixels, count: int) -> None:
    now, before = np.full((60, 80), 0.1, np.float32), np.full((60, 80), 0.1, np.float32)
    before[part] = 0.2
    assert counted(now, before, offset=offset) == (count, 0)


# --- frames as they are read ---


def test_a_raw_frame_is_read_as_stated() -> None:
    rng = np.random.default_rng(0)
    color, depth = rng.random((6, 8, 3), np.float32), rng.random((6, 8), np.float32)
    fields: Any = {"color": color, "depth": depth, "motion": rng.random((6, 8, 2), np.float32)}
    fields |= {"jitter": (0.1, 0.2), "reset": True, "pre_exposure": 4.0}
    raw = RawFrame(**fields)
    plain, frame = FrameProbe.of_raw(raw, OURS), FrameProbe.of_frame(Frame(**fields))
    np.testing.assert_array_equal(frame.light, plain.light)
    np.testing.assert_allclose(np.asarray(plain.light), color @ [0.2126, 0.7152, 0.0722] / 4, rtol=1e-5)
    assert (plain.jitter, plain.reset, plain.size) == ((0.1, 0.2), True, (8, 6))
    turned = FrameProbe.of_raw(raw, Conventions(bottom_up=True))
    for name in ("light", "depth", "motion"):
        np.testing.assert_array_equal(getattr(turned, name), getattr(plain, name)[::-1])
    encoded = FrameProbe.of_raw(replace(raw, color=np.full_like(color, 0.5)), Conventions(srgb=True))
    np.testing.assert_allclose(np.asarray(encoded.light), 0.21404 / 4, rtol=1e-4)
    unshaded = FrameProbe.of_raw(replace(raw, color=None, jitter=None), OURS)
    assert (unshaded.light, unshaded.jitter) == (None, (0.0, 0.0))
