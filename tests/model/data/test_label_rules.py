"""Each label rule computes its equation, per pixel and at any image size."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays
from numpy.typing import NDArray

from label_samples import Sample, statistics_of
from supersampler.frame import Float32
from supersampler_model.data.labels import (
    Alias,
    Ghost,
    LabelInputs,
    LabelThresholds,
    PixelStatistics,
    aliasing,
    box_overlap,
    color_varies,
    label,
    opened,
    plane_slope,
    toned,
)
from supersampler_model.data.scenes.analytic import FAR, NEAR

Mask = NDArray[np.bool_]
FILL = {"depth": 0.05, "color": 0.5, "normal": 0.0, "motion": 0.0}
RELIT = {"color_max": 0.6, "color_min": 0.6}
HIDDEN = {"depth_before": 0.04, "motion": -0.8}  # both components
few = settings(max_examples=40, deadline=None)


def evidence(shape: tuple[int, int] = (9, 12), **overrides: Any) -> LabelInputs:
    """Return a still, grey, flat surface; overrides are arrays, or numbers that fill one."""
    channels = {"color": (3,), "motion": (2,)}
    fields: dict[str, Any] = {}
    for name in (*PixelStatistics.__dataclass_fields__, "motion", "depth_before"):
        kind = name.split("_")[0]
        values = np.asarray(overrides.get(name, FILL[kind]), np.float32)
        fields[name] = np.broadcast_to(values, (*shape, *channels.get(kind, ())))
    frame = {name: fields.pop(name) for name in ("motion", "depth_before")}
    return LabelInputs(pixels=PixelStatistics(**fields), **frame)


def changed(**in_the_middle: float) -> tuple[LabelInputs, LabelInputs]:
    """Two frames alike but for what is given, in 5x5 pixels of the current one."""
    shape, still = (9, 12), evidence()
    now = {}
    for name, value in in_the_middle.items():
        array: Float32 = getattr(still if name in ("motion", "depth_before") else still.pixels, name).copy()
        array[2:7, 4:9] = value
        now[name] = array
    return evidence(shape, **now), still


@pytest.mark.parametrize(
    ("name", "value", "change", "map_", "expected"),
    [
        ("color_change", 0.101, RELIT, "ghost", Ghost.SHADING),
        ("color_overlap", 0.0, RELIT, "ghost", Ghost.SHADING),
        ("box_padding", 0.5, RELIT, "ghost", Ghost.SHADING),
        ("openings", 3, RELIT, "ghost", Ghost.SHADING),
        ("depth_ghost", 0.21, HIDDEN, "ghost", Ghost.VISIBILITY),
        ("velocity", 1.3, HIDDEN, "ghost", Ghost.VISIBILITY),
        ("depth_alias", 0.21, {"depth_min": 0.04}, "alias", Alias.GEOMETRY),
        ("normal", 0.7, {"normal_spread": 0.6}, "alias", Alias.GEOMETRY),
        ("normal", 0.7, {"normal_mapped_spread": 0.6}, "alias", Alias.TEXTURE),
        ("color_range", 0.8, {"color_min": 0.25}, "alias", Alias.TEXTURE),  # 1 and 1/3, linear
        ("darkest", 0.5, {"color_min": 0.25}, "alias", Alias.TEXTURE),
    ],
)
def test_each_threshold_moves_its_own_rule(
    name: str, value: Any, change: dict[str, float], map_: str, expected: int
) -> None:
    now, before = changed(**change)
    found = getattr(label(now, before), map_)
    assert (found[2:7, 4:9] == expected).all()
    assert np.count_nonzero(found) == 25
    assert not getattr(label(now, before, LabelThresholds(**{name: value})), map_).any()


def test_visibility_ghosting_needs_something_closer_before_and_another_velocity() -> None:
    for change in ({"depth_before": 0.04}, {"motion": -0.8}, {"depth_before": 0.06, "motion": -0.8}):
        assert not label(*changed(**change)).ghost.any()


@pytest.mark.parametrize(
    ("beside", "spreads_to"),
    [
        ({}, np.s_[3:6, 5:8]),
        ({"depth": 0.07}, np.s_[3:6, 6:7]),  # what is in front keeps its history
        ({"motion": 3.0}, np.s_[3:6, 6:7]),  # what moves alike has been judged by itself
    ],
)
def test_ghosting_spreads_by_one_pixel_to_what_is_behind_and_moves_otherwise(
    beside: dict[str, float], spreads_to: tuple[slice, slice]
) -> None:
    shape = (9, 16)
    depth, right, closer = np.full(shape, 0.03), np.zeros(shape), np.full(shape, 0.03)
    depth[:, (5, 7)], right[:, (5, 7)] = beside.get("depth", 0.03), beside.get("motion", 0.0)
    depth[4, 6], right[4, 6] = 0.05, 3.0
    closer[4, 9] = 0.5  # it hid what is at (4, 6) now
    motion = np.stack([right, np.zeros(shape)], axis=-1)
    now = evidence(shape, depth_min=depth, depth_max=depth, depth_before=depth, motion=motion)
    before = evidence(shape, depth_min=closer, depth_max=closer)
    expected = np.zeros(shape, bool)
    expected[spreads_to] = True
    for thresholds in (LabelThresholds(), LabelThresholds(slope_aware=False)):
        hidden = label(now, before, thresholds).ghost == Ghost.VISIBILITY
        np.testing.assert_array_equal(hidden, expected)


def test_visibility_ghosting_goes_before_shading_and_aliasing_clears_shading() -> None:
    labels = label(*changed(**RELIT, **HIDDEN))
    assert (labels.ghost[2:7, 4:9] == Ghost.VISIBILITY).all()
    for alias in ({"depth_min": 0.04}, {"normal_spread": 0.6}, {"normal_mapped_spread": 0.6}):
        assert not label(*changed(**RELIT, **alias)).ghost.any()


def test_geometry_aliasing_goes_before_texture_aliasing() -> None:
    labels = label(*changed(depth_min=0.04, normal_mapped_spread=0.6, color_min=0.1))
    assert (labels.alias[2:7, 4:9] == Alias.GEOMETRY).all()


def test_every_pixel_is_visibility_ghosting_on_a_cut_and_on_the_first_frame() -> None:
    now, before = changed(depth_min=0.04)
    for labels in (label(before, None), label(now, None), label(replace(now, cut=True), before)):
        assert (labels.ghost == Ghost.VISIBILITY).all()
    assert np.count_nonzero(labels.alias == Alias.GEOMETRY) == 25  # a cut has no say in that


@pytest.mark.parametrize("motion", [(12.0, 0.0), (-12.0, 0.0), (0.0, 9.0), (0.0, -9.0), (np.nan, 0.0)])
def test_pixels_from_off_screen_are_visibility_ghosting(motion: tuple[float, float]) -> None:
    assert (label(evidence(motion=motion), evidence()).ghost == Ghost.VISIBILITY).all()


def test_opening_removes_what_is_narrow_and_keeps_the_rest() -> None:
    mask = np.zeros((20, 30), bool)
    mask[2, 2] = mask[5, :] = mask[8:12, 8:12] = True  # a dot, a line, 4x4
    kept = np.zeros_like(mask)
    kept[13:18, 12:17] = kept[17:, 27:] = True  # 5x5, and 3x3 in a corner, which may go on beyond it
    assert not opened(mask, 2).any()
    np.testing.assert_array_equal(opened(kept, 2), kept)
    assert opened(mask, 1).sum() == 16
    np.testing.assert_array_equal(opened(mask, 0), mask)
    assert opened(np.ones((3, 4), bool), 2).all()


def test_a_line_of_light_along_what_was_off_screen_is_a_line_still() -> None:
    color, right = np.full((9, 12, 1), 0.5), np.zeros((9, 12))
    color[:, 8:], right[:, 9:] = 0.7, 3.0
    motion = np.stack([right, np.zeros((9, 12))], axis=-1)
    ghost = label(evidence(color_min=color, color_max=color, motion=motion), evidence()).ghost
    assert (ghost[:, 9:] == Ghost.VISIBILITY).all()
    assert not ghost[:, :9].any()


@few
@given(arrays.arrays(bool, arrays.array_shapes(min_dims=2, max_dims=2, max_side=14)), st.integers(0, 3))
def test_opening_is_antiextensive_and_idempotent(mask: Mask, times: int) -> None:
    once = opened(mask, times)
    assert not (once & ~mask).any()
    np.testing.assert_array_equal(opened(once, times), once)


def test_the_overlap_of_boxes_is_by_volume() -> None:
    def overlap(*corners: tuple[float, float, float], padding: float = 0.0) -> float:
        low, high, low2, high2 = (np.array([[c]], np.float32) for c in corners)
        return float(box_overlap(low, high, low2, high2, padding)[0, 0])

    assert overlap((0, 0, 0), (1, 1, 1), (0.5, 0, 0), (1.5, 1, 1)) == pytest.approx(1 / 3)
    assert overlap((0, 0, 0), (1, 1, 1), (0, 0, 2), (1, 1, 3)) == 0.0
    assert overlap((0, 0, 0), (0, 0, 0), (0, 0, 0), (0, 0, 0), padding=0.01) == pytest.approx(1.0)


slopes = st.floats(-1.0, 1.0)


@few
@given(slopes, slopes, st.integers(2, 9), st.integers(2, 9), st.integers(1, 8))
def test_the_slope_of_any_plane_explains_its_range_of_depths(
    right: float, down: float, height: int, width: int, n: int
) -> None:
    steepest = 0.4 / max(height, width)  # of a plane that stays in front of the camera
    y, x = np.mgrid[:height, :width]
    offsets = [((i + 0.5) / n - 0.5, (j + 0.5) / n - 0.5) for i in range(n) for j in range(n)]
    depths = [1.0 + steepest * (right * (x + dx) + down * (y + dy)) for dx, dy in offsets]
    zeros = np.zeros((height, width, 3))
    pixels = statistics_of(Sample(zeros, depth, zeros, zeros) for depth in depths)
    np.testing.assert_allclose(plane_slope(pixels), steepest * (abs(right) + abs(down)), atol=1e-6)
    geometry, _ = aliasing(pixels, LabelThresholds(depth_alias=1e-5))
    assert not geometry.any()


def test_an_edge_between_two_others_is_no_slope() -> None:
    depth_min, depth_max = np.full((9, 12), 0.01), np.full((9, 12), 0.01)
    depth_min[:, 4], depth_max[:, 4] = 0.03, 0.05
    depth_min[:, 5:] = depth_max[:, 5:] = 0.05 + 1e-4 * np.arange(1, 8)
    alias = label(evidence(depth_min=depth_min, depth_max=depth_max), None).alias
    assert (alias[:, 4] == Alias.GEOMETRY).all()
    assert np.count_nonzero(alias) == 9


colors = arrays.arrays(np.float64, (4, 3, 5, 3), elements=st.floats(1e-3, 1e3))


def of_colors(samples: NDArray[np.float64], exposure: float = 1.0) -> PixelStatistics:
    flat = np.zeros(samples.shape[1:])
    return statistics_of((Sample(c, flat[..., 0], flat, flat) for c in samples), exposure)


@few
@given(colors, st.floats(0.05, 20.0))
def test_no_exposure_changes_which_colors_vary(samples: NDArray[np.float64], exposure: float) -> None:
    ratio = (samples.max(axis=0) - samples.min(axis=0)) / samples.max(axis=0)
    clear = (np.abs(ratio - 0.5) > 1e-2).all(axis=-1)  # rounding of bright colours decides the others
    anywhere = LabelThresholds(darkest=0.0)
    there = color_varies(of_colors(samples), anywhere)
    np.testing.assert_array_equal(there[clear], (ratio > 0.5).any(axis=-1)[clear])
    np.testing.assert_array_equal(color_varies(of_colors(samples, exposure), anywhere)[clear], there[clear])


def test_black_is_not_aliased_however_much_it_varies() -> None:
    pixels = evidence(color_min=1e-4, color_max=0.019).pixels
    assert not color_varies(pixels).any()
    assert color_varies(pixels, LabelThresholds(darkest=0.01)).all()


def test_toning_stays_below_one_and_takes_no_bad_light() -> None:
    values, expected = np.array([-1.0, 0.0, 1.0, 3.0, np.inf]), [0.0, 0.0, 0.5, 0.75, 65504 / 65505]
    np.testing.assert_allclose(toned(values), expected)
    assert toned(np.array([1.0]), exposure=3.0) == 0.75


@few
@given(st.integers(0, 2**32 - 1), arrays.array_shapes(min_dims=2, max_dims=2, max_side=9))
def test_any_two_frames_of_any_size_have_labels(seed: int, shape: tuple[int, ...]) -> None:
    random = np.random.default_rng(seed)
    height, width = shape

    def frame() -> LabelInputs:
        depth, color = random.choice([0.0, FAR, NEAR], (3, *shape)), random.random((2, *shape, 3))
        return evidence(
            (height, width),
            depth_min=depth[:2].min(axis=0),
            depth_max=depth[:2].max(axis=0),
            depth_before=depth[2],
            color_min=color.min(axis=0),
            color_max=color.max(axis=0),
            normal_spread=random.random(shape),
            normal_mapped_spread=random.random(shape),
            motion=random.normal(size=(*shape, 2)),
        )

    labels = label(frame(), frame())
    for map_ in (labels.ghost, labels.alias):
        assert map_.shape == shape
        assert map_.dtype == np.uint8
        assert map_.max() <= 2
    assert not labels.alias[labels.ghost == Ghost.SHADING].any()
