"""The class of thin objects: by width, at any angle and place, and never at the edges of what is wide."""

from collections.abc import Callable

import numpy as np
import pytest

from supersampler_model.data.labels import PixelStatistics, thin
from supersampler_model.data.scenes.scene import Values

SIZE, SIDE = (40, 48), 8  # rows and columns; samples along each axis of a pixel
FAR, NEAR = 0.01, 0.05
ANGLES = (0.0, 0.3, np.pi / 4.0, 1.2, np.pi / 2.0)
PLACES = (0.0, 0.23, 0.5, 0.71)


def pixels_of(depth: Callable[[Values, Values], Values]) -> PixelStatistics:
    """Return the statistics of a depth given as a function of x and y, in pixels from the centre."""
    x, y = ((np.arange(count * SIDE) + 0.5) / SIDE - count / 2.0 for count in SIZE[::-1])
    samples = depth(*np.meshgrid(x, y)).reshape(SIZE[0], SIDE, SIZE[1], SIDE)
    flat, grey = np.zeros(SIZE, np.float32), np.zeros((*SIZE, 3), np.float32)
    low, high = (extreme(samples, axis=(1, 3)).astype(np.float32) for extreme in (np.min, np.max))
    return PixelStatistics(
        depth_min=low, depth_max=high, color_min=grey, color_max=grey, color=grey, normal_spread=flat,
        normal_mapped_spread=flat,
    )  # fmt: skip


def bar(width: float, angle: float, place: float) -> PixelStatistics:
    """Return a bar through the image before something far, `place` pixels off the centre."""

    def depth(x: Values, y: Values) -> Values:
        across = x * np.cos(angle) + y * np.sin(angle) - place
        return np.where(np.abs(across) < width / 2.0, NEAR, FAR)

    return pixels_of(depth)


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("angle", ANGLES)
def test_a_bar_less_than_two_pixels_wide_is_thin_and_one_more_than_four_wide_is_not(
    angle: float, place: float
) -> None:
    for width in (0.2, 1.0, 1.8):
        pixels = bar(width, angle, place)
        np.testing.assert_array_equal(thin(pixels), pixels.depth_max == np.float32(NEAR))
        assert thin(pixels).any()
    for width in (4.1, 9.0):  # less is left where a corner of the image cuts it
        assert not thin(bar(width, angle, place))[3:-3, 3:-3].any()


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("angle", ANGLES)
def test_corners_and_edges_of_a_sloping_plane_are_not_thin(angle: float, place: float) -> None:
    """The plane recedes by a tenth of its depth a pixel, as a floor near the horizon."""

    def depth(x: Values, y: Values) -> Values:
        u = (x - place) * np.cos(angle) + y * np.sin(angle)
        v = y * np.cos(angle) - (x - place) * np.sin(angle)
        plane = NEAR * (1.0 + 0.1 * np.clip(u, -9.0, 9.0))
        return np.where((np.abs(u) < 9.0) & (np.abs(v) < 9.0), plane, 0.0)

    pixels = pixels_of(depth)
    assert (pixels.depth_max > 0.0).sum() > 300
    assert not thin(pixels).any()


def test_decals_are_not_in_front_of_their_surface() -> None:
    def depth(x: Values, _: Values) -> Values:
        return np.where(np.abs(x) < 0.4, 1.005 * NEAR, NEAR)

    assert not thin(pixels_of(depth)).any()


def test_a_thin_bar_is_found_beside_a_wall_that_is_farther_and_not_beside_one_that_is_nearer() -> None:
    def beside(wall: float) -> PixelStatistics:
        return pixels_of(lambda x, y: np.where(np.abs(y) < 0.5, NEAR, np.where(x > 0.0, wall, FAR)))

    for wall, expected in ((0.04, 48), (0.06, 22)):  # columns; within two pixels of a nearer wall it is not
        found = thin(beside(wall))
        assert (found.sum(axis=1) == [expected if row in (19, 20) else 0 for row in range(40)]).all()
