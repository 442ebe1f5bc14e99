"""Tests of the checks over several frames: jitter, depth order, readings of motion."""

import warnings
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from supersampler.conventions import Conventions
from supersampler.conventions.jitter import halton_jitter
from supersampler.errors import FrameError, FrameWarning
from supersampler.frame import Float32, Frame
from supersampler.validation import FrameChecker
from supersampler.validation.probe import (
    FrameProbe,
    count_disoccluded,
    plane_curvature,
    reading_text,
    sky_fraction,
)
from supersampler.validation.rankings import SURE, Detection, Hypothesis, Verdict, rank_depth, ranked
from supersampler.validation.reprojection import FramePair, frame_pairs
from supersampler.validation.temporal import (
    FACTORS,
    FramesSeen,
    _better_reading,
    _other_order,
    _readings,
    _surfaces,
    temporal_mistakes,
    wrong_amplitude,
)
from supersampler_model.data.scenes.analytic import Plane, checker


def even(jitter: tuple[float, float], size: tuple[int, int]) -> Frame:
    """A frame without texture: nothing but its jitter can be wrong."""
    w, h = size
    return Frame(
        color=np.full((h, w, 3), 0.4, np.float32),
        depth=np.full((h, w), 0.1, np.float32),
        motion=np.zeros((h, w, 2), np.float32),
        jitter=jitter,
    )


def complaint(*jitters: tuple[float, float], size: tuple[int, int] = (80, 70)) -> str:
    checker = FrameChecker("strict")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", FrameWarning)
            for jitter in jitters:
                checker.check(even(jitter, size), (160, 140))
    except FrameError as found:
        return str(found)
    return ""


def test_one_jitter_in_three_frames_on_end_is_no_accident() -> None:
    assert complaint((0.1, 0.2), (0.1, 0.2)) == ""
    found = complaint((0.1, 0.2), (0.1, 0.2), (0.1, 0.2))
    assert "in 3 frames in a row" in found
    assert "halton_jitter" in found
    assert complaint((0.1, 0.2), (0.1, 0.2), (0.1, 0.3)) == ""
    assert complaint((0.1, 0.2), (0.1, 0.2), (0.2, 0.2)) == ""


def test_a_jitter_that_stays_within_one_pixel_of_ndc_is_too_small() -> None:
    """One pixel of 80 is 1 / 80 in UV; halves of both signs in NDC reach as far."""
    small = ((0.012, -0.01), (-0.01, 0.014), (0.0, 0.0))
    assert "never more than 0.014" in complaint(*small)
    assert complaint((0.013, 0.0), *small) == ""
    assert complaint((0.0, 0.015), *small) == ""
    assert complaint(*small, size=(80, 63)) == "", "of small frames nothing is said"


@pytest.mark.parametrize(
    ("as_reversed", "as_forward", "kind"),
    [
        ((0, 0), (0, 0), None),
        ((0, 20), (0, 0), "linear"),
        ((0, 19), (0, 0), None),
        ((5, 20), (0, 0), None),
        ((4, 20), (0, 0), "linear"),
        ((20, 5), (0, 0), None),
        ((0, 0), (20, 0), "forward"),
        ((0, 0), (19, 0), None),
        ((0, 0), (20, 5), None),
        ((2, 0), (20, 3), None),
        ((1, 0), (21, 4), "forward"),
    ],
)
def test_the_order_of_depth_is_doubted_where_what_hides_is_farther(
    as_reversed: tuple[int, int], as_forward: tuple[int, int], kind: str | None
) -> None:
    """(closer, farther) surfaces that disoccluded places were hidden by, if depth were of that order."""
    assert _other_order({"reversed": as_reversed, "forward": as_forward}) == kind


@pytest.mark.parametrize(
    ("reading", "text"),
    [
        (Conventions(motion_unit="uv"), "uv, previous minus current"),
        (Conventions(motion_unit="ndc", motion_flip_y=True), "ndc, previous minus current, y flipped"),
        (Conventions(motion_scale=(0.5, 0.5)), "display pixels, previous minus current"),
        (Conventions(motion_direction="current_minus_previous"), "pixels, current minus previous"),
        (Conventions(motion_jittered=True), "pixels, previous minus current, with jitter in it"),
    ],
)
def test_a_reading_of_motion_has_a_text(reading: Conventions, text: str) -> None:
    assert reading_text("motion", reading) == text


@pytest.mark.parametrize(
    ("reading", "text"),
    [
        (Conventions(jitter_sign=-1, jitter_flip_y=True), "pixels, centre - jitter, y flipped"),
        (Conventions(jitter_unit="uv"), "uv, centre + jitter"),
    ],
)
def test_a_reading_of_jitter_has_a_text(reading: Conventions, text: str) -> None:
    assert reading_text("jitter", reading) == text


def test_every_other_reading_is_tried_once_and_the_frames_own_is_not() -> None:
    readings = _readings((320, 180), (640, 360))
    assert len(readings) == 3 * 2 * 2 * 2 - 1 + 3 + 2
    assert Conventions(motion_scale=(0.5, 0.5)) in readings.values()
    assert Conventions() not in readings.values()


@pytest.mark.parametrize(
    ("pairs", "part", "found"),
    [(1, 0.64, True), (1, 0.66, False), (2, 0.66, True), (2, 0.74, True), (2, 0.76, False)],
)
def test_a_reading_must_fit_clearly_better_and_more_so_after_one_pair_of_frames(
    pairs: int, part: float, found: bool
) -> None:
    seen = FramesSeen(pairs=pairs, errors={"best": (0.5, 0.5 * part), "other": (0.2, 0.19)})
    assert _better_reading(seen) == ("best" if found else "")


def test_small_errors_and_frames_without_evidence_give_no_finding() -> None:
    assert _better_reading(FramesSeen(pairs=2, errors={"best": (1.9e-5, 0.0)})) == ""
    assert _better_reading(FramesSeen(pairs=2, errors={"best": (2.1e-5, 0.0)})) == "best"
    assert _better_reading(FramesSeen()) == ""


def test_a_reading_that_leads_off_screen_counts_as_the_largest_error() -> None:
    """Motion of one pixel is, read as UV, a whole screen."""
    frames = [Plane(checker, (2.0, 1.0)).frame(index, (96, 54), (0.0, 0.0)) for index in (0, 1)]
    seen = FramesSeen()
    for frame in frames:
        seen = seen.after(FrameProbe.of_frame(frame), (192, 108))
    uv = repr(Conventions(motion_unit="uv"))
    assert seen.errors[uv][1] == 1.0
    assert max(other for _, other in seen.errors.values()) == 1.0


def test_pairs_of_frames_with_texture_are_counted_from_the_second_on() -> None:
    scene, seen = Plane(checker, (2.0, 1.0)), FramesSeen()
    for index, pairs in enumerate((0, 1, 2)):
        frame = scene.frame(index, (96, 54), halton_jitter(index, 2.0))
        seen = seen.after(FrameProbe.of_frame(frame), (192, 108))
        assert (seen.pairs, len(seen.jitters)) == (pairs, index + 1)
    assert seen.previous is not None
    assert seen.previous.jitter == seen.jitters[-1]


def verdict(*errors: float, stated: Conventions | None = None) -> Verdict:
    overrides: list[dict[str, Any]] = [{"motion_unit": unit} for unit in ("uv", "ndc", "pixels")]
    hypotheses = [Hypothesis(f"{o['motion_unit']}", o, e) for o, e in zip(overrides, errors, strict=False)]
    return ranked("motion", hypotheses, stated or Conventions())


def test_a_verdict_is_certain_if_the_runner_up_is_a_seventh_worse() -> None:
    near, clear = verdict(1.0, SURE - 0.01, 9.0), verdict(1.0, SURE + 0.01, 9.0)
    assert not near.certain
    assert near.overrides == {}
    assert near.reason == "'uv' and 'ndc' fit alike"
    assert clear.certain
    assert clear.overrides == {"motion_unit": "uv"}
    assert clear.margin == pytest.approx(SURE + 0.01)
    assert verdict(1.0).certain


def test_near_a_tie_what_was_stated_comes_first() -> None:
    assert verdict(1.0, 1.5, 1.01).ranked[0].text == "pixels"
    assert verdict(1.0, 1.5, 1.03).ranked[0].text == "uv"
    assert verdict(1.0, 1.01, 1.5, stated=Conventions(motion_unit="ndc")).ranked[0].text == "ndc"


def test_a_margin_is_of_the_two_best_and_never_below_one() -> None:
    assert Verdict("motion").margin == 1.0
    assert verdict(2.0).margin == 1.0
    assert verdict(0.0, 1e-3).margin == pytest.approx(1e3)
    assert verdict(1.01, 9.0, 1.0, stated=Conventions(motion_unit="uv")).margin == 1.0


def test_a_summary_gives_the_finding_or_the_reason_and_the_fix() -> None:
    motion, jitter = verdict(1.0, 3.0), Verdict("jitter", (), "it never changes")
    found = Conventions(motion_unit="uv")
    detection = Detection(motion, jitter, motion, Conventions(), found, ("A note.",))
    assert not detection.agrees
    assert detection.summary().splitlines() == [
        "motion: uv; the next best, ndc, is 3.00x worse",
        "jitter: cannot tell, it never changes",
        "motion: uv; the next best, ndc, is 3.00x worse",
        "A note.",
        "The frames are not as stated: Conventions()",
        "Write: Conventions(motion_unit='uv')",
    ]
    assert Detection(motion, jitter, motion, found, found).summary().endswith(f"as stated: {found!r}")


@pytest.mark.parametrize(("sign", "found"), [(-1.0, (40, 0)), (1.0, (0, 40))])
@pytest.mark.parametrize("axis", [0, 1])
def test_uncovered_places_are_looked_for_where_motion_and_both_jitters_lead(
    axis: int, sign: float, found: tuple[int, int]
) -> None:
    """Neighbourhoods of 3x3 on both sides of an edge are three pixels apart: motion 2.3, jitters 0.6."""
    assert moved_edge(axis, sign, -0.3).disoccluded("reversed", Conventions(), 30_000) == found
    assert moved_edge(axis, sign, 0.3).disoccluded("reversed", Conventions(), 30_000) == (0, 0)


def moved_edge(axis: int, sign: float, jitter_before: float) -> FramePair:
    """Two surfaces that move together; the edge between them stays in place, and so hides or uncovers."""
    depth = np.full((40, 40), 0.1, np.float32)
    depth[:20] = 0.3
    unit = np.array([0.0, sign])
    if axis == 0:
        depth, unit = np.ascontiguousarray(depth.T), unit[::-1]
    (x, y), (x_before, y_before) = (0.3 * unit).tolist(), (jitter_before * unit).tolist()
    motion = np.broadcast_to((2.3 * unit).astype(np.float32), (40, 40, 2))
    frame = replace(even((x, y), (40, 40)), depth=depth, motion=motion)
    before = replace(frame, jitter=(x_before, y_before))
    [pair] = frame_pairs([FrameProbe.of_frame(before), FrameProbe.of_frame(frame)])
    return pair


def test_a_nan_vector_moves_no_pixel() -> None:
    motion = np.full((40, 40, 2), 0.5, np.float32)
    motion[:20] = np.nan
    frame = replace(even((0.1, 0.2), (40, 40)), motion=motion)
    [pair] = frame_pairs([FrameProbe.of_frame(frame)] * 2)
    assert 0.3 < pair.moving(Conventions()).mean() < 0.7


def test_one_pair_of_frames_alone_doubts_no_order_of_depth() -> None:
    once = _surfaces(moved_edge(1, 1.0, -0.3))
    assert _other_order(once) is None
    assert (
        _other_order({order: (2 * closer, 2 * farther) for order, (closer, farther) in once.items()})
        == "linear"
    )


@pytest.mark.parametrize(("kind", "doubted"), [("reversed", False), ("linear", True)])
def test_planes_decide_where_what_flickers_seems_to_hide_closer_things(kind: str, doubted: bool) -> None:
    y, x = np.mgrid[:40, :40].astype(np.float32)
    plane = 0.1 + 0.002 * x + 0.003 * y
    frame = replace(even((0.1, 0.2), (40, 40)), depth=plane if kind == "reversed" else 1.0 / plane)
    seen = FramesSeen(
        previous=FrameProbe.of_frame(frame), surfaces={"reversed": (0.0, 30.0)}, jitters=(frame.jitter,)
    )
    found = temporal_mistakes(seen, (40, 40), (80, 80))
    assert any("as if depth were linear" in str(mistake.error()) for mistake in found) == doubted


# --- the amplitude of the jitter in images, estimated from reprojection ---


VARIANCE = 1.0


def errors(x: float, y: float, gain: float) -> dict[tuple[float, float], tuple[float, ...]]:
    """Errors whose least one is at these factors, and lower by `gain` than that of the stated jitter."""
    stated, least = 0.1, 0.1 * (1.0 - gain)
    slope = (stated - least) / ((1.0 - x) ** 2 + (1.0 - y) ** 2)
    return {(a, b): (least + slope * ((a - x) ** 2 + (b - y) ** 2), VARIANCE) for a, b in FACTORS}


@pytest.mark.parametrize(("x", "y"), [(0.5, 0.5), (1.5, 1.5), (0.5, 1.5)])
def test_a_jitter_that_is_wrong_in_both_axes_is_found_by_a_small_gain(x: float, y: float) -> None:
    found = wrong_amplitude(errors(x, y, 0.2), 2)
    assert found is not None
    assert (found.x, found.y) == pytest.approx((x, y), abs=1e-6)


@pytest.mark.parametrize("axis", [0, 1])
def test_a_jitter_that_is_wrong_in_one_axis_takes_a_larger_gain(axis: int) -> None:
    x, y = ((0.5, 1.0), (1.0, 0.5))[axis]
    assert wrong_amplitude(errors(x, y, 0.06), 2) is None
    assert wrong_amplitude(errors(x, y, 0.12), 2) is not None


def test_one_pair_of_frames_or_a_correct_jitter_gives_no_finding() -> None:
    assert wrong_amplitude(errors(0.5, 0.5, 0.2), 1) is None
    assert wrong_amplitude(errors(0.9, 1.1, 0.2), 2) is None


# --- kinds of depth: curvature of planes, sky, disocclusions ---


def plane(height: int, width: int, slope: float = 1e-4) -> Float32:
    """1 / distance of a plane, float32."""
    rows, columns = np.mgrid[:height, :width]
    return np.asarray(0.1 + slope * (columns + 0.5 * rows), np.float32)


@pytest.mark.parametrize(("height", "width"), [(300, 1300), (1300, 300), (60, 80)])
def test_a_plane_in_the_middle_has_no_curvature_whatever_is_around_it(height: int, width: int) -> None:
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
def test_a_surface_within_3x3_pixels_is_the_same_surface(row: int, column: int) -> None:
    """Depth was 0.2 everywhere; a pixel of 0.3 nearby says that what was there is no closer surface."""
    now, before = np.full((9, 9), 0.1, np.float32), np.full((9, 9), 0.2, np.float32)
    now[4 + row, 4 + column] = 0.3
    middle = np.array([4])
    found = count_disoccluded(now, before, "reversed", (middle, middle), np.zeros((1, 2)))
    assert found == ((0, 0) if max(abs(row), abs(column)) < 2 else (1, 0))


def test_a_slightly_closer_surface_is_the_same_surface() -> None:
    """An object that approaches, by 9 % of its distance in a frame, is no surface before a farther one."""
    middle, now = np.array([4]), np.full((9, 9), 0.2, np.float32)

    def found(before: float) -> tuple[int, int]:
        earlier = np.full((9, 9), before, np.float32)
        return count_disoccluded(now, earlier, "reversed", (middle, middle), np.zeros((1, 2)))

    assert found(0.2 / 1.09) == (0, 0)
    assert found(0.2 / 1.11) == (0, 1)
