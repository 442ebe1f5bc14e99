"""Tests of the checks over several frames: jitter, depth order, readings of motion."""

import warnings
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from supersampler import Conventions, Frame
from supersampler.errors import FrameError, FrameWarning
from supersampler.validation import FrameChecker
from supersampler.validation.probe import FrameProbe
from supersampler.validation.rankings import SURE, Detection, Hypothesis, Verdict, ranked
from supersampler.validation.reprojection import FramePair
from supersampler.validation.temporal import (
    FACTORS,
    FramesSeen,
    jitter_in_vectors,
    motion_next_mistakes,
    temporal_mistakes,
    vectors_have_jitter,
    wrong_amplitude,
)


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
    assert "in 3 consecutive frames" in found
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


@pytest.mark.parametrize("none", [np.inf, np.nan])
def test_errors_that_are_no_numbers_decide_nothing(none: float) -> None:
    found = verdict(none, none)
    assert found.reason == "no reading gives vectors that stay in the image"
    assert verdict(none, 1.0).overrides == {"motion_unit": "ndc"}


def test_of_readings_that_fit_alike_the_changes_that_they_share_count() -> None:
    direction = {"motion_direction": "current_minus_previous", "motion_flip_y": False}
    both, stated = (
        {**direction, "motion_flip_y": True},
        {**direction, "motion_direction": "previous_minus_current"},
    )
    hypotheses = [Hypothesis("", o, e) for o, e in ((both, 1.0), (direction, 1.1), (stated, 3.0))]
    found = ranked("motion", hypotheses, Conventions())
    assert found.certain
    assert found.overrides == direction
    assert found.margin == pytest.approx(3.0 / 1.1)
    assert not ranked("motion", hypotheses, Conventions(motion_direction="current_minus_previous")).certain


def test_near_a_tie_what_was_stated_comes_first() -> None:
    assert verdict(1.0, 1.5, 1.01).ranked[0].text == "pixels"
    assert verdict(1.0, 1.5, 1.03).ranked[0].text == "uv"
    stated = Conventions(motion_unit="ndc")
    assert verdict(1.0, 1.01, 1.5, stated=stated).ranked[0].text == "ndc"
    assert verdict(1.0, 1.3, stated=stated).reason == "'uv' fits only 1.30 times better than as stated"
    assert verdict(1.0, 1.4, stated=stated).certain


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


@pytest.mark.parametrize(("kind", "doubted"), [("reversed", False), ("linear", True)])
def test_planes_decide_where_what_flickers_seems_to_hide_closer_things(kind: str, doubted: bool) -> None:
    y, x = np.mgrid[:40, :40].astype(np.float32)
    plane = 0.1 + 0.002 * x + 0.003 * y
    frame = replace(even((0.1, 0.2), (40, 40)), depth=plane if kind == "reversed" else 1.0 / plane)
    seen = FramesSeen(
        previous=FrameProbe.of_frame(frame),
        surfaces={"reversed": (0.0, 30.0), "forward": (0.0, 0.0)},
        jitters=(frame.jitter,),
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


@pytest.mark.parametrize("factor", [0.5, 1.5])
@pytest.mark.parametrize(("pairs", "gain"), [(2, 0.14), (6, 0.05)])
def test_a_jitter_that_is_wrong_in_both_axes_is_found_in_any_frames(
    factor: float, pairs: int, gain: float
) -> None:
    found = wrong_amplitude(errors(factor, factor, gain), pairs, 64)
    assert found is not None
    assert (found.x, found.y) == pytest.approx((factor, factor), abs=1e-6)
    assert wrong_amplitude(errors(factor, factor, gain - 0.03), pairs, 64) is None


@pytest.mark.parametrize(("x", "y"), [(0.5, 1.0), (1.0, 0.5), (1.2, 0.5), (0.5, 1.5)])
def test_a_jitter_that_is_wrong_in_one_axis_takes_more_frames_and_pixels(x: float, y: float) -> None:
    assert wrong_amplitude(errors(x, y, 0.12), 6, 96) is not None
    assert wrong_amplitude(errors(x, y, 0.06), 6, 96) is None
    assert wrong_amplitude(errors(x, y, 0.12), 5, 96) is None
    assert wrong_amplitude(errors(x, y, 0.12), 6, 95) is None


@pytest.mark.parametrize("part", [0.5, 1.6])
@pytest.mark.parametrize("few", [True, False])
def test_a_jitter_in_images_that_hardly_differ_or_are_unrelated_is_not_judged(part: float, few: bool) -> None:
    pairs, found = (2, 6)[not few], errors(part, part, 0.2)
    assert wrong_amplitude(found, pairs, 96) is not None
    assert wrong_amplitude(found, 1, 96) is None, "one pair"
    dark = {factors: (2e-4 * error, VARIANCE) for factors, (error, _) in found.items()}
    assert wrong_amplitude(dark, 3, 96) is None
    assert wrong_amplitude(dark, 2, 96) is None
    brighter = {factors: (3e-4 * error, VARIANCE) for factors, (error, _) in found.items()}
    assert wrong_amplitude(brighter, 2, 96) is not None
    for variance, related in ((0.11, False), (0.12, True)):  # the least error is 0.08
        unlike = {factors: (error, variance) for factors, (error, _) in found.items()}
        assert (wrong_amplitude(unlike, pairs, 96) is not None) is related
    saddle = {(a, b): (0.1 - 0.02 * (a - b) ** 2, VARIANCE) for a, b in FACTORS}
    assert wrong_amplitude(saddle, 6, 96) is None


@pytest.mark.parametrize(("x", "y", "found"), [
    (0.0, 0.0, True), (-0.1, -0.1, True), (-0.2, 0.6, True), (-0.3, 0.6, False),
    (2.9, 2.9, True), (2.0, 3.1, False), (1.35, 1.35, False), (1.42, 1.42, True), (1.29, 1.49, False),
    (0.73, 0.73, True), (0.6, 0.74, True),
    (1.6, 1.1, True), (1.45, 1.1, False), (0.6, 0.95, True), (0.7, 0.95, False),
])  # fmt: skip
def test_factors_that_no_mistake_explains_are_not_reported(x: float, y: float, found: bool) -> None:
    assert (wrong_amplitude(errors(x, y, 0.3), 6, 96) is not None) is found


def told(seen: FramesSeen) -> str:
    """Return what is said about frames of 100 x 90 pixels whose jitter changes."""
    seen = replace(
        seen, jitters=((0.1, 0.2), (0.3, -0.4)), amplitudes=seen.amplitudes or errors(0.9, 1.1, 0.0)
    )
    found = temporal_mistakes(seen, (100, 90), (200, 180))
    return "\n".join(str(mistake.error()) for mistake in found)


def test_a_part_of_the_jitter_in_the_image_is_told_by_axis_where_they_differ() -> None:
    def said(x: float, y: float) -> str:
        return told(FramesSeen(pairs=2, amplitudes=errors(x, y, 0.2)))

    assert said(0.5, 0.5).startswith("frame.jitter is 0.50 times as large in the image")
    assert "0.40 times as" in said(0.3, 0.5)
    assert "0.35 (0.20 in x, 0.50 in y) times as" in said(0.2, 0.5)
    assert "0.35 (0.50 in x, 0.20 in y) times as" in said(0.5, 0.2)
    assert said(0.9, 0.9) == ""


@pytest.mark.parametrize(("varied", "jittered"), [
    ((0.5, 0.5, 1.0), True), ((1.0, 0.9, 1.0), True), ((0.6, 0.0, 1.0), True), ((0.0, 0.4, 1.0), False),
    ((1.0, 1.1, 1.0), False), ((0.0, 0.0, 0.0), False), ((0.0, -1.0, 1.0), False),
])  # fmt: skip
def test_an_image_without_jitter_has_it_in_its_vectors_if_they_change_alike(
    varied: tuple[float, float, float], jittered: bool
) -> None:
    assert vectors_have_jitter(varied) is jittered
    for factor in (0.0, 0.4):
        said = told(FramesSeen(pairs=2, amplitudes=errors(factor, factor, 0.5), varied=varied))
        assert ("with jitter in it" in said) is jittered
    assert "2.0 times better" in told(
        FramesSeen(pairs=2, amplitudes=errors(0.0, 0.0, 0.5), varied=(0.5, 0.5, 1.0))
    )
    assert "not in the image" in told(FramesSeen(pairs=2, amplitudes=errors(0.0, 0.0, 0.5)))
    for error, said in ((0.08, f"Try {NEGATED}"), (0.09, "not in the image")):  # no jitter has 0.085
        seen = FramesSeen(pairs=2, amplitudes=errors(0.0, 0.0, 0.15), errors={NEGATED: (0.1, error)})
        assert said in told(seen)
    more = FramesSeen(pairs=2, amplitudes=errors(0.6, 0.6, 0.5), varied=varied)
    assert "0.60 times as large" in told(more)


# --- another reading of motion or jitter ---


FLIPPED, NEGATED, JITTERED = (
    repr(Conventions(**fields))
    for fields in ({"motion_flip_y": True}, {"jitter_sign": -1}, {"motion_jittered": True})
)


@pytest.mark.parametrize(("pairs", "ratio"), [(1, 0.65), (2, 0.75), (5, 0.75)])
def test_a_reading_that_fits_clearly_better_is_named(pairs: int, ratio: float) -> None:
    def said(part: float, own: float = 0.1) -> str:
        return told(FramesSeen(pairs=pairs, errors={FLIPPED: (own, part * own)}))

    assert "frame.motion is misread" in said(ratio - 0.01)
    assert f"Try {FLIPPED}" in said(ratio - 0.01)
    assert "2.0 times better if it is pixels, previous minus current, y flipped" in said(0.5)
    assert said(ratio + 0.01) == ""
    assert "misread" in said(0.5, own=1.1e-5 * pairs)
    assert said(0.5, own=1e-5 * pairs) == "", "noise"


def test_the_reading_that_fits_best_is_named() -> None:
    errors_of = {FLIPPED: (0.2, 0.1), NEGATED: (0.1, 0.02)}
    said = told(FramesSeen(pairs=2, errors=errors_of))
    assert said.startswith("frame.jitter is misread: frames fit 5.0 times better if it is pixels, centre - j")
    rows = repr(Conventions(motion_flip_y=True, jitter_flip_y=True))
    said = told(FramesSeen(pairs=2, errors={**errors_of, rows: (0.4, 0.02)}))
    assert "frame.color is bottom-up with depth and motion: frames then fit 20.0 times better" in said
    assert rows in said
    alone = repr(Conventions(jitter_flip_y=True))
    for fits, named in ((0.052, f"Try {alone}, or bottom_up=True if the image is upside down"), (0.06, rows)):
        assert named in told(FramesSeen(pairs=2, errors={rows: (0.1, 0.05), alone: (0.1, fits)}))


def seen_after_a_part_moves(rows: int, motion: float) -> FramesSeen:
    """Return the state after 40 columns of some rows have moved right by 4 pixels, as `motion` may say."""
    before, now = (even((0.1 * index, 0.2), (100, 90)) for index in range(2))
    noise = np.random.default_rng(0).random((90, 100, 3)).astype(np.float32)
    color, vectors = noise.copy(), np.zeros((90, 100, 2), np.float32)
    part = slice(20, 20 + rows), slice(20, 60)
    color[part], vectors[part] = noise[20 : 20 + rows, 16:56], (motion, 0.0)
    first = FramesSeen().after(FrameProbe.of_frame(replace(before, color=noise)), (200, 180))
    return first.after(FrameProbe.of_frame(replace(now, color=color, motion=vectors)), (200, 180))


def test_readings_of_motion_are_compared_where_something_moves_and_readings_of_jitter_everywhere() -> None:
    reversed_motion, errors_of = repr(Conventions(motion_direction="current_minus_previous")), {}
    for motion in (4.0, -4.0):
        errors_of[motion] = seen_after_a_part_moves(30, motion).errors
    own, other = errors_of[4.0][reversed_motion]
    assert other < 0.3 * own
    assert errors_of[-4.0][reversed_motion] == pytest.approx((other, own))
    everywhere, _ = errors_of[4.0][NEGATED]
    assert everywhere == pytest.approx(own * 30 * 40 / (90 * 100), rel=0.2)
    assert set(errors_of[4.0]) > set(seen_after_a_part_moves(6, 4.0).errors), "240 pixels are too few"
    assert reversed_motion in seen_after_a_part_moves(7, 4.0).errors
    assert all("motion_" not in call or "jitter" in call for call in seen_after_a_part_moves(6, 4.0).errors)


def test_a_reading_that_explains_the_image_no_better_than_no_motion_is_no_better() -> None:
    """Nothing moves where vectors say so: all readings are wrong, and shorter vectors are the least so."""
    noise = np.random.default_rng(0).random((90, 100, 3)).astype(np.float32)
    seen = FramesSeen()
    for index in range(2):
        frame = replace(
            even((0.1 * index, 0.2), (100, 90)), color=noise, motion=np.full((90, 100, 2), 2.0, np.float32)
        )
        seen = seen.after(FrameProbe.of_frame(frame), (200, 180))
    own, shorter = seen.errors[repr(Conventions(motion_scale=(0.5, 0.5)))]
    assert shorter == own


def test_after_two_frames_motion_that_is_all_zero_may_be_missing() -> None:
    frame = FrameProbe.of_frame(even((0.1, 0.2), (100, 90)))
    seen = FramesSeen(previous=frame, pairs=1, errors={NEGATED: (0.2, 0.02)})
    assert told(seen) == ""
    assert "misread" in told(replace(seen, pairs=2))
    assert "misread" in told(replace(seen, previous=replace(frame, motion=frame.motion + 1)))
    assert "frame.motion is 0 everywhere" in told(replace(seen, lacks_motion=True))
    assert "misread" not in told(replace(seen, lacks_motion=True, pairs=2))


def test_jitter_is_sought_in_vectors_that_change_with_it_in_two_pairs() -> None:
    seen = FramesSeen(pairs=2, errors={JITTERED: (0.2, 0.02)}, varied=(0.5, 0.5, 1.0))
    assert "with jitter in it" in told(seen)
    assert told(replace(seen, pairs=1)) == ""
    assert told(replace(seen, varied=(0.1, 0.0, 1.0))) == ""
    in_uv = {repr(Conventions(motion_unit="uv", motion_jittered=True)): (0.2, 0.02)}
    assert told(replace(seen, errors=in_uv)) == ""
    assert "uv, previous minus current, with jitter in it" in told(
        replace(seen, errors=in_uv, varied=(0.5 / 128, 0.5 / 72, 1.0))
    )


def test_how_motion_changes_with_the_jitter_is_summed() -> None:
    """Three jitters, whose changes are (0.5, -0.25) and (-0.25, 0.75), and vectors with a part of them."""
    jitters, change = [(-0.25, 0.0), (0.25, -0.25), (0.0, 0.5)], np.array([-0.75, 1.0])
    before, now = (FrameProbe.of_frame(even(jitter, (100, 90))) for jitter in jitters[1:])
    light = np.random.default_rng(0).random((90, 100)).astype(np.float32)
    motion = np.full((90, 100, 2), (3.0, 4.0), np.float32)
    first = replace(before, light=light, motion=motion)
    second = replace(now, light=light, motion=np.asarray(motion + 0.5 * change, np.float32))
    pair = FramePair(first, second)
    before_it = 1.0, 3.0, 2.0
    sums = jitter_in_vectors(before_it, pair, jitters[:2], Conventions())
    assert sums == pytest.approx((1.0 + 0.5 * 0.5625, 3.0 + 0.5, 2.0 + 1.5625))
    opposite = jitter_in_vectors(before_it, pair, jitters[:2], Conventions(jitter_sign=-1))
    assert opposite == pytest.approx((1.0 - 0.5 * 0.5625, 3.0 - 0.5, 2.0 + 1.5625))
    assert jitter_in_vectors(before_it, pair, jitters[1:2], Conventions()) == before_it, "no third frame"
    smaller = FramePair(replace(first, motion=motion[:45]), second)
    assert jitter_in_vectors(before_it, smaller, jitters[:2], Conventions()) == before_it


# --- depth of surfaces that hide others ---


@pytest.mark.parametrize(
    ("as_reversed", "as_forward", "kind"),
    [
        ((0.0, 20.0), (0.0, 0.0), "linear"), ((0.0, 19.0), (0.0, 0.0), ""),
        ((4.9, 20.0), (0.0, 0.0), "linear"), ((5.0, 20.0), (0.0, 0.0), ""),
        ((0.0, 0.0), (20.0, 0.0), "forward"), ((0.0, 0.0), (19.0, 0.0), ""),
        ((0.0, 0.0), (20.0, 4.9), "forward"), ((0.0, 0.0), (20.0, 5.0), ""),
        ((2.0, 0.0), (20.0, 2.9), "forward"), ((2.1, 0.0), (20.0, 2.9), ""), ((20.0, 0.0), (0.0, 20.0), ""),
    ],
)  # fmt: skip
def test_depth_is_of_the_kind_in_which_closer_surfaces_hide_others(
    as_reversed: tuple[float, float], as_forward: tuple[float, float], kind: str
) -> None:
    """20 disoccluded pixels are enough, four times as many as those that contradict."""
    said = told(FramesSeen(pairs=2, surfaces={"reversed": as_reversed, "forward": as_forward}))
    assert ("as if depth were" in said) == bool(kind)
    assert kind in said
    surfaces: Any = {"reversed": as_reversed, "forward": as_forward}
    wrong_motion = FramesSeen(pairs=2, surfaces=surfaces, errors={FLIPPED: (0.2, 0.02)})
    assert "as if depth were" not in told(wrong_motion)


def test_one_pair_of_frames_is_no_more_than_15_disoccluded_pixels() -> None:
    """A card of linear depth is in front of a wall, disappears, and comes back in a strip of two rows."""
    y, x = np.mgrid[:90, :100]
    light = np.random.default_rng(0).random((90, 100, 3)).astype(np.float32)

    def after(seen: FramesSeen, rows: int, step: float = 0.0) -> FramesSeen:
        wall = np.float32(5.0) + np.float32(0.01) * x + np.float32(0.013) * y
        depth = np.where((x < 40) & (y < rows), 2.0, np.rint(wall / step) * step if step else wall)
        made = replace(even((0.1 * len(seen.jitters), 0.2), (100, 90)), color=light)
        return seen.after(FrameProbe.of_frame(replace(made, depth=depth.astype(np.float32))), (200, 180))

    gone = after(after(after(FramesSeen(), rows=40), rows=0), rows=0)
    assert gone.surfaces["reversed"] == (0.0, 15.0)
    assert gone.surfaces["forward"] == (0.0, 0.0), "negative"
    back = after(gone, rows=10)
    assert back.surfaces["reversed"] == (15.0, 15.0)
    assert after(back, rows=10, step=0.25).surfaces == {}, "too coarse"
    few = after(after(FramesSeen(), rows=0), rows=2)
    assert few.surfaces["reversed"] == (38.0, 0.0) or few.surfaces["reversed"][0] <= 15.0


# --- the state of the checks ---


def test_the_last_64_jitters_are_kept_and_an_unshaded_frame_is_no_neighbour() -> None:
    size, seen = (40, 30), FramesSeen()
    for index in range(70):
        seen = seen.after(FrameProbe.of_frame(even((0.001 * index, 0.0), size)), size)
    assert len(seen.jitters) == 64
    assert seen.jitters[-1] == (0.001 * 69, 0.0)
    assert seen.previous is not None
    assert seen.pairs == 0, "there is no texture"
    seen = seen.after(FrameProbe.of_frame(replace(even((0.3, 0.3), size), color=None)), size)
    assert seen.previous is None
    assert len(seen.jitters) == 64
    assert seen.jitters[-1] == (0.001 * 69, 0.0)


def test_an_image_that_has_moved_without_motion_is_remembered() -> None:
    noise, size, seen = (
        np.random.default_rng(0).random((90, 100, 3)).astype(np.float32),
        (100, 90),
        FramesSeen(),
    )
    for index, moved in enumerate((0, 0, 5, 5)):
        frame = replace(even((0.1 * index, 0.2), size), color=np.roll(noise, moved, axis=1))
        seen = seen.after(FrameProbe.of_frame(frame), size)
        assert seen.lacks_motion is (index >= 2)
    assert seen.pairs == 3


# --- motion to the next frame ---


def steps(
    there: tuple[float, float], back: tuple[float, float], **fields: Any
) -> tuple[FrameProbe, FrameProbe]:
    """Return frames of a card that moves by `there` in the first, and came by `back` in the second."""
    first, second = (FrameProbe.of_frame(even(jitter, (100, 90))) for jitter in ((0.4, -0.4), (-0.4, 0.4)))
    motion, motion_next = (np.full((90, 100, 2), each, np.float32) for each in (back, there))
    return replace(first, motion_next=motion_next), replace(second, motion=motion, **fields)


def next_told(before: FrameProbe, now: FrameProbe) -> str:
    return "\n".join(str(mistake.error()) for mistake in motion_next_mistakes(before, now))


@pytest.mark.parametrize(("there", "said"), [
    ((8.0, -6.0), ""), ((-8.0, 6.0), "current minus next."), ((8.0, 6.0), "; it fits if it is y flipped."),
    ((-8.0, -6.0), "current minus next, y flipped."), ((8.0, -8.4), ""), ((10.4, -6.0), ""),
    ((8.0, -10.0), "leads back 4.0 pixels off, with vectors of 12.8"), ((25.0, -20.0), "leads back"),
    ((0.0, 0.0), "leads back 10.0 pixels off, with vectors of 10.0"),
])  # fmt: skip
def test_motion_to_the_next_frame_leads_to_where_motion_leads_back(
    there: tuple[float, float], said: str
) -> None:
    """Motion of (-8, 6) pixels leads back; a quarter of its length may differ."""
    found = next_told(*steps(there, (-8.0, 6.0)))
    assert said.replace(".", "") in found.replace(".", "")
    assert bool(found) is bool(said)
    assert ("it fits if" in found) is ("flipped" in said or "minus" in said)


def test_motion_to_the_next_frame_may_differ_by_a_quarter_of_a_pixel_and_half_a_pixel_is_not_read() -> None:
    assert next_told(*steps((0.7, 0.0), (-0.47, 0.0))) == ""
    assert "off" in next_told(*steps((0.7, 0.0), (-0.4, 0.0)))
    assert "off" in next_told(*steps((0.0, 0.4), (0.0, -0.7)))
    assert next_told(*steps((0.45, 0.0), (0.4, 0.0))) == ""


def test_motion_to_the_next_frame_is_compared_without_a_cut_and_at_one_size() -> None:
    before, now = steps((8.0, 6.0), (-8.0, 6.0))
    assert next_told(before, now) != ""
    assert next_told(before, replace(now, reset=True)) == ""
    assert next_told(replace(before, motion_next=None), now) == ""
    smaller = replace(now, depth=now.depth[:80], motion=now.motion[:80])
    assert next_told(before, smaller) == ""
    assert (
        next_told(*(replace(f, depth=f.depth[:3, :3], motion=f.motion[:3, :3]) for f in (before, now))) == ""
    )
    nowhere = np.full_like(now.motion, np.nan)
    assert next_told(replace(before, motion_next=nowhere), now) == ""
    assert next_told(before, replace(now, motion=nowhere)) == ""


@pytest.mark.parametrize(
    ("depth", "compared"), [(0.1052, True), (0.106, False), (0.0951, True), (0.094, False)]
)
def test_motion_is_compared_on_one_surface(depth: float, compared: bool) -> None:
    before, now = steps((8.0, 6.0), (-8.0, 6.0), depth=np.full((90, 100), depth, np.float32))
    assert bool(next_told(before, now)) is compared


def test_motion_to_the_next_frame_is_followed_from_sample_to_sample() -> None:
    """With the change of the jitter, it leads 4 columns and -2 rows on, to pixels that move back alike."""
    before, now = steps((3.0, -1.0), (-3.0, 1.0))
    rows, columns = np.mgrid[:90, :100]
    right = (rows % 3 == 0) & (columns % 3 == 0)
    motion = np.where(right[..., None], now.motion, np.array([4.0, 5.0], np.float32))
    start = np.roll(right, (2, -4), (0, 1))
    following = np.full_like(motion, np.nan)
    following[start] = 3.0, -1.0
    assert next_told(replace(before, motion_next=following), replace(now, motion=motion)) == ""
    other = np.roll(following, 1, 0), np.roll(following, 1, 1)
    for wrong in other:
        assert next_told(replace(before, motion_next=wrong), replace(now, motion=motion)) != ""


@pytest.mark.parametrize(("count", "judged"), [(199, False), (200, True)])
def test_200_pixels_prove_that_motion_to_the_next_frame_is_wrong(count: int, judged: bool) -> None:
    before, now = steps((8.0, 6.0), (-8.0, 6.0))
    following = np.full((90, 100, 2), np.nan, np.float32)
    following[20:40, 20:40].reshape(-1, 2)[:] = np.nan
    rows, columns = np.unravel_index(np.arange(count), (20, 20))
    following[20 + rows, 20 + columns] = 8.0, 6.0
    assert bool(next_told(replace(before, motion_next=following), now)) is judged
