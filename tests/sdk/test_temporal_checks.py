"""Tests of the checks over several frames: jitter, depth order, readings of motion."""

import warnings
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from supersampler.conventions import Conventions
from supersampler.errors import FrameError, FrameWarning
from supersampler.frame import Frame
from supersampler.validation import FrameChecker
from supersampler.validation.probe import (
    FrameProbe,
)
from supersampler.validation.rankings import SURE, Detection, Hypothesis, Verdict, ranked
from supersampler.validation.temporal import (
    FACTORS,
    FramesSeen,
    temporal_mistakes,
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


def test_near_a_tie_what_was_stated_comes_first() -> None:
    assert verdict(1.0, 1.5, 1.01).ranked[0].text == "pixels"
    assert verdict(1.0, 1.5, 1.03).ranked[0].text == "uv"
    assert verdict(1.0, 1.01, 1.5, stated=Conventions(motion_unit="ndc")).ranked[0].text == "ndc"


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
