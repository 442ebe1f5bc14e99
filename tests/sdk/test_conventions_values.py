"""Tests of converted values against numbers computed by hand, as round trips can hide errors."""

import math
from typing import Any

import numpy as np
import pytest

from supersampler.conventions import Conventions, RawFrame
from supersampler.errors import ArgumentError, FrameError
from supersampler.frame import Float32, Frame

RENDER, DISPLAY = (3, 2), (6, 4)
JITTER = (0.4, -0.3)


def numbered(size: tuple[int, int]) -> Float32:
    """Vectors that say which pixel they are of: (column, row)."""
    x, y = np.meshgrid(np.arange(size[0]), np.arange(size[1]))
    return np.stack([x, y], axis=-1).astype(np.float32)


def raw(**fields: Any) -> RawFrame:
    """A small frame of which all is plain but what is given."""
    w, h = RENDER
    plain: dict[str, Any] = {
        "color": np.ones((h, w, 3), np.float32),
        "depth": np.full((h, w), 0.5, np.float32),
        "motion": np.zeros((h, w, 2), np.float32),
        "jitter": (0.0, 0.0),
    }
    return RawFrame(**{**plain, **fields})


def frame(**fields: Any) -> Frame:
    w, h = RENDER
    plain: dict[str, Any] = {
        "color": np.ones((h, w, 3), np.float32),
        "depth": np.full((h, w), 0.5, np.float32),
        "motion": np.zeros((h, w, 2), np.float32),
        "jitter": (0.0, 0.0),
    }
    return Frame(**{**plain, **fields})


def test_motion_of_display_size_is_read_where_the_samples_lie() -> None:
    """Of column i at ratio 2 the sample lies in display column floor(2 (i + 0.5 + jitter))."""
    conventions = Conventions(motion_resolution="display", motion_unit="uv")
    motion = numbered(DISPLAY) / np.array(RENDER, np.float32)
    got = conventions.converter().to_frame(raw(motion=motion, jitter=JITTER)).motion
    np.testing.assert_allclose(got[..., 0], [[1, 3, 5]] * 2, rtol=1e-6)
    np.testing.assert_allclose(got[..., 1], [[0] * 3, [2] * 3], rtol=1e-6)


def test_motion_of_display_size_is_written_from_the_sample_of_each_pixel() -> None:
    """Display column p looks at floor((p + 0.5) / 2 - jitter), rows likewise, within the frame."""
    conventions = Conventions(motion_resolution="display", motion_unit="uv")
    converter = conventions.converter(display_size=DISPLAY)
    got = np.asarray(converter.from_frame(frame(motion=numbered(RENDER), jitter=JITTER)).motion) * RENDER
    np.testing.assert_allclose(got[..., 0], [[0, 0, 0, 1, 1, 2]] * 4, rtol=1e-6)
    np.testing.assert_allclose(got[..., 1], [[0] * 6, [1] * 6, [1] * 6, [1] * 6], rtol=1e-6)


def test_pixels_of_display_size_are_shorter_than_those_of_render_size() -> None:
    conventions = Conventions(motion_resolution="display")
    motion = np.broadcast_to(np.array([4.0, -6.0], np.float32), (4, 6, 2))
    got = conventions.converter().to_frame(raw(motion=motion)).motion
    np.testing.assert_array_equal(got, np.broadcast_to([2.0, -3.0], (2, 3, 2)))


@pytest.mark.parametrize(
    ("fields", "vector"),
    [
        ({"motion_unit": "pixels"}, (1.0, 2.0)),
        ({"motion_unit": "uv"}, (3.0, 4.0)),
        ({"motion_unit": "ndc"}, (1.5, -2.0)),
        ({"motion_direction": "current_minus_previous"}, (-1.0, -2.0)),
        ({"motion_flip_y": True}, (1.0, -2.0)),
        ({"motion_scale": (5.0, -0.5)}, (5.0, -1.0)),
    ],
)
def test_a_stored_vector_becomes_render_pixels(fields: dict[str, Any], vector: tuple[float, float]) -> None:
    motion = np.broadcast_to(np.array([1.0, 2.0], np.float32), (2, 3, 2))
    got = Conventions(**fields).converter().to_frame(raw(motion=motion)).motion
    np.testing.assert_allclose(got, np.broadcast_to(vector, (2, 3, 2)))


@pytest.mark.parametrize(
    ("fields", "jitter"),
    [
        ({}, (0.1, 0.2)),
        ({"jitter_sign": -1}, (-0.1, -0.2)),
        ({"jitter_flip_y": True}, (0.1, -0.2)),
        ({"jitter_unit": "uv"}, (0.3, 0.4)),
        ({"jitter_unit": "ndc"}, (0.15, -0.2)),
    ],
)
def test_a_stored_jitter_becomes_render_pixels(fields: dict[str, Any], jitter: tuple[float, float]) -> None:
    got = Conventions(**fields).converter().to_frame(raw(jitter=(0.1, 0.2))).jitter
    assert got == pytest.approx(jitter)


def test_a_jitter_of_half_a_pixel_survives_rounding_and_a_longer_one_is_refused() -> None:
    convert = Conventions().converter().to_frame
    assert convert(raw(jitter=(0.50005, -0.50005))).jitter == (0.5, -0.5)
    with pytest.raises(FrameError, match="jitter"):
        convert(raw(jitter=(0.502, 0.0)))


def test_jittered_motion_loses_the_difference_of_both_jitters() -> None:
    """Previous minus current, rendered at p - jitter, holds - previous + current jitter."""
    converter = Conventions(motion_jittered=True).converter()
    first = converter.to_frame(raw(jitter=(0.1, 0.2)))
    second = converter.to_frame(raw(jitter=(0.4, -0.3)))
    np.testing.assert_array_equal(first.motion, 0.0)
    np.testing.assert_allclose(second.motion, np.broadcast_to([-0.3, 0.5], (2, 3, 2)), rtol=1e-6)
    cut = converter.to_frame(raw(jitter=(-0.2, 0.1), reset=True))
    np.testing.assert_array_equal(cut.motion, 0.0)
    assert np.any(converter.to_frame(raw(jitter=(0.4, 0.0))).motion)


def test_a_frame_that_is_passed_over_counts_for_the_next_ones_jitter() -> None:
    converter = Conventions(motion_jittered=True, jitter_sign=-1).converter()
    converter.pass_over((-0.1, -0.2), RENDER)
    got = converter.to_frame(raw(jitter=(-0.4, 0.3)))
    np.testing.assert_allclose(got.motion, np.broadcast_to([-0.3, 0.5], (2, 3, 2)), rtol=1e-6)


def test_the_jitter_before_is_scaled_where_the_render_size_changes() -> None:
    converter = Conventions(motion_jittered=True).converter()
    converter.pass_over((0.2, 0.2), (6, 4))  # 0.1 of a pixel of half the size
    got = converter.to_frame(raw(jitter=(0.4, 0.4)))
    np.testing.assert_allclose(got.motion, np.broadcast_to([-0.3, -0.3], (2, 3, 2)), rtol=1e-6)


NEAR, FAR = 0.5, 50.0
DISTANCES = np.array([[0.5, 1.0, 5.0], [25.0, 50.0, 50.0]], np.float32)


@pytest.mark.parametrize(
    ("kind", "stored"),
    [
        ("linear", DISTANCES),
        ("reversed", NEAR * (FAR - DISTANCES) / (DISTANCES * (FAR - NEAR))),
        ("forward", 1.0 - NEAR * (FAR - DISTANCES) / (DISTANCES * (FAR - NEAR))),
    ],
)
def test_depth_with_a_far_plane_becomes_near_over_distance_and_0_at_the_plane(
    kind: Any, stored: Float32
) -> None:
    conventions = Conventions(depth=kind, near=NEAR, far=FAR)
    got = conventions.converter().to_frame(raw(depth=stored.astype(np.float32))).depth
    want = np.where(DISTANCES < FAR, NEAR / DISTANCES, 0.0)
    np.testing.assert_allclose(got, want, rtol=1e-4, atol=1e-6)
    back = conventions.converter().from_frame(frame(depth=want.astype(np.float32))).depth
    np.testing.assert_allclose(np.asarray(back), stored, rtol=1e-4, atol=1e-6)


def test_depth_without_a_far_plane_becomes_near_over_distance() -> None:
    want = NEAR / DISTANCES
    for kind, stored in (
        ("linear", DISTANCES),
        ("forward_infinite", 1.0 - want),
        ("reversed_infinite", want),
    ):
        got = Conventions(depth=kind, near=NEAR).converter().to_frame(raw(depth=stored)).depth  # type: ignore[arg-type]
        np.testing.assert_allclose(got, want, rtol=1e-5)


def test_the_sky_has_no_distance_and_0_is_none_without_a_warning() -> None:
    sky = np.zeros((2, 3), np.float32)
    linear, bounded = Conventions(depth="linear", near=NEAR), Conventions(depth="linear", near=NEAR, far=FAR)
    assert np.isposinf(linear.converter().from_frame(frame(depth=sky)).depth).all()
    assert (np.asarray(bounded.converter().from_frame(frame(depth=sky)).depth) == FAR).all()
    assert not linear.converter().to_frame(raw(depth=sky)).depth.any()  # 0 is no distance of a surface
    assert not linear.converter().to_frame(raw(depth=sky + np.inf)).depth.any()


def test_a_surface_beyond_the_far_plane_cannot_be_written() -> None:
    depth = np.full((2, 3), 0.5, np.float32)
    depth[1, 2] = 0.99 * NEAR / FAR
    with pytest.raises(FrameError, match="beyond the far plane"):
        Conventions(depth="reversed", near=NEAR, far=FAR).converter().from_frame(frame(depth=depth))


def test_a_surface_at_the_far_plane_may_be_rounded() -> None:
    depth = np.full((2, 3), NEAR / FAR, np.float32)
    depth[1] *= 1.0 - 5e-6
    stored = (
        Conventions(depth="reversed", near=NEAR, far=FAR).converter().from_frame(frame(depth=depth)).depth
    )
    np.testing.assert_allclose(np.asarray(stored), 0.0, atol=1e-6)


def test_rows_are_turned_in_every_buffer_and_colours_decoded() -> None:
    rows = np.array([[0.04, 0.04, 0.04], [0.5, 0.5, 0.5]], np.float32)
    stored = raw(
        color=np.repeat(rows[..., None], 3, axis=2), depth=rows, motion=np.repeat(rows[..., None], 2, axis=2),
        aovs=rows[..., None], gbuffer={"roughness": rows}, gbuffer_display={"depth": rows},
    )  # fmt: skip
    got = Conventions(bottom_up=True, srgb=True).converter().to_frame(stored)
    assert got.color is not None
    assert got.aovs is not None
    assert got.gbuffer is not None
    assert got.gbuffer_display is not None
    linear = [((0.5 + 0.055) / 1.055) ** 2.4, 0.04 / 12.92]
    np.testing.assert_allclose(got.color[:, 0, 0], linear, rtol=1e-5)
    for buffer in (got.depth, got.motion[..., 0], got.aovs[..., 0], got.gbuffer["roughness"]):
        np.testing.assert_allclose(buffer[:, 0], [0.5, 0.04])
    np.testing.assert_allclose(got.gbuffer_display["depth"][:, 0], [0.5, 0.04])


def test_motion_of_another_size_is_refused_and_a_larger_one_with_a_hint() -> None:
    motion = np.zeros((4, 5, 2), np.float32)
    with pytest.raises(FrameError, match="motion_resolution='display'"):
        Conventions().converter().to_frame(raw(motion=motion))
    for smaller in (motion[:1], motion[:, :2]):
        with pytest.raises(FrameError) as refused:
            Conventions().converter().to_frame(raw(motion=smaller))
        assert "motion_resolution" not in str(refused.value)
        with pytest.raises(FrameError, match="at least"):
            Conventions(motion_resolution="display").converter().to_frame(raw(motion=smaller))


@pytest.mark.parametrize("display", [(2, 4), (6, 1)])
def test_a_display_smaller_than_the_frame_is_refused(display: tuple[int, int]) -> None:
    converter = Conventions(motion_resolution="display").converter(display_size=display)
    with pytest.raises(ArgumentError, match="display_size"):
        converter.from_frame(frame())


@pytest.mark.parametrize(
    ("fields", "refused"),
    [
        ({"near": 0.0}, "near"),
        ({"near": -1.0}, "near"),
        ({"near": math.inf}, "near"),
        ({"depth": "reversed"}, "far"),
        ({"depth": "forward"}, "far"),
        ({"depth": "reversed", "near": 1.0, "far": 1.0}, "far"),
        ({"depth": "reversed", "near": 1.0, "far": math.nan}, "far"),
        ({"depth": "reversed_infinite", "far": 10.0}, "far"),
        ({"jitter_sign": 0}, "jitter_sign"),
        ({"motion_scale": (1.0, 0.0)}, "motion_scale"),
        ({"motion_scale": (1.0, 1.0, 1.0)}, "motion_scale"),
        ({"srgb": 1}, "srgb"),
    ],
)
def test_planes_signs_and_scales_that_make_no_sense_are_refused(fields: dict[str, Any], refused: str) -> None:
    with pytest.raises(ArgumentError, match=refused):
        Conventions(**fields)


@pytest.mark.parametrize("background", [0.0, -0.0, np.inf])
def test_the_background_of_linear_depth_is_sky_beside_surfaces(background: float) -> None:
    depth = np.array([[2.0, background, 1.0], [np.nan, 4.0, 8.0]], np.float32)
    got = Conventions(depth="linear", near=1.0).converter().to_frame(raw(depth=depth))
    np.testing.assert_array_equal(got.depth, np.array([[0.5, 0.0, 1.0], [np.nan, 0.25, 0.125]], np.float32))
