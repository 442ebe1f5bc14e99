"""Rank hypotheses about motion, jitter and depth by their errors."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from supersampler.conventions import Conventions
from supersampler.validation.depth_order import ORDERS, DepthOrder, bend, sky_share
from supersampler.validation.detection import Hypothesis, Verdict, ranked
from supersampler.validation.evidence import Evidence, grid
from supersampler.validation.mistakes import JITTER_SWAPPED, MOTION_SWAPPED, Mistake
from supersampler.validation.readings import JITTERS, MOTIONS, Overrides, reading_text
from supersampler.validation.reprojection import MIN_PLACES, FramePair

_MAX_RATIO = 0.8  # maximum ratio of errors for a significant improvement
_NO_TEXTURE = "no two neighbouring frames have texture to compare"
_DEPTH_TEXT = {
    "reversed": "reversed (larger is closer)", "forward": "forward (0 is the near plane)",
    "linear": "linear (a distance)",
}  # fmt: skip


def jitters_in_the_pixel(frames: Sequence[Evidence], stated: Conventions) -> list[Overrides]:
    """Return the readings of the jitter that keep samples inside their pixel; none for constant jitter."""
    if np.ptp([frame.jitter for frame in frames], axis=0).max() == 0:
        return []

    def largest(overrides: Overrides) -> float:
        reading = replace(stated, **overrides)
        return max(float(np.abs(frame.jitter_pixels(reading)).max()) for frame in frames)

    return [overrides for overrides in JITTERS if largest(overrides) <= 0.5 + 1e-3]


def rank_motion(pairs: Sequence[FramePair], jitters: Sequence[Overrides], stated: Conventions) -> Verdict:
    """Rank unit, direction, flip and whether jitter is in the vectors, by reprojection error.

    Each reading is combined with its best reading of the jitter, so that wrong jitter does not affect it.
    """
    if not pairs:
        return Verdict("motion", (), _NO_TEXTURE)
    moves = {pair: pair.moving(stated) for pair in pairs}
    pairs = [pair for pair in pairs if moves[pair].sum() >= MIN_PLACES / 4]
    if not pairs:
        return Verdict("motion", (), "nothing moves, or next to nothing")

    def error(reading: Conventions) -> float:
        errors = [pair.error(pair.offset(reading), moves[pair]) for pair in pairs]
        return float(np.mean(errors))

    def error_of_no_motion(reading: Conventions) -> float:
        shifts = [0.0 if reading.motion_jittered else pair.shift(reading) for pair in pairs]
        errors = [pair.error(np.array(s), moves[pair]) for pair, s in zip(pairs, shifts, strict=True)]
        return float(np.mean(errors))

    def hypothesis(overrides: Overrides, error: float) -> Hypothesis:
        return Hypothesis(reading_text("motion", Conventions(**overrides)), overrides, error)

    hypotheses = []
    with_jitter = replace(stated, motion_jittered=True)
    readings = [replace(stated, **jitter, motion_jittered=False) for jitter in jitters]
    for overrides in MOTIONS:
        bare = error(replace(with_jitter, **overrides))
        best = min((error(replace(reading, **overrides)) for reading in readings), default=bare)
        hypotheses.append(hypothesis({**overrides, "motion_jittered": False}, best))
        if readings:
            hypotheses.append(hypothesis({**overrides, "motion_jittered": True}, bare))
    verdict = ranked("motion", hypotheses, stated)
    if verdict.ranked[0].error > _MAX_RATIO * min(map(error_of_no_motion, [with_jitter, *readings])):
        return Verdict("motion", verdict.ranked, "no reading explains the image much better than no motion")
    return verdict


def rank_jitter(pairs: Sequence[FramePair], jitters: Sequence[Overrides], found: Conventions) -> Verdict:
    """Rank unit, sign and flip of the jitter, for known motion.

    The error is that of the reprojected image. Where jitter is in the vectors, that does not depend on the
    jitter's conventions, and the error is the change of unjittered motion from frame to frame.
    """
    if not jitters:
        return Verdict("jitter", (), "it never changes, or no unit brings it into the pixel")
    if found.motion_jittered and not _neighbours(pairs):
        return Verdict("jitter", (), "motion has jitter in it, which takes three frames of one size in a row")
    if not pairs:
        return Verdict("jitter", (), _NO_TEXTURE)
    error = _roughness if found.motion_jittered else _error
    hypotheses = []
    for overrides in jitters:
        reading = replace(found, **overrides)
        hypotheses.append(Hypothesis(reading_text("jitter", reading), overrides, error(pairs, reading)))
    return ranked("jitter", hypotheses, found)


def rank_depth(pairs: Sequence[FramePair], frames: Sequence[Evidence], found: Conventions) -> Verdict:
    """Rank reversed, forward and linear depth by the sum of three errors, each from 0 to 1.

    They are of disocclusions, whose occluders are closer; of the sky's value; and of planes, where 1 /
    distance is linear.
    """
    bends = np.array([np.mean([bend(frame.depth, order) for frame in frames]) for order in ORDERS])
    skies = np.array([np.mean([sky_share(frame.depth, order) for frame in frames]) for order in ORDERS])
    hypotheses = []
    for order, bent, sky in zip(ORDERS, bends, skies, strict=True):
        no_sky = 0.5 if skies.max() < 1e-3 else float(sky < 1e-3)
        error = _wrongly_hidden(pairs, order, found) + no_sky + _share(bent, bends, least=1e-4)
        hypotheses.append(Hypothesis(_DEPTH_TEXT[order], _depth_overrides(order, frames, found), error))
    return ranked("depth", hypotheses, found)


def swapped_axes(
    pairs: Sequence[FramePair], jitters: Sequence[Overrides], found: Conventions
) -> list[Mistake]:
    """Return the mistakes that x and y of motion or jitter are exchanged, by reprojection error."""
    mistakes: list[Mistake] = []
    if not pairs:
        return mistakes
    limit = _MAX_RATIO * _error(pairs, found)
    if min(_error(pairs, replace(found, **o), motion_swapped=True) for o in MOTIONS) < limit:
        mistakes.append(MOTION_SWAPPED)
    if jitters:  # with exchanged jitter, motion seems to have jitter in it
        bare = replace(found, motion_jittered=False)
        if min(_error(pairs, replace(bare, **o), jitter_swapped=True) for o in jitters) < limit:
            mistakes.append(JITTER_SWAPPED)
    return mistakes


def _error(
    pairs: Sequence[FramePair],
    reading: Conventions,
    *,
    motion_swapped: bool = False,
    jitter_swapped: bool = False,
) -> float:
    """Return the mean reprojection error over all places."""
    offsets = [
        pair.offset(reading, motion_swapped=motion_swapped, jitter_swapped=jitter_swapped) for pair in pairs
    ]
    return float(np.mean([p.error(offset) for p, offset in zip(pairs, offsets, strict=True)]))


def _roughness(pairs: Sequence[FramePair], reading: Conventions) -> float:
    """Return the median change of unjittered motion from frame to frame, in pixels."""

    def motion(pair: FramePair) -> NDArray[np.float64]:
        return pair.now.vectors(reading, grid(pair.now.size, 4000)) - pair.shift(reading)

    changes = [np.abs(motion(now) - motion(before)) for before, now in _neighbours(pairs)]
    return float(np.mean([np.median(change) for change in changes]))


def _neighbours(pairs: Sequence[FramePair]) -> list[tuple[FramePair, FramePair]]:
    """Return consecutive pairs of one size, whose motion can be compared pixel by pixel."""
    return [(before, now) for before, now in pairwise(pairs) if now.now.size == before.now.size]


def _depth_overrides(order: DepthOrder, frames: Sequence[Evidence], found: Conventions) -> Overrides:
    """Return overrides for an order; near and far planes are kept as stated, as images do not show them."""
    if found.depth.startswith(order):
        return {"depth": found.depth, "far": found.far}
    if order != "linear":
        return {"depth": f"{order}_infinite", "far": None}
    far = max(float(frame.depth.max()) for frame in frames)
    return {"depth": "linear", "far": far if 1e6 <= far < np.inf else None}


def _wrongly_hidden(pairs: Sequence[FramePair], order: DepthOrder, found: Conventions) -> float:
    """Return the fraction of disoccluded places with a farther occluder; 0.5 without such places."""
    counts = [pair.disoccluded(order, found, 60_000) for pair in pairs]
    closer, farther = sum(count[0] for count in counts), sum(count[1] for count in counts)
    return (farther + 1) / (closer + farther + 2)


def _share(value: float, values: NDArray[np.float64], *, least: float) -> float:
    largest = np.nanmax(values, initial=0.0)
    if largest < least:
        return 0.0
    return 1.0 if np.isnan(value) else float(value / largest)
