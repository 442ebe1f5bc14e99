"""Hypotheses about motion, jitter and depth, and what each leaves unexplained."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise, product
from typing import Any

import numpy as np

from supersampler.conventions import Conventions
from supersampler.validation.depth_order import ORDERS, DepthOrder, bend, sky_share, uncovered
from supersampler.validation.detection import Hypothesis, Verdict, ranked
from supersampler.validation.evidence import Step, Still
from supersampler.validation.reprojection import MIN_PLACES, grid, moving

Overrides = dict[str, Any]

_UNITS = ("pixels", "uv", "ndc")
_MOTIONS: tuple[Overrides, ...] = tuple(
    {"motion_unit": unit, "motion_direction": direction, "motion_flip_y": flip}
    for unit, direction, flip in product(
        _UNITS, ("previous_minus_current", "current_minus_previous"), (False, True)
    )
)
_JITTERS: tuple[Overrides, ...] = tuple(
    {"jitter_unit": unit, "jitter_sign": sign, "jitter_flip_y": flip}
    for unit, sign, flip in product(_UNITS, (1, -1), (False, True))
)
_BETTER = 0.8  # an error this much smaller is not chance


def jitters_in_the_pixel(stills: Sequence[Still], stated: Conventions) -> list[Overrides]:
    """Return the ways to read the jitter that leave samples in their pixel; none where it never changes."""
    raw = [still.raw.jitter or (0.0, 0.0) for still in stills]
    if np.ptp(raw, axis=0).max() == 0:
        return []

    def largest(overrides: Overrides) -> float:
        return max(float(np.abs(still.jitter(replace(stated, **overrides))).max()) for still in stills)

    return [overrides for overrides in _JITTERS if largest(overrides) <= 0.5 + 1e-3]


def rank_motion(steps: Sequence[Step], jitters: Sequence[Overrides], stated: Conventions) -> Verdict:
    """Rank unit, direction, flip and whether jitter is in the vectors, by reprojection error.

    Each is taken with the jitter that suits it best, so that a wrong jitter does not spoil right motion.
    """
    if not steps:
        return Verdict("motion", (), "no two neighbouring frames have texture to compare")
    steps = [step for step in steps if moving(step.now.vectors(stated, step.places)).sum() >= MIN_PLACES / 4]
    if not steps:
        return Verdict("motion", (), "nothing moves, or next to nothing")
    hypotheses = []
    for overrides in _MOTIONS:
        bare = _motion_error(steps, stated, overrides, None)
        shifted = [_motion_error(steps, stated, overrides, jitter) for jitter in jitters]
        hypotheses += _motion_hypotheses(overrides, bare, min(shifted, default=None))
    verdict = ranked("motion", hypotheses, stated)
    still = min(_motion_error(steps, stated, None, jitter) for jitter in [None, *jitters])
    if verdict.ranked[0].error > _BETTER * still:
        return Verdict("motion", verdict.ranked, "no reading explains the picture much better than no motion")
    return verdict


def rank_jitter(steps: Sequence[Step], jitters: Sequence[Overrides], found: Conventions) -> Verdict:
    """Rank unit, sign and flip of the jitter, once motion is known.

    The picture tells, unless jitter is in the vectors: those lead to the right colour whatever the jitter is
    called. Then it is the reading that leaves the smoothest motion from frame to frame.
    """
    if not jitters:
        return Verdict("jitter", (), "it never changes, or no unit brings it into the pixel")
    if found.motion_jittered:
        if len(steps) < 2:
            return Verdict("jitter", (), "motion has jitter in it, which takes three frames in a row")
        errors = [_roughness(steps, replace(found, **overrides)) for overrides in jitters]
    else:
        if not steps:
            return Verdict("jitter", (), "no two neighbouring frames have texture to compare")
        errors = [_jitter_error(steps, replace(found, **overrides)) for overrides in jitters]
    hypotheses = [Hypothesis(_jitter_text(o), o, e) for o, e in zip(jitters, errors, strict=True)]
    return ranked("jitter", hypotheses, found)


def rank_depth(steps: Sequence[Step], stills: Sequence[Still], found: Conventions) -> Verdict:
    """Rank reversed, forward and linear depth: three witnesses, each an error from 0 to 1, added.

    What moves uncovers what was behind it; the sky has its value; 1 / distance is linear along a plane.
    """
    bends = np.array([np.mean([bend(still.depth, order) for still in stills]) for order in ORDERS])
    skies = np.array([np.mean([sky_share(still.depth, order) for still in stills]) for order in ORDERS])
    hypotheses = []
    for index, order in enumerate(ORDERS):
        crooked = _share(bends[index], bends, least=1e-4)
        blue = 0.5 if skies.max() < 1e-3 else float(skies[index] < 1e-3)
        error = _hidden_wrong(steps, order, found) + blue + crooked
        hypotheses.append(Hypothesis(_DEPTH_TEXT[order], _depth_overrides(order, stills, found), error))
    return ranked("depth", hypotheses, found)


def swapped_axes(steps: Sequence[Step], jitters: Sequence[Overrides], found: Conventions) -> list[str]:
    """Return notes where motion or jitter explains the picture better with x and y exchanged."""
    notes: list[str] = []
    if not steps:
        return notes
    as_found = _jitter_error(steps, found)
    swapped = [_jitter_error(steps, replace(found, **o), motion_swapped=True) for o in _MOTIONS]
    if min(swapped) < _BETTER * as_found:
        notes.append("Motion looks as if it were (y, x): hand it in as motion[..., ::-1].")
    if jitters:  # exchanged jitter fits nothing, so that motion seems to have jitter in it
        bare = replace(found, motion_jittered=False)
        errors = [_jitter_error(steps, replace(bare, **o), jitter_swapped=True) for o in jitters]
        if min(errors) < _BETTER * as_found:
            notes.append("Jitter looks as if it were (y, x): hand in (x, y).")
    return notes


def _motion_hypotheses(overrides: Overrides, bare: float, shifted: float | None) -> list[Hypothesis]:
    text = f"{overrides['motion_unit']}, {overrides['motion_direction'].replace('_', ' ')}"
    text += ", y flipped" if overrides["motion_flip_y"] else ""
    plain = Hypothesis(text, {**overrides, "motion_jittered": False}, bare if shifted is None else shifted)
    if shifted is None:
        return [plain]
    return [plain, Hypothesis(f"{text}, with jitter in it", {**overrides, "motion_jittered": True}, bare)]


def _motion_error(
    steps: Sequence[Step], stated: Conventions, motion: Overrides | None, jitter: Overrides | None
) -> float:
    """Mean error where something moves; without `motion` as if nothing did, without `jitter` as if in it."""
    errors = []
    for step in steps:
        conventions = replace(stated, **(motion or {}), **(jitter or {}))
        vectors = step.now.vectors(conventions, step.places)
        offset = (vectors if motion else 0 * vectors) + (step.shift(conventions) if jitter else 0.0)
        errors.append(step.pair.error(offset, moving(step.now.vectors(stated, step.places))))
    return float(np.mean(errors))


def _jitter_error(
    steps: Sequence[Step],
    conventions: Conventions,
    *,
    motion_swapped: bool = False,
    jitter_swapped: bool = False,
) -> float:
    errors = []
    for step in steps:
        offset = step.now.vectors(conventions, step.places, swapped=motion_swapped).astype(np.float64)
        if not conventions.motion_jittered:
            shift = step.shift(conventions)
            offset += shift[::-1] if jitter_swapped else shift
        errors.append(step.pair.error(offset))
    return float(np.mean(errors))


def _roughness(steps: Sequence[Step], conventions: Conventions) -> float:
    """Median change of motion from one frame to the next, in pixels, once the jitter is taken out."""
    places = grid(steps[0].now.size, 4000)
    fields = [step.now.vectors(conventions, places) - step.shift(conventions) for step in steps]
    return float(np.mean([np.median(np.abs(now - before)) for before, now in pairwise(fields)]))


def _jitter_text(overrides: Overrides) -> str:
    sign = "centre + jitter" if overrides["jitter_sign"] == 1 else "centre - jitter"
    return f"{overrides['jitter_unit']}, {sign}{', y flipped' if overrides['jitter_flip_y'] else ''}"


_DEPTH_TEXT = {
    "reversed": "reversed (larger is closer)", "forward": "forward (0 is the near plane)",
    "linear": "linear (a distance)",
}  # fmt: skip


def _depth_overrides(order: DepthOrder, stills: Sequence[Still], found: Conventions) -> Overrides:
    """Keep what was stated where it is of this order: planes cannot be seen."""
    if found.depth.startswith(order):
        return {"depth": found.depth, "far": found.far}
    if order != "linear":
        return {"depth": f"{order}_infinite", "far": None}
    far = max(float(still.depth.max()) for still in stills)
    return {"depth": "linear", "far": far if 1e6 <= far < np.inf else None}


def _hidden_wrong(steps: Sequence[Step], order: DepthOrder, found: Conventions) -> float:
    """Share of uncovered places that a farther surface should have hidden; 0.5 where there are none."""
    closer = farther = 0
    for step in steps:
        places = grid(step.now.size, 60_000)
        offset = step.now.vectors(found, places).astype(np.float64)
        if not found.motion_jittered:
            offset += step.shift(found)
        counts = uncovered(step.now.depth, step.before.depth, order, places, offset)
        closer, farther = closer + counts[0], farther + counts[1]
    return (farther + 1) / (closer + farther + 2)


def _share(value: float, values: Any, *, least: float) -> float:
    largest = np.nanmax(values, initial=0.0)
    if largest < least:
        return 0.0
    return 1.0 if np.isnan(value) else float(value / largest)
