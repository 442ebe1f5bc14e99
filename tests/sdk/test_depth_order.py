"""Tests of `bend`, the curvature of depth by which the detector tells its kind."""

import numpy as np
import pytest

from supersampler.conventions import Conventions
from supersampler.frame import Float32, Frame
from supersampler.validation.probe import FrameProbe, count_disoccluded, plane_curvature, sky_fraction
from supersampler.validation.rankings import rank_depth


def plane(height: int, width: int, slope: float = 1e-4) -> Float32:
    """1 / distance of a plane, float32."""
    rows, columns = np.mgrid[:height, :width]
    return np.asarray(0.1 + slope * (columns + 0.5 * rows), np.float32)


@pytest.mark.parametrize(("height", "width"), [(300, 1300), (1300, 300), (60, 80)])
def test_a_plane_in_the_middle_has_no_bend_whatever_is_around_it(height: int, width: int) -> None:
    depth = plane(height, width)
    far_off = np.ones_like(depth, dtype=bool)
    far_off[max(0, height // 2 - 200) : height // 2 + 200, max(0, width // 2 - 200) : width // 2 + 200] = (
        False
    )
    depth[far_off] = np.random.default_rng(0).random(far_off.sum(), np.float32)
    assert plane_curvature(depth, "reversed") == 0.0


@pytest.mark.parametrize("axis", [0, 1])
@pytest.mark.parametrize("flip", [False, True])
def test_the_middle_begins_and_ends_200_pixels_from_the_centre(axis: int, flip: bool) -> None:
    """A little more than half of the middle is a plane, and reaches its edge: the median is of the plane."""
    depth = np.random.default_rng(0).random((1300, 400), np.float32)
    depth[450:670] = plane(220, 400)
    depth = depth[::-1] if flip else depth
    assert plane_curvature(depth if axis == 0 else depth.T, "reversed") == 0.0


def test_rounding_of_forward_depth_is_that_of_numbers_near_1() -> None:
    rows, columns = np.mgrid[:200, :300]
    inverse = 1e-3 + 2e-5 * columns + 2e-5 * rows
    assert plane_curvature((1.0 - inverse).astype(np.float32), "forward") == 0.0


def test_depth_that_is_read_in_the_wrong_order_is_bent() -> None:
    linear = 1.0 / plane(200, 300, 1e-3)
    assert plane_curvature(linear, "linear") == 0.0
    assert plane_curvature(linear, "reversed") > 1e-3


@pytest.mark.parametrize(("pixels", "error"), [(0, 1.0), (1, 0.5), (2, 0.5)])
def test_sky_in_a_thousandth_of_the_pixels_speaks_for_its_order(pixels: int, error: float) -> None:
    """Where no order finds a sky, each is half wrong; nothing is disoccluded, which is half wrong too."""
    depth = plane(25, 40, 1e-3)
    depth.ravel()[:pixels] = 0.0
    color, motion = np.ones((25, 40, 3), np.float32), np.zeros((25, 40, 2), np.float32)
    frame = FrameProbe.of_frame(Frame(color=color, depth=depth, motion=motion, jitter=(0.0, 0.0)))
    found = rank_depth([], [frame], Conventions()).ranked[0]
    assert found.overrides["depth"] == "reversed_infinite"
    assert found.error == pytest.approx(error, abs=0.01)


def test_linear_depth_is_sky_from_a_million_on() -> None:
    assert sky_fraction(np.array([[1e6, np.inf]]), "linear") == 1.0
    assert sky_fraction(np.array([[0.999e6, 1.0]]), "linear") == 0.0


@pytest.mark.parametrize("row", [-2, -1, 0, 1, 2])
@pytest.mark.parametrize("column", [-2, -1, 0, 1, 2])
def test_a_surface_in_the_3x3_pixels_around_a_place_is_one_of_its_own(row: int, column: int) -> None:
    """Depth was 0.2 everywhere; a pixel of 0.3 nearby says that what was there is no closer surface."""
    now, before = np.full((9, 9), 0.1, np.float32), np.full((9, 9), 0.2, np.float32)
    now[4 + row, 4 + column] = 0.3
    middle = np.array([4])
    found = count_disoccluded(now, before, "reversed", (middle, middle), np.zeros((1, 2)))
    assert found == ((0, 0) if max(abs(row), abs(column)) < 2 else (1, 0))


def test_a_surface_that_comes_a_little_closer_is_its_own() -> None:
    """An object that approaches, by 9 % of its distance in a frame, is no surface before a farther one."""
    middle, now = np.array([4]), np.full((9, 9), 0.2, np.float32)

    def found(before: float) -> tuple[int, int]:
        earlier = np.full((9, 9), before, np.float32)
        return count_disoccluded(now, earlier, "reversed", (middle, middle), np.zeros((1, 2)))

    assert found(0.2 / 1.09) == (0, 0)
    assert found(0.2 / 1.11) == (0, 1)
