"""Rank hypotheses about motion, jitter and depth by reprojection error."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from supersampler.conventions import Conventions
from supersampler.conventions.conventions import MAX_FACTOR
from supersampler.validation import probe
from supersampler.validation.mistakes import JITTER_SWAPPED, MOTION_SWAPPED, Mistake
from supersampler.validation.probe import DepthOrder, FrameProbe, Overrides
from supersampler.validation.reprojection import MIN_TEXTURED, FramePair
from supersampler.validation.single_frame import depth_values
from supersampler.validation.temporal import jitter_in_vectors, vectors_have_jitter

SURE = 1.15
"""Minimum ratio of the second-smallest error to the smallest for a certain verdict."""

_OVERRULES = 1.33  # minimum ratio of errors for a verdict that contradicts the stated conventions
_TIE = 1.02  # within this ratio of errors, the stated hypothesis ranks first
_MAX_RATIO = 0.8  # maximum ratio of errors for a significant improvement
_MIN_DIFFERENCE = 0.25  # minimum difference of the depth errors, without the error of planes
_MIN_SKY = 1e-3  # minimum fraction of pixels with the sky's value
_MIN_CURVATURE = 1e-4  # minimum curvature that distinguishes kinds of depth
_NO_TEXTURE = "no two neighbouring frames have enough texture to compare"
_DEPTH_TEXT = {
    "reversed": "reversed (larger is closer)", "forward": "forward (0 is the near plane)",
    "linear": "linear (a distance)",
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Hypothesis:
    """One interpretation of a field: overrides of `Conventions` fields, and its error."""

    text: str
    overrides: Mapping[str, Any]
    error: float


@dataclass(frozen=True, slots=True)
class Verdict:
    """Result for one field.

    Attributes:
        name: "motion", "jitter" or "depth".
        ranked: hypotheses, best first; empty without evidence.
        reason: why the result is uncertain; "" if it is certain.
    """

    name: str
    ranked: tuple[Hypothesis, ...] = ()
    reason: str = ""

    @property
    def certain(self) -> bool:
        """Whether the best hypothesis is clearly better than the others."""
        return not self.reason

    @property
    def margin(self) -> float:
        """Second-smallest error divided by the smallest; 1 is a tie."""
        if len(self.ranked) < 2:
            return 1.0
        return max(1.0, self.ranked[1].error / max(self.ranked[0].error, 1e-6))

    @property
    def overrides(self) -> Mapping[str, Any]:
        """Overrides of the best hypothesis; empty if it is uncertain."""
        return self.ranked[0].overrides if self.certain else {}

    @property
    def text(self) -> str:
        """One line of text: the best hypothesis and its margin, or why it is uncertain."""
        if not self.certain:
            return f"{self.name}: cannot tell, {self.reason}"
        found, runner_up = ([h.text for h in self.ranked] + [""])[:2]
        return f"{self.name}: {found}; the next best, {runner_up}, is {self.margin:.2f}x worse"


@dataclass(frozen=True, slots=True)
class Detection:
    """Detected conventions of a few frames.

    Attributes:
        motion, jitter, depth: the verdicts.
        stated: the given conventions; they are kept where a verdict is uncertain.
        conventions: the detected conventions; `call` is their Python expression.
        notes: other mistakes and hints, as text.
        has_mistakes: whether a note is of a mistake that `validate="strict"` would refuse.
    """

    motion: Verdict
    jitter: Verdict
    depth: Verdict
    stated: Conventions
    conventions: Conventions
    notes: tuple[str, ...] = ()
    has_mistakes: bool = False

    @property
    def agrees(self) -> bool:
        """Whether the detected conventions are the stated ones, and the frames have no other mistake."""
        return self.conventions == self.stated and not self.has_mistakes

    @property
    def call(self) -> str:
        """Python expression of the detected conventions: `Conventions(...)` without defaults."""
        return repr(self.conventions)

    @property
    def verdicts(self) -> tuple[Verdict, Verdict, Verdict]:
        """Verdicts on motion, jitter and depth."""
        return self.motion, self.jitter, self.depth

    def summary(self) -> str:
        """Return lines of text: each verdict with its margin, the notes, and the Python expression."""
        end = [f"The frames are as stated: {self.call}"]
        if self.conventions == self.stated and self.has_mistakes:
            end = [f"The frames have mistakes that Conventions do not describe; stated: {self.call}"]
        elif not self.agrees:
            end = [f"The frames are not as stated: {self.stated!r}", f"Write: {self.call}"]
        return "\n".join([*(verdict.text for verdict in self.verdicts), *self.notes, *end])


def ranked(name: str, hypotheses: Sequence[Hypothesis], stated: Conventions) -> Verdict:
    """Return the verdict on one or more hypotheses; near a tie, the stated one ranks first.

    If several fit alike, one with only the changes that all of them share represents them: of motion along x
    alone, the direction is certain, and y is not.
    """

    def error(hypothesis: Hypothesis) -> float:
        if np.isnan(hypothesis.error):  # of vectors that are not finite
            return np.inf
        return hypothesis.error / (_TIE if _is_stated(hypothesis, stated) else 1.0)

    verdict = Verdict(name, tuple(sorted(hypotheses, key=error)))
    if not np.isfinite(verdict.ranked[0].error):
        return Verdict(name, verdict.ranked, "no reading gives vectors that stay in the image")
    if len(verdict.ranked) > 1 and verdict.margin < SURE:
        first, second = verdict.ranked[:2]
        alike = [h for h in verdict.ranked if h.error < SURE * max(first.error, 1e-6)]
        shared = set.intersection(*(_changes(h, stated) for h in alike))
        common = [h for h in alike if shared and _changes(h, stated) == shared]
        if not common:
            return Verdict(name, verdict.ranked, f"'{first.text}' and '{second.text}' fit alike")
        verdict = Verdict(name, (common[0], *(h for h in verdict.ranked if h not in alike)))
    best, own = verdict.ranked[0], [h for h in verdict.ranked if _is_stated(h, stated)]
    if own and own[0] is not best and own[0].error < _OVERRULES * best.error:
        margin = own[0].error / max(best.error, 1e-6)
        reason = f"'{best.text}' fits only {margin:.2f} times better than as stated"
        return Verdict(name, verdict.ranked, reason)
    return verdict


def _changes(hypothesis: Hypothesis, stated: Conventions) -> set[tuple[str, Any]]:
    """Return the overrides that differ from what is stated."""
    return {(key, value) for key, value in hypothesis.overrides.items() if getattr(stated, key) != value}


def _is_stated(hypothesis: Hypothesis, stated: Conventions) -> bool:
    return not _changes(hypothesis, stated)


def jitters_in_the_pixel(frames: Sequence[FrameProbe], stated: Conventions) -> list[Overrides]:
    """Return the readings of the jitter that keep samples inside their pixels; none for constant jitter."""
    if len({frame.jitter for frame in frames}) == 1:
        return []

    def largest(overrides: Overrides) -> float:
        reading = replace(stated, **overrides)
        return max(float(np.abs(frame.jitter_pixels(reading)).max()) for frame in frames)

    return [overrides for overrides in probe.JITTER_READINGS if largest(overrides) <= 0.5 + 1e-3]


def rank_motion(pairs: Sequence[FramePair], jitters: Sequence[Overrides], stated: Conventions) -> Verdict:
    """Rank unit, direction and flip of motion, and whether it contains jitter, by reprojection error.

    Each reading is combined with the reading of the jitter that fits it best, so that wrong jitter does not
    affect it.
    """
    if not pairs:
        return Verdict("motion", (), _NO_TEXTURE)
    moves = _moving(pairs, stated)
    if not moves:
        return Verdict("motion", (), "too few pixels move")

    def error(reading: Conventions) -> float:
        return float(np.mean([pair.error(pair.offset(reading), where) for pair, where in moves.items()]))

    def error_of_no_motion(reading: Conventions) -> float:
        jittered = reading.motion_jittered
        shifts = {pair: np.zeros(2) if jittered else pair.shift(reading) for pair in moves}
        return float(np.mean([pair.error(shifts[pair], where) for pair, where in moves.items()]))

    def hypothesis(overrides: Overrides, error: float) -> Hypothesis:
        return Hypothesis(probe.reading_text("motion", Conventions(**overrides)), overrides, error)

    hypotheses = []
    with_jitter = replace(stated, motion_jittered=True)
    have_jitter = {
        repr(o): any(_vectors_have_jitter(pairs, replace(stated, **o, **jitter)) for jitter in jitters)
        for o in probe.MOTION_READINGS
    }
    readings = [replace(stated, **jitter, motion_jittered=False) for jitter in jitters]
    for overrides in probe.MOTION_READINGS:
        bare = error(replace(with_jitter, **overrides))
        best = min((error(replace(reading, **overrides)) for reading in readings), default=bare)
        hypotheses.append(hypothesis({**overrides, "motion_jittered": False}, best))
        if readings and have_jitter[repr(overrides)]:  # without jitter in the image, vectors have none either
            hypotheses.append(hypothesis({**overrides, "motion_jittered": True}, bare))
    verdict = ranked("motion", hypotheses, stated)
    best = verdict.ranked[0].error
    if np.isfinite(best) and best > _MAX_RATIO * min(map(error_of_no_motion, [with_jitter, *readings])):
        reason = "too little moves: no reading explains the image much better than no motion"
        return Verdict("motion", verdict.ranked, reason)
    return verdict


def rank_jitter(pairs: Sequence[FramePair], jitters: Sequence[Overrides], found: Conventions) -> Verdict:
    """Rank unit, sign and flip of the jitter, for known motion, by reprojection error.

    If the vectors contain jitter, the reprojection does not depend on the jitter's conventions. The error is
    then the change of unjittered motion from frame to frame.
    """
    if not jitters:
        return Verdict("jitter", (), "it never changes, or no unit keeps it inside the pixel")
    if found.motion_jittered and not _neighbours(pairs):
        return Verdict("jitter", (), "with jitter in motion, three consecutive frames of one size are needed")
    if not pairs:
        return Verdict("jitter", (), _NO_TEXTURE)
    error = _roughness if found.motion_jittered else _error
    hypotheses = []
    for overrides in jitters:
        reading = replace(found, **overrides)
        hypotheses.append(Hypothesis(probe.reading_text("jitter", reading), overrides, error(pairs, reading)))
    return ranked("jitter", hypotheses, found)


def rank_depth(pairs: Sequence[FramePair], frames: Sequence[FrameProbe], found: Conventions) -> Verdict:
    """Rank reversed, forward and linear depth by the sum of three errors, each from 0 to 1.

    They are the fraction of disocclusions with farther occluders, the absence of the sky's value, and the
    curvature of 1 / distance along planes. A constant frame, cleared or all sky, is no evidence.
    """
    frames = [frame for frame in frames if frame.depth.min() != frame.depth.max()]
    if not frames:
        return Verdict("depth", (), "it is the same everywhere")
    count = max(depth_values(frame.depth) for frame in frames)
    if count:
        return Verdict("depth", (), f"it has only {count} evenly spaced values")
    curved, skies = (
        {order: float(np.mean([measure(frame.depth, order) for frame in frames])) for order in probe.ORDERS}
        for measure in (probe.plane_curvature, probe.sky_fraction)
    )
    max_curvature = float(np.nanmax([*curved.values(), 0.0]))
    hypotheses, without_planes = [], {}
    for order in probe.ORDERS:
        no_sky = float(skies[order] < _MIN_SKY) if max(skies.values()) >= _MIN_SKY else 0.5
        without_planes[order] = _wrongly_hidden(pairs, order, found) + no_sky
        of_planes = 0.0
        if max_curvature >= _MIN_CURVATURE:
            of_planes = 1.0 if np.isnan(curved[order]) else curved[order] / max_curvature
        error = without_planes[order] + of_planes
        hypotheses.append(Hypothesis(_DEPTH_TEXT[order], _depth_overrides(order, frames, found), error))
    verdict = ranked("depth", hypotheses, found)
    best, own = (
        next(o for o in probe.ORDERS if kind.startswith(o))
        for kind in (verdict.ranked[0].overrides["depth"], found.depth)
    )
    if without_planes[best] > without_planes[own] - _MIN_DIFFERENCE and best != own:
        reason = f"only its planes look {best}, which may be a parallel projection"
        return Verdict("depth", verdict.ranked, reason)
    return verdict


def swapped_axes(
    pairs: Sequence[FramePair], jitters: Sequence[Overrides], found: Conventions
) -> list[Mistake]:
    """Return the mistakes that x and y of motion or jitter are exchanged, by reprojection error.

    Motion is compared at moving pixels only: vectors that leave the image are not compared, so that a wrong
    reading could fit best elsewhere.
    """
    mistakes: list[Mistake] = []
    moves = _moving(pairs, found)

    def error(reading: Conventions, *, swapped: bool) -> float:
        offsets = {pair: pair.offset(reading, motion_swapped=swapped) for pair in moves}
        return float(np.mean([pair.error(offsets[pair], where) for pair, where in moves.items()]))

    if moves:
        limit = _MAX_RATIO * error(found, swapped=False)
        if min(error(replace(found, **o), swapped=True) for o in probe.MOTION_READINGS) < limit:
            mistakes.append(MOTION_SWAPPED)
    limit = _MAX_RATIO * _error(pairs, found) if pairs else 0.0
    if pairs and jitters:  # with exchanged jitter, motion seems to have jitter in it
        bare = replace(found, motion_jittered=False)
        if min(_error(pairs, replace(bare, **o), jitter_swapped=True) for o in jitters) < limit:
            mistakes.append(JITTER_SWAPPED)
    return mistakes


def _vectors_have_jitter(pairs: Sequence[FramePair], reading: Conventions) -> bool:
    """Return whether motion changes with the jitter; True if there are too few frames to tell."""
    sums = 0.0, 0.0, 0.0
    for before, pair in _neighbours(pairs):
        sums = jitter_in_vectors(sums, pair, [before.before.jitter, before.now.jitter], reading)
    return sums[2] == 0 or vectors_have_jitter(sums)


def _moving(pairs: Sequence[FramePair], reading: Conventions) -> dict[FramePair, NDArray[np.bool_]]:
    """Return the mask of moving pixels of each pair that has enough of them."""
    moves = {pair: pair.moving(reading) for pair in pairs}
    return {pair: where for pair, where in moves.items() if where.sum() >= MIN_TEXTURED / 4}


def _error(pairs: Sequence[FramePair], reading: Conventions, *, jitter_swapped: bool = False) -> float:
    """Return the mean reprojection error of all compared pixels."""
    errors = [pair.error(pair.offset(reading, jitter_swapped=jitter_swapped)) for pair in pairs]
    return float(np.mean(errors))


def _roughness(pairs: Sequence[FramePair], reading: Conventions) -> float:
    """Return the median change of unjittered motion from frame to frame, in pixels."""

    def motion(pair: FramePair) -> NDArray[np.float64]:
        return pair.now.vectors(reading, probe.pixel_grid(pair.now.size, 4000)) - pair.shift(reading)

    changes = [np.abs(motion(now) - motion(before)) for before, now in _neighbours(pairs)]
    return float(np.mean([np.median(change) for change in changes]))


def _neighbours(pairs: Sequence[FramePair]) -> list[tuple[FramePair, FramePair]]:
    """Return consecutive pairs of the same size, whose motion can be compared pixel by pixel."""
    return [(before, now) for before, now in pairwise(pairs) if now.now.size == before.now.size]


def _depth_overrides(order: DepthOrder, frames: Sequence[FrameProbe], found: Conventions) -> Overrides:
    """Return overrides for an order; stated near and far planes are kept, as images do not show them."""
    if found.depth.startswith(order):
        return {"depth": found.depth, "far": found.far}
    if order != "linear":
        return {"depth": f"{order}_infinite", "far": None}
    far = max(float(frame.depth.max()) for frame in frames)
    if not 1e6 <= far < np.inf:
        return {"depth": "linear", "far": None}
    return {"depth": "linear", "far": min(far, MAX_FACTOR)}  # renderers write up to 3.4e38 in the sky


def _wrongly_hidden(pairs: Sequence[FramePair], order: DepthOrder, found: Conventions) -> float:
    """Return the fraction of disoccluded pixels with a farther occluder; 0.5 if none are disoccluded."""
    counts = [pair.disoccluded(order, found, 60_000) for pair in pairs]
    closer, farther = sum(count[0] for count in counts), sum(count[1] for count in counts)
    return (farther + 1) / (closer + farther + 2)
