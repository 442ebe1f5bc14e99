"""Masks of difficult pixels, on scenes small enough to count by hand."""

import dataclasses

import numpy as np
from numpy.typing import NDArray

from supersampler import Frame
from supersampler_bench.quality import masks


def frame(depth: NDArray[np.float32], motion: tuple[float, float] = (0, 0), **fields: object) -> Frame:
    """A black frame whose pixels all move alike."""
    height, width = depth.shape
    vectors = np.broadcast_to(np.array(motion, np.float32), (height, width, 2))
    given = {"color": np.zeros((height, width, 3), np.float32), "motion": vectors, "jitter": (0.0, 0.0)}
    return Frame(**{**given, "depth": depth, **fields})  # type: ignore[arg-type]


def wall(near_columns: slice) -> NDArray[np.float32]:
    """(4, 10) depth: a far wall with near pixels in some columns."""
    depth = np.full((4, 10), 0.01, np.float32)
    depth[:, near_columns] = 0.1
    return depth


def test_moving_pixels_move_by_more_than_half_a_pixel() -> None:
    motion = np.zeros((4, 10, 2), np.float16)
    motion[1, 2] = (0.4, 0.4)
    motion[1, 3] = (0.4, 0.2)
    motion[3, 9] = (-3, 0)
    still = frame(wall(slice(0)), motion=(0, 0))
    assert np.argwhere(masks.moving(dataclasses.replace(still, motion=motion))).tolist() == [[1, 2], [3, 9]]


def test_only_pixels_that_a_moved_object_covered_are_disoccluded() -> None:
    motion = np.zeros((4, 10, 2), np.float32)
    motion[:, 5:8, 0] = -2  # the near columns were two pixels to the left
    now = dataclasses.replace(frame(wall(slice(5, 8))), motion=motion)
    found = masks.disoccluded(now, frame(wall(slice(3, 6))))
    assert np.unique(np.nonzero(found)[1]).tolist() == [3, 4]
    assert found[:, 3:5].all()


def test_pixels_from_off_screen_are_disoccluded() -> None:
    found = masks.disoccluded(frame(wall(slice(0)), motion=(2, 0)), frame(wall(slice(0))))
    assert np.unique(np.nonzero(found)[1]).tolist() == [8, 9]


def test_the_sky_behind_an_object_is_disoccluded() -> None:
    sky, before = np.zeros((4, 10), np.float32), np.full((4, 10), 0.1, np.float32)
    assert masks.disoccluded(frame(sky), frame(before)).all()
    assert not masks.disoccluded(frame(sky), frame(sky)).any()


def test_jitter_alone_disoccludes_nothing() -> None:
    # something near from x = 4 to 7, sampled at column + 1 and then at column + 0
    now = frame(wall(slice(3, 6)), jitter=(0.5, -0.5))
    assert not masks.disoccluded(now, frame(wall(slice(4, 7)), jitter=(-0.5, 0.5))).any()


def test_without_a_history_everything_is_disoccluded() -> None:
    assert masks.disoccluded(frame(wall(slice(0))), None).all()
    assert masks.disoccluded(frame(wall(slice(0)), reset=True), frame(wall(slice(0)))).all()


def test_a_change_of_the_render_size_disoccludes_nothing_by_itself() -> None:
    motion = np.zeros((4, 10, 2), np.float32)
    motion[:, 6:10, 0] = -4  # the near columns were four pixels to the left, at half of this size
    now = dataclasses.replace(frame(wall(slice(6, 10))), motion=motion)
    before = np.full((2, 5), 0.01, np.float32)
    before[:, 1:3] = 0.1
    found = masks.disoccluded(now, frame(before))
    assert np.unique(np.nonzero(found)[1]).tolist() == [3, 4]


def test_display_pixels_take_the_nearest_sample() -> None:
    plane = np.arange(3.0)[None, :].repeat(2, axis=0)
    np.testing.assert_array_equal(masks.to_display(plane, (0, 0), (6, 4))[0], [0, 0, 1, 1, 2, 2])
    # samples at centre + 0.4: display pixel 2, at 0.75 in the input, is nearer to sample 0 (at 0.4)
    np.testing.assert_array_equal(masks.to_display(plane, (0.4, 0), (6, 4))[0], [0, 0, 0, 1, 1, 2])
    assert masks.to_display(plane, (0, 0), (5, 3)).shape == (3, 5)


def test_motion_grows_with_the_ratio_of_each_axis() -> None:
    motion = masks.display_motion(frame(wall(slice(0)), motion=(1.5, -2)), (20, 12))
    assert motion.shape == (12, 20, 2)
    np.testing.assert_array_equal(motion[0, 0], [3.0, -6.0])
