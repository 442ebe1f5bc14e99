"""Tests of the checks over several frames: jitter, depth order, readings of motion."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from plain_frames import complaints
from supersampler import Conventions, Frame
from supersampler.validation.probe import FrameProbe
from supersampler.validation.rankings import SURE, Hypothesis, Verdict, ranked
from supersampler.validation.temporal import (
    FACTORS,
    FramesSeen,
    motion_next_mistakes,
    temporal_mistakes,
    vectors_have_jitter,
    wrong_amplitude,
)


def even(jitter: tuple[float, float], size: tuple[int, int]) -> Frame:
    """A frame without texture: nothing but its jitter can be wrong."""
    shape = size[::-1]
    color, motion = np.full((*shape, 3), 0.4, np.float32), np.zeros((*shape, 2), np.float32)
    return Frame(color=color, depth=np.full(shape, 0.1, np.float32), motion=motion, jitter=jitter)


def complaint(*jitters: tuple[float, float], size: tuple[int, int] = (80, 70)) -> str:
    return complaints(*(even(jitter, size) for jitter in jitters), display=(160, 140))


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


def test_near_a_tie_what_was_stated_comes_first() -> None:
    assert verdict(1.0, 1.5, 1.01).ranked[0].text == "pixels"
    assert verdict(1.0, 1.5, 1.03).ranked[0].text == "uv"
    stated = Conventions(motion_unit="ndc")
    assert verdict(1.0, 1.01, 1.5, stated=stated).ranked[0].text == "ndc"
    assert verdict(1.0, 1.3, stated=stated).reason == "'uv' fits only 1.30 times better than as stated"
    assert verdict(1.0, 1.4, stated=stated).certain


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
def test_a_jitter_that_is_wrong_in_both_axes_is_found(factor: float, pairs: int, gain: float) -> None:
    found: Any = wrong_amplitude(errors(factor, factor, gain), pairs, 64)
    assert (found.x, found.y) == pytest.approx((factor, factor), abs=1e-6)
    assert wrong_amplitude(errors(factor, factor, gain - 0.03), pairs, 64) is None


@pytest.mark.parametrize(("x", "y"), [(0.5, 1.0), (1.0, 0.5), (1.2, 0.5), (0.5, 1.5)])
def test_a_jitter_that_is_wrong_in_one_axis_takes_more_frames_and_pixels(x: float, y: float) -> None:
    assert wrong_amplitude(errors(x, y, 0.12), 6, 96) is not None
    assert wrong_amplitude(errors(x, y, 0.06), 6, 96) is None
    assert wrong_amplitude(errors(x, y, 0.12), 5, 96) is None
    assert wrong_amplitude(errors(x, y, 0.12), 6, 95) is None


@pytest.mark.parametrize("part", [0.5, 1.6])
@pytest.mark.parametrize("pairs", [2, 6])
def test_a_jitter_in_images_that_hardly_differ_or_are_unrelated_is_not_judged(
    part: float, pairs: int
) -> None:
    found = errors(part, part, 0.2)  # the least is 0.08

    def judged(pairs: int, factor: float = 1.0, variance: float = VARIANCE) -> bool:
        changed = {factors: (factor * error, variance) for factors, (error, _) in found.items()}
        return wrong_amplitude(changed, pairs, 96) is not None

    assert judged(pairs)
    assert not judged(1), "one pair"
    assert [judged(3, 2e-4), judged(2, 2e-4), judged(2, 3e-4)] == [False, False, True], "the dark"
    assert [judged(pairs, variance=0.11), judged(pairs, variance=0.12)] == [False, True], "unrelated images"
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


def told(**fields: Any) -> str:
    """Return what is said about frames of 100 x 90 pixels whose jitter changes."""
    fields = {"pairs": 2, "jitters": ((0.1, 0.2), (0.3, -0.4)), "amplitudes": errors(0.9, 1.1, 0.0), **fields}
    found = temporal_mistakes(FramesSeen(**fields), (100, 90), (200, 180))
    return "\n".join(str(mistake.error()) for mistake in found)


@pytest.mark.parametrize(("x", "y", "said"), [
    (0.5, 0.5, "frame.jitter is 0.50 times as large in the image"), (0.3, 0.5, "0.40 times as"),
    (0.2, 0.5, "0.35 (0.20 in x, 0.50 in y) times as"), (0.5, 0.2, "0.35 (0.50 in x, 0.20 in y) times as"),
    (0.9, 0.9, ""),
])  # fmt: skip
def test_a_part_of_the_jitter_in_the_image_is_told_by_axis_where_they_differ(
    x: float, y: float, said: str
) -> None:
    found = told(amplitudes=errors(x, y, 0.2))
    assert said in found if said else not found


@pytest.mark.parametrize(("varied", "jittered"), [
    ((1.0, 1.0), True), ((1.9, 1.0), True), ((0.6, 1.0), True), ((0.4, 1.0), False), ((2.1, 1.0), False),
    ((0.0, 0.0), False), ((-1.0, 1.0), False),
])  # fmt: skip
def test_vectors_that_change_alike_have_the_jitter(varied: tuple[float, float], jittered: bool) -> None:
    assert vectors_have_jitter(varied) is jittered
    for factor in (0.0, 0.4):
        said = told(amplitudes=errors(factor, factor, 0.5), varied=varied)
        assert ("motion_jittered=True" in said) is jittered
    assert "2.0 times better" in told(amplitudes=errors(0.0, 0.0, 0.5), varied=(1.0, 1.0))
    assert "not in the image" in told(amplitudes=errors(0.0, 0.0, 0.5))
    assert "0.60 times as large" in told(amplitudes=errors(0.6, 0.6, 0.5), varied=varied)


# --- another reading of motion or jitter ---


FLIPPED, NEGATED, JITTERED = (
    repr(Conventions(**fields))
    for fields in ({"motion_flip_y": True}, {"jitter_sign": -1}, {"motion_jittered": True})
)


@pytest.mark.parametrize(("pairs", "ratio"), [(1, 0.65), (2, 0.75), (5, 0.75)])
def test_a_reading_that_fits_clearly_better_is_named(pairs: int, ratio: float) -> None:
    def said(part: float, own: float = 0.1) -> str:
        return told(pairs=pairs, errors={FLIPPED: (own, part * own)})

    assert "frame.motion is misread" in said(ratio - 0.01)
    assert f"Try {FLIPPED}" in said(ratio - 0.01)
    assert "2.0 times better if it is pixels, previous minus current, y flipped" in said(0.5)
    assert said(ratio + 0.01) == ""
    assert "misread" in said(0.5, own=1.1e-5 * pairs)
    assert said(0.5, own=1e-5 * pairs) == "", "noise"


def test_the_reading_that_fits_best_is_named() -> None:
    errors_of = {FLIPPED: (0.2, 0.1), NEGATED: (0.1, 0.02)}
    said = told(errors=errors_of)
    assert said.startswith("frame.jitter is misread: frames fit 5.0 times better if it is pixels, centre - j")
    rows = repr(Conventions(motion_flip_y=True, jitter_flip_y=True))
    said = told(errors={**errors_of, rows: (0.4, 0.02)})
    assert "frame.color is bottom-up with depth and motion: frames then fit 20.0 times better" in said
    assert rows in said


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
    seen: dict[str, Any] = {"previous": frame, "pairs": 1, "errors": {NEGATED: (0.2, 0.02)}}
    assert told(**seen) == ""
    assert "misread" in told(**seen | {"pairs": 2})
    assert "misread" in told(**seen | {"previous": replace(frame, motion=frame.motion + 1)})
    assert "frame.motion is 0 everywhere" in told(**seen, lacks_motion=True)
    assert "misread" not in told(**seen | {"pairs": 2}, lacks_motion=True)


def test_jitter_is_sought_in_vectors_that_change_with_it_in_two_pairs() -> None:
    errors_of = {JITTERED: (0.2, 0.02)}
    assert "with jitter in it" in told(errors=errors_of, varied=(1.0, 1.0))
    assert told(errors=errors_of, varied=(1.0, 1.0), pairs=1) == ""
    assert told(errors=errors_of, varied=(0.1, 1.0)) == ""
    in_another_unit = repr(Conventions(motion_unit="uv", motion_jittered=True))
    assert "with jitter in it" in told(errors={in_another_unit: (0.2, 0.02)})


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
    surfaces = {"reversed": as_reversed, "forward": as_forward}
    said = told(surfaces=surfaces)
    assert ("as if depth were" in said) == bool(kind)
    assert kind in said
    assert "as if depth were" not in told(surfaces=surfaces, errors={FLIPPED: (0.2, 0.02)}), "wrong motion"


# --- the state of the checks ---


def test_an_image_that_has_moved_without_motion_is_remembered() -> None:
    noise, size, seen = np.random.default_rng(0).random((90, 100, 3), np.float32), (100, 90), FramesSeen()
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
def test_motion_to_the_next_frame_leads_where_motion_leads_back(
    there: tuple[float, float], said: str
) -> None:
    """Motion of (-8, 6) pixels leads back; a quarter of its length may differ."""
    found = next_told(*steps(there, (-8.0, 6.0)))
    assert said.replace(".", "") in found.replace(".", "")
    assert bool(found) is bool(said)
    assert ("it fits if" in found) is ("flipped" in said or "minus" in said)


@pytest.mark.parametrize(("there", "back", "found"), [
    ((0.7, 0.0), (-0.47, 0.0), False), ((0.7, 0.0), (-0.4, 0.0), True), ((0.0, 0.4), (0.0, -0.7), True),
    ((0.45, 0.0), (0.4, 0.0), False),
])  # fmt: skip
def test_motion_to_the_next_frame_may_differ_by_a_quarter_of_a_pixel_and_half_a_pixel_is_not_read(
    there: tuple[float, float], back: tuple[float, float], found: bool
) -> None:
    assert ("off" in next_told(*steps(there, back))) is found


def test_motion_to_the_next_frame_is_compared_without_a_cut_and_at_one_size() -> None:
    before, now = steps((8.0, 6.0), (-8.0, 6.0))
    assert next_told(before, now) != ""
    assert next_told(before, replace(now, reset=True)) == ""
    assert next_told(replace(before, motion_next=None), now) == ""
    smaller = replace(now, depth=now.depth[:80], motion=now.motion[:80])
    assert next_told(before, smaller) == ""
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
