"""Tests of the detector's parts: chosen frames, jitter readings, rankings."""

from typing import Any

import numpy as np
import pytest

from supersampler.conventions import Conventions, RawFrame
from supersampler.errors import ArgumentError, FrameError
from supersampler.validation.detection import _middle
from supersampler.validation.probe import FrameProbe
from supersampler.validation.rankings import jitters_in_the_pixel, rank_jitter, rank_motion
from supersampler.validation.reprojection import frame_pairs

SIZE = (8, 6)


def raw(jitter: tuple[float, float] = (0.0, 0.0), **fields: Any) -> RawFrame:
    w, h = SIZE
    plain: dict[str, Any] = {
        "color": np.ones((h, w, 3), np.float32),
        "depth": np.full((h, w), 0.5, np.float32),
        "motion": np.zeros((h, w, 2), np.float32),
    }
    return RawFrame(**{**plain, **fields}, jitter=jitter)


def readings(*jitters: tuple[float, float]) -> set[tuple[str, int, bool]]:
    seen = [FrameProbe.of_raw(raw(jitter), Conventions()) for jitter in jitters]
    found = jitters_in_the_pixel(seen, Conventions())
    return {(o["jitter_unit"], o["jitter_sign"], o["jitter_flip_y"]) for o in found}


def units(found: set[tuple[str, int, bool]]) -> set[str]:
    return {unit for unit, _, _ in found}


def test_a_jitter_that_never_changes_tells_nothing() -> None:
    assert readings((0.1, 0.2), (0.1, 0.2)) == set()


@pytest.mark.parametrize("other", [(0.3, 0.2), (0.1, -0.2)])
def test_a_jitter_that_changes_along_one_axis_alone_is_read(other: tuple[float, float]) -> None:
    assert units(readings((0.1, 0.2), other)) == {"pixels"}


def test_units_are_those_that_leave_samples_in_their_pixel() -> None:
    """Of 8x6 pixels one is 1/8 and 1/6 wide in UV, and twice that in NDC."""
    assert units(readings((0.0, 0.0), (0.06, 0.08))) == {"pixels", "uv", "ndc"}
    assert units(readings((0.0, 0.0), (0.12, 0.16))) == {"pixels", "ndc"}
    assert units(readings((0.0, 0.0), (0.13, 0.0))) == {"pixels"}
    assert units(readings((0.0, 0.0), (0.5, -0.5))) == {"pixels"}
    assert readings((0.0, 0.0), (0.51, 0.0)) == set()
    assert len(readings((0.0, 0.0), (0.06, 0.08))) == 12


@pytest.mark.parametrize(
    ("length", "asked", "seen"),
    [(10, 4, [3, 4, 5, 6]), (9, 4, [2, 3, 4, 5]), (3, 6, [0, 1, 2]), (2, 2, [0, 1])],
)
def test_frames_are_taken_from_the_middle(length: int, asked: int, seen: list[int]) -> None:
    shot = [raw((0.01 * index, 0.0)) for index in range(length)]
    assert [round(100 * (frame.jitter or (0, 0))[0]) for frame in _middle(shot, asked)] == seen


@pytest.mark.parametrize(("length", "asked"), [(1, 2), (0, 2), (5, 1), (5, "many")])
def test_fewer_than_two_frames_cannot_be_compared(length: int, asked: Any) -> None:
    with pytest.raises(ArgumentError, match="frames"):
        _middle([raw()] * length, asked)


def test_vectors_of_display_size_are_read_at_the_middle_of_render_pixels() -> None:
    w, h = SIZE
    x, y = np.meshgrid(np.arange(2 * w), np.arange(2 * h))
    seen = FrameProbe.of_raw(raw(motion=np.stack([x, y], axis=-1).astype(np.float32)), Conventions())
    places = np.array([0, 2, 5]), np.array([0, 3, 7])
    want = np.array([[1, 1], [7, 5], [15, 11]])  # (2 i + 1) * 2 h // (2 h): the lower right of four
    plain = Conventions(motion_resolution="display", motion_unit="uv")
    np.testing.assert_allclose(seen.vectors(plain, places), want * [w, h])
    np.testing.assert_allclose(seen.vectors(plain, places, swapped=True), want[:, ::-1] * [w, h])


def test_rows_of_bottom_up_frames_are_turned_and_srgb_is_decoded() -> None:
    color = np.full((6, 8, 3), 0.5, np.float32)
    color[0] = 0.0
    seen = FrameProbe.of_raw(raw(color=color, depth=color[..., 0]), Conventions(bottom_up=True, srgb=True))
    assert seen.light is not None
    assert seen.light[-1, 0] == 0.0
    assert seen.light[0, 0] == pytest.approx(0.214, abs=1e-3)
    assert seen.depth[-1, 0] == 0.0


def test_only_shaded_neighbours_of_one_size_without_a_cut_are_compared() -> None:
    small = RawFrame(
        color=np.ones((3, 4, 3), np.float32), depth=np.ones((3, 4), np.float32),
        motion=np.zeros((3, 4, 2), np.float32), jitter=(0.0, 0.0),
    )  # fmt: skip
    plain, cut, dark = raw((0.1, 0.2)), raw((0.3, -0.1), reset=True), raw(color=None)

    def compared(*frames: RawFrame) -> int:
        return len(frame_pairs([FrameProbe.of_raw(frame, Conventions()) for frame in frames]))

    assert compared(plain, plain, plain) == 2
    assert compared(plain, cut) == 0
    assert compared(cut, plain) == 1
    assert compared(plain, dark) == compared(dark, plain) == 0
    assert compared(plain, small) == 0
    [pair] = frame_pairs([FrameProbe.of_raw(frame, Conventions()) for frame in (plain, raw((0.3, -0.1)))])
    np.testing.assert_allclose(pair.shift(Conventions()), [0.2, -0.3])
    np.testing.assert_allclose(pair.shift(Conventions(jitter_sign=-1)), [-0.2, 0.3])


@pytest.mark.parametrize(
    "fields", [{"depth": np.ones((6, 8, 1))}, {"motion": np.ones((6, 8))}, {"motion": np.ones((6, 8, 3))}]
)
def test_depth_and_motion_of_another_shape_are_refused(fields: dict[str, Any]) -> None:
    with pytest.raises(FrameError, match="motion"):
        FrameProbe.of_raw(raw(**fields), Conventions())


def test_what_cannot_be_told_is_said_with_the_reason() -> None:
    jitters = [{"jitter_unit": "pixels", "jitter_sign": 1, "jitter_flip_y": False}]
    assert "texture" in rank_motion([], jitters, Conventions()).reason
    assert "texture" in rank_jitter([], jitters, Conventions()).reason
    assert "never changes" in rank_jitter([], [], Conventions()).reason
    jittered = Conventions(motion_jittered=True)
    assert "three frames" in rank_jitter([], jitters, jittered).reason
    seen = [FrameProbe.of_raw(raw((0.1 * i, 0.2)), Conventions()) for i in range(3)]
    assert "three frames" in rank_jitter(frame_pairs(seen[:2]), jitters, jittered).reason
    assert rank_jitter(frame_pairs(seen), jitters, jittered).certain
