"""Tests of the thresholds of the single-frame checks: no warning just below each."""

import itertools
import warnings
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from supersampler.conventions.jitter import halton_jitter
from supersampler.errors import FrameError, FrameWarning
from supersampler.frame import Float32, Frame
from supersampler.validation import FrameChecker
from supersampler.validation.single_frame import mixed_edges

SIZE = (80, 60)  # all of its 4800 pixels are looked at
PIXELS = SIZE[0] * SIZE[1]


def frame(**fields: Any) -> Frame:
    """A smooth slope in even light, at rest; nothing to complain of."""
    w, h = SIZE
    y, x = np.mgrid[:h, :w].astype(np.float32)
    plain: dict[str, Any] = {
        "color": np.repeat((0.4 + 0.001 * x)[..., None], 3, axis=2),
        "depth": 0.1 + 0.001 * x + 0.002 * y,
        "motion": np.zeros((h, w, 2), np.float32),
        "jitter": (0.1, -0.2),
    }
    return Frame(**{**plain, **fields})


def complaint(made: Frame) -> str:
    """The first mistake that is found; "" for none. Hints are warnings."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", FrameWarning)
            FrameChecker("strict").check(made, (160, 120))
    except (FrameError, FrameWarning) as found:
        return str(found)
    return ""


def spread(value: float, share: float, fill: Float32) -> Float32:
    """`fill`, (h, w, ...), with a share of its pixels at one value."""
    made = fill.copy()
    made.reshape(PIXELS, -1)[: round(share * PIXELS)] = value
    return made


def test_a_plain_frame_is_fine() -> None:
    assert complaint(frame()) == ""


@pytest.mark.parametrize(("share", "found"), [(0.009, False), (0.012, True)])
def test_colours_may_be_negative_in_a_hundredth_of_the_values(share: float, found: bool) -> None:
    color = spread(-0.01, share, frame().color)  # type: ignore[arg-type]
    assert ("negative" in complaint(frame(color=color))) is found
    assert complaint(frame(color=spread(-1e-7, 0.5, color * 0 + 0.4))) == ""


@pytest.mark.parametrize("channels", [1, 2, 3])
def test_light_that_is_clipped_at_1_in_one_channel_or_two_is_hinted_at(channels: int) -> None:
    color = np.full((SIZE[1], SIZE[0], 3), 0.5, np.float32)
    color[:1, :30, :channels] = 1.0  # 0.6 % of the pixels
    assert ("never above 1" in complaint(frame(color=color))) is (channels < 3)
    color[30, 30] = 1.5
    assert complaint(frame(color=color)) == ""
    color[30, 30], color[:1, 20:30] = 0.5, 0.5  # 0.4 %
    assert complaint(frame(color=color)) == ""


@pytest.mark.parametrize("field", ["color", "depth", "motion"])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_one_value_that_is_no_number_is_found_and_its_place_is_said(field: str, value: float) -> None:
    array = getattr(frame(), field).copy()
    array[7, 5] = value
    said = complaint(frame(**{field: array}))
    assert "in 1 pixels, first at (x=5, y=7)" in said
    assert field in said.split(":")[0]


def test_depth_may_be_0_and_not_less() -> None:
    depth = frame().depth.copy()
    depth[3, 4] = 0.0
    assert complaint(frame(depth=depth)) == ""
    depth[3, 4] = -0.01
    assert "negative, as small as -0.01" in complaint(frame(depth=depth))


@pytest.mark.parametrize(("share", "found"), [(0.01, False), (0.03, True)])
def test_a_sky_of_1_is_that_of_forward_depth(share: float, found: bool) -> None:
    depth = spread(1.0, share, frame().depth)
    assert ("forward" in complaint(frame(depth=depth))) is found
    depth[-1] = 0.0  # a sky of reversed depth, too
    assert complaint(frame(depth=depth)) == ""


@pytest.mark.parametrize(
    ("least", "most", "found"),
    [(0.901, 0.99, True), (0.901, 0.974, False), (0.89, 0.99, False), (0.901, 0.976, True)],
)
def test_depth_all_close_to_1_that_spans_four_distances_is_forward(
    least: float, most: float, found: bool
) -> None:
    """Taken as reversed all would be within a tenth of the near plane's distance."""
    depth = np.full((SIZE[1], SIZE[0]), most, np.float32)
    depth[0] = least
    assert ("forward" in complaint(frame(depth=depth))) is found


@pytest.mark.parametrize(("value", "found"), [(0.9e6, False), (1.1e6, True)])
def test_a_depth_of_a_million_is_a_distance(value: float, found: bool) -> None:
    depth = frame().depth.copy()
    depth[3, 4] = value
    assert ("linear" in complaint(frame(depth=depth))) is found


def test_a_slope_whose_distance_is_linear_in_perspective_is_a_distance() -> None:
    y = np.mgrid[: SIZE[1], : SIZE[0]][0]
    inverse = (0.002 + 0.01 * y).astype(np.float32)  # a plane: near / distance is linear on the screen
    assert complaint(frame(depth=inverse)) == ""
    assert "linear" in complaint(frame(depth=1.0 / inverse))


@pytest.mark.parametrize(("share", "found"), [(0.04, False), (0.06, True)])
@pytest.mark.parametrize(("axis", "length"), [(0, 81.0), (1, -61.0)])
def test_motion_across_the_whole_image_is_too_long_in_a_twentieth_of_the_pixels(
    axis: int, length: float, share: float, found: bool
) -> None:
    motion = frame().motion.copy()
    motion[..., axis] = spread(length, share, motion[..., axis])
    assert ("longer than the whole image" in complaint(frame(motion=motion))) is found
    motion[..., axis] = np.clip(motion[..., axis], -59.0, 79.0)
    assert "longer" not in complaint(frame(motion=motion))


def parallax(by: float) -> NDArray[np.float32]:
    """The right half moves otherwise than the left one."""
    motion = frame().motion.copy()
    motion[:, SIZE[0] // 2 :, 0] = by
    return motion


def test_one_depth_everywhere_is_doubted_where_motion_is_not_that_of_a_card() -> None:
    card = np.full_like(frame().depth, 0.3)
    ramp = frame().motion.copy()
    ramp[..., 0] = 0.05 * np.arange(SIZE[0])
    assert complaint(frame(depth=card, motion=ramp)) == ""
    assert "same everywhere" in complaint(frame(depth=card, motion=parallax(4.0)))
    assert complaint(frame(depth=card, motion=parallax(0.9))) == ""
    assert complaint(frame(depth=0.0 * card, motion=parallax(4.0))) == "", "the sky"


@pytest.mark.parametrize("exposure", [1e-12, 1e12])
def test_an_exposure_out_of_range_is_said(exposure: float) -> None:
    assert "exposure" in complaint(frame(exposure=exposure))
    assert complaint(frame(exposure=1.0)) == ""


@pytest.mark.parametrize("turned", [False, True])
def test_colour_whose_edges_are_where_those_of_depth_are_upside_down_is_turned(turned: bool) -> None:
    depth, light = np.full((SIZE[1], SIZE[0]), 0.1, np.float32), np.full((SIZE[1], SIZE[0]), 0.2, np.float32)
    for top in (7, 19, 40):
        depth[top : top + 5], light[top : top + 5] = 0.3, 0.9
    color = np.repeat((light[::-1] if turned else light)[..., None], 3, axis=2)
    assert ("upside down" in complaint(frame(depth=depth, color=color))) is turned
    narrow = depth.copy()
    narrow[:, 30:] = 0.1  # 180 edges are too few
    assert "upside down" not in complaint(frame(depth=narrow, color=color))


def test_colour_that_looks_the_same_upside_down_is_left_alone() -> None:
    height = SIZE[1]
    depth, light = np.full((height, SIZE[0]), 0.1, np.float32), np.full((height, SIZE[0]), 0.2, np.float32)
    for top in (7, 19):
        for rows in (slice(top, top + 5), slice(height - top - 5, height - top)):
            depth[rows], light[rows] = 0.3, 0.9
    color = np.repeat(light[..., None], 3, axis=2)
    assert "upside down" not in complaint(frame(depth=depth, color=color))


def test_three_frames_of_a_start_are_read_and_each_kind_is_told_once() -> None:
    checker = FrameChecker("warn")

    jitters = itertools.count()

    def warned(**fields: Any) -> int:
        fields["jitter"] = halton_jitter(next(jitters), 2.0)  # one that stays is a mistake of its own
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always", FrameWarning)
            checker.check(frame(**fields), (160, 120))
        return len(caught)

    for _ in range(2):
        assert [warned(), warned(), warned(exposure=1e12), warned(exposure=1e12)] == [0, 0, 1, 0]
        checker.reset()
        assert [warned(), warned(), warned(), warned(exposure=1e12)] == [0, 0, 0, 0]
        assert warned(exposure=1e12, reset=True) == 1
        checker.reset()
        assert [warned(exposure=1e12), warned(exposure=1e12)] == [1, 0]
        checker.reset()


def test_what_is_kept_of_frames_goes_once_no_more_are_read() -> None:
    checker = FrameChecker("warn")
    for index in range(3):
        checker.check(frame(jitter=halton_jitter(index, 2.0)), (160, 120))
        assert checker._seen.previous is not None
    checker.check(frame(jitter=halton_jitter(3, 2.0)), (160, 120))
    assert checker._seen.previous is None


@pytest.mark.parametrize(("edges", "mixed"), [(59, 0.0), (60, 1.0)])
def test_mixed_edges_are_judged_from_sixty_on(edges: int, mixed: float) -> None:
    height = edges + 2  # the first and the last row have no neighbours to compare
    light = np.tile(np.array([0.1, 0.1, 0.1, 0.4, 1.0, 1.0, 1.0], np.float32), (height, 1))
    depth = np.tile(np.array([0.1, 0.1, 0.1, 0.5, 0.5, 0.5, 0.5], np.float32), (height, 1))
    assert mixed_edges(light, depth) == mixed
