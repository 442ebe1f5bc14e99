"""Checks over several frames: whether another reading of motion, jitter or depth fits better."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from supersampler.conventions import Conventions
from supersampler.frame import Size
from supersampler.validation import mistakes, probe
from supersampler.validation.mistakes import Mistake
from supersampler.validation.probe import DepthOrder, FrameProbe
from supersampler.validation.reprojection import MIN_TEXTURED, FramePair, frame_pairs
from supersampler.validation.single_frame import depth_values

Sums = Mapping[str, tuple[float, float]]
AmplitudeErrors = Mapping[tuple[float, float], tuple[float, ...]]
JitterInVectors = tuple[float, float, float]
"""Sums over frames of products of the jitter's change: with motion's change in x, in y, and with itself."""
_FACTORS_OF_AN_AXIS = (0.0, 0.5, 1.0, 1.5)
FACTORS = tuple(product(_FACTORS_OF_AN_AXIS, _FACTORS_OF_AN_AXIS))
"""Factors of the jitter's x and y that are tried."""

_MAX_RATIO_FIRST = 0.65  # maximum ratio of a reading's error to the stated one's, after one pair of frames
_MAX_RATIO_LATER = 0.75  # maximum ratio after several pairs, with summed errors
_MAX_RATIO_OF_BOTH = 0.9  # maximum ratio of the error with both read differently to that with one of them
_NOISE = 1e-5  # squares of tone-mapped luminance; smaller errors are noise
_MIN_DISOCCLUDED = 20  # minimum number of disoccluded pixels
_MAX_DISOCCLUDED = 15  # maximum per pair of frames, as jitter alone can hide thin geometry
_MIN_SIDE_OF_UNITS = 64  # pixels; in smaller images a jitter in pixels may be as small as in another unit
_MIN_REPEATS = 3  # minimum number of frames with the same jitter
_ORDERS: tuple[DepthOrder, ...] = ("reversed", "forward")
_BOTTOM_UP = Conventions(motion_flip_y=True, jitter_flip_y=True)
_RESEMBLING = Conventions(motion_flip_y=True, jitter_sign=-1)  # like _BOTTOM_UP where the jitter is vertical
_JITTER_FLIPPED = Conventions(jitter_flip_y=True)
_JITTER_READINGS: Mapping[str, Conventions] = {
    repr(Conventions(**o)): Conventions(**o)
    for o in probe.JITTER_READINGS
    if o["jitter_unit"] == "pixels" and Conventions(**o) != Conventions()
}
_READINGS: Mapping[str, Conventions] = {
    repr(reading): reading
    for reading in (
        *(Conventions(**o, motion_jittered=j) for o, j in product(probe.MOTION_READINGS, (False, True))),
        *_JITTER_READINGS.values(),
        _BOTTOM_UP,
        _RESEMBLING,
    )
    if reading != Conventions()
}
"""Readings of motion or jitter that do not depend on sizes, by their Python expressions."""
# Amplitude of the jitter in the image.
_MIN_PAIRS, _MIN_PAIRS_OF_AN_AXIS = 2, 6  # in two pairs, the jitter may hardly change along one axis
_MIN_GAIN = 0.04  # minimum relative decrease of the error with the best factors
_MIN_GAIN_OF_FEW = 0.12  # minimum for fewer than _MIN_PAIRS_OF_AN_AXIS; correct frames reach 0.09
_MIN_GAIN_OF_AN_AXIS = 0.08  # minimum if only one axis is wrong; correct frames reach 0.06
_MIN_SIDE_OF_AN_AXIS = 96  # pixels; in smaller images one textured surface decides an axis
_RIGHT = 0.25  # maximum difference of a correct factor from 1
_MAX_ERROR = 0.7  # of the variance; larger errors mean unrelated images
_PLAUSIBLE = (0.65, 1.5)  # factor of an axis; correct frames were estimated at 0.71 to 1.34
_PLAUSIBLE_MEAN = (0.75, 1.4)  # mean factor of both axes; correct frames: 0.82 to 1.25
# Motion to the next frame: factors of x and y, and the reading's name.
_NEXT_READINGS: Mapping[tuple[int, int], str] = {
    (1, 1): "",
    (-1, -1): "current minus next",
    (1, -1): "y flipped",
    (-1, 1): "current minus next, y flipped",
}
_SAME_SURFACE = 0.05  # maximum relative difference of depth on a surface
_MIN_MOVE = 0.5  # pixels: minimum length of vectors whose direction is certain
_MIN_PIXELS = 200
_MAX_DIFFERENCE, _MAX_FRACTION = 0.25, 0.25  # pixels, and of the median vector; beyond both is a mistake


class Amplitude(NamedTuple):
    """Estimated factors of the jitter's x and y; `none` is True if the image has no jitter at all."""

    x: float
    y: float
    none: bool


@dataclass(frozen=True, slots=True, kw_only=True)
class FramesSeen:
    """State of the checks since the last cut.

    Attributes:
        previous: copy of the previous frame; None if it is missing or was not shaded.
        pairs: number of compared pairs of frames.
        errors: for each reading, sums over the pairs of (error as stated, error of the reading).
        surfaces: for each depth order, numbers of disoccluded pixels with (closer, farther) occluders,
            at most _MAX_DISOCCLUDED per pair.
        jitters: jitter of the last 64 frames.
        amplitudes: for each factor of the jitter, sums over the pairs of (error, variance).
        varied: how much the motion changes with the jitter.
        lacks_motion: whether all motion is 0 in an image that moves.
        following: mistakes in the motion from the previous frame to this one.
    """

    previous: FrameProbe | None = None
    pairs: int = 0
    errors: Sums = field(default_factory=dict)
    surfaces: Mapping[DepthOrder, tuple[float, float]] = field(default_factory=dict)
    jitters: tuple[tuple[float, float], ...] = ()
    amplitudes: AmplitudeErrors = field(default_factory=dict)
    varied: JitterInVectors = (0.0, 0.0, 0.0)
    lacks_motion: bool = False
    following: tuple[Mistake, ...] = ()

    def after(self, frame: FrameProbe, display_size: Size) -> "FramesSeen":
        """Return the state after one more frame."""
        if frame.light is None:
            return replace(self, previous=None, following=())
        following = () if self.previous is None else motion_next_mistakes(self.previous, frame)
        seen = replace(
            self,
            previous=frame.copied(),
            jitters=(*self.jitters, frame.jitter)[-64:],
            following=tuple(following),
        )
        pairs = frame_pairs([frame] if self.previous is None else [self.previous, frame])
        if not pairs or not pairs[0].textured:
            return seen
        pair = pairs[0]
        return replace(
            seen,
            pairs=self.pairs + 1,
            errors=_added(self.errors, _errors(pair, display_size)),
            surfaces=_added(self.surfaces, _surfaces(pair)),
            amplitudes=_added(self.amplitudes, _amplitude_errors(pair)),
            varied=jitter_in_vectors(self.varied, pair, self.jitters, Conventions()),
            lacks_motion=self.lacks_motion or pair.lacks_motion,
        )


def temporal_mistakes(seen: FramesSeen, size: Size, display_size: Size) -> Iterator[Mistake]:
    """Yield the mistakes in the frames since the last cut."""
    yield from _jitter_values(seen.jitters, size)
    if seen.lacks_motion:
        yield mistakes.MOTION_ZERO
        return
    readings = _readings(size, display_size)
    call = _better_reading(seen, readings, size)
    if call:
        yield _misread(seen, call, readings[call])
        return  # disocclusions need the right motion
    yield from seen.following
    if len(set(seen.jitters)) > 1:
        for mistake in amplitude_mistakes(seen.amplitudes, seen.pairs, seen.varied, min(size)):
            call = _better_than_no_jitter(seen) if mistake == mistakes.JITTER_NOT_APPLIED else ""
            yield _misread(seen, call, _READINGS[call]) if call else mistake
    kind = _other_order(seen.surfaces)
    if kind and not _planes_are_reversed(seen.previous, kind):
        yield mistakes.depth_kind(f"moving surfaces hide closer ones, as if depth were {kind}", kind)


def _misread(seen: FramesSeen, call: str, reading: Conventions) -> Mistake:
    """Return the mistake that frames fit better by this reading, whose Python expression is `call`."""
    own, other = seen.errors[call]
    times = own / max(other, 1e-6)
    if reading == _BOTTOM_UP:
        return mistakes.ROWS_BOTTOM_UP.found(times=times, call=call)
    if call not in _JITTER_READINGS:
        text = probe.reading_text("motion", reading)
        return mistakes.MOTION_MISREAD.found(times=times, reading=text, call=call)
    if reading == _JITTER_FLIPPED:
        call += ", or bottom_up=True if the image is upside down"
    text = probe.reading_text("jitter", reading)
    return mistakes.JITTER_MISREAD.found(times=times, reading=text, call=call)


def _readings(size: Size, display_size: Size) -> Mapping[str, Conventions]:
    """Return the other readings of motion or jitter, by their Python expressions."""
    in_display_pixels = Conventions(motion_scale=(size[0] / display_size[0], size[1] / display_size[1]))
    return {**_READINGS, repr(in_display_pixels): in_display_pixels}


def _errors(pair: FramePair, display_size: Size) -> Sums:
    """Return the errors of a pair, (as stated, by the reading), for each reading that it can tell apart."""
    size, as_stated = pair.now.size, Conventions()
    moves = pair.moving(as_stated)
    few = moves.sum() < MIN_TEXTURED / 4
    own_moving = 0.0 if few else pair.error(pair.offset(as_stated), moves)
    unmoved = 0.0 if few else pair.error(pair.shift(as_stated), moves)
    own_all = pair.error(pair.offset(as_stated))
    errors = {}
    for call, reading in _readings(size, display_size).items():
        about_motion = reading.motion_factor(size, size) != (1.0, 1.0) and reading != _RESEMBLING
        if about_motion and few:
            continue
        own = own_moving if about_motion else own_all
        error = pair.error(pair.offset(reading), moves if about_motion else None)
        if about_motion and error > _MAX_RATIO_LATER * unmoved:
            error = max(error, own)  # it is hardly better than no motion
        errors[call] = (min(own, 1.0), min(error, 1.0))
    return errors


def _better_reading(seen: FramesSeen, readings: Mapping[str, Conventions], size: Size) -> str:
    """Return the reading with the smallest error relative to the stated one; "" if none is clearly better."""
    if seen.pairs < 2 and seen.previous is not None and not seen.previous.motion.any():
        return ""  # motion may be missing
    parts = {}
    for call, reading in readings.items():
        own, other = seen.errors.get(call, (0.0, 0.0))
        # an image with another jitter than stated also fits vectors that contain jitter
        has_jitter = seen.pairs >= 2 and vectors_have_jitter(seen.varied, reading.motion_factor(size, size))
        if own > _NOISE * seen.pairs and (has_jitter or not reading.motion_jittered):
            parts[call] = other / own
    limit = _MAX_RATIO_FIRST if seen.pairs == 1 else _MAX_RATIO_LATER
    parts = {call: part for call, part in parts.items() if part < limit}
    for both in (repr(_BOTTOM_UP), repr(_RESEMBLING)):  # if one hardly has a y, the other alone fits as well
        if both in parts:
            parts[both] /= _MAX_RATIO_OF_BOTH
    return min(parts, key=lambda call: parts[call], default="")


def _better_than_no_jitter(seen: FramesSeen) -> str:
    """Return the reading of the jitter that fits best, if better than no jitter; otherwise ""."""
    calls = seen.errors.keys() & _JITTER_READINGS.keys()
    best = min(sorted(calls), key=lambda call: seen.errors[call][1], default="")
    return best if best and seen.errors[best][1] < seen.amplitudes[0.0, 0.0][0] else ""


def _jitter_values(jitters: tuple[tuple[float, float], ...], size: Size) -> Iterator[Mistake]:
    if len(jitters) < _MIN_REPEATS:
        return
    distinct, largest = set(jitters), np.abs(jitters).max(axis=0)
    if len(distinct) == 1:
        yield mistakes.JITTER_CONSTANT.found(jitter=distinct.pop(), frames=len(jitters))
    elif min(size) >= _MIN_SIDE_OF_UNITS and (largest <= 1.0 / np.array(size)).all():
        yield mistakes.JITTER_TOO_SMALL.found(high=largest.max())


def _added(sums: Mapping[Any, Any], more: Mapping[Any, Any]) -> dict[Any, Any]:
    return {key: tuple(np.add(sums.get(key, 0), value).tolist()) for key, value in more.items()}


# --- depth: disocclusions ---


def _surfaces(pair: FramePair) -> dict[DepthOrder, tuple[float, float]]:
    """Return the numbers of disoccluded pixels for each order; empty if depth is too coarse."""
    if depth_values(pair.now.depth):
        return {}
    counts = {order: pair.disoccluded(order, Conventions(), 30_000) for order in _ORDERS}
    scale = min(1.0, _MAX_DISOCCLUDED / max(1, *(number for count in counts.values() for number in count)))
    return {order: (scale * closer, scale * farther) for order, (closer, farther) in counts.items()}


def _other_order(surfaces: Mapping[DepthOrder, tuple[float, float]]) -> DepthOrder | None:
    if not surfaces:
        return None
    closer, farther = surfaces["reversed"]
    if farther >= _MIN_DISOCCLUDED and farther > 4 * closer:
        return "linear"
    closer_if_forward, farther_if_forward = surfaces["forward"]
    if closer_if_forward >= _MIN_DISOCCLUDED and closer_if_forward > 4 * (farther_if_forward + closer):
        return "forward"
    return None


def _planes_are_reversed(frame: FrameProbe | None, kind: DepthOrder) -> bool:
    """Return whether planes fit reversed depth better than this kind: aliasing distorts disocclusions."""
    if frame is None:
        return False
    return probe.plane_curvature(frame.depth, "reversed") < probe.plane_curvature(frame.depth, kind)


# --- amplitude of the jitter in the image, relative to the stated jitter ---


def _amplitude_errors(pair: FramePair) -> dict[tuple[float, float], tuple[float, ...]]:
    """Return (reprojection error, variance) of a pair for each of FACTORS."""
    stated = Conventions()
    vectors, shift = pair.now.vectors(stated, pair.pixels), pair.shift(stated)
    variance = pair.variance
    return {factors: (min(pair.error(vectors + shift * factors), 1.0), variance) for factors in FACTORS}


def jitter_in_vectors(
    sums: JitterInVectors, pair: FramePair, jitters: Sequence[tuple[float, float]], reading: Conventions
) -> JitterInVectors:
    """Return the sums with a pair added; `jitters` ends with the jitter of its first frame."""
    now, before = pair.now, pair.before
    if len(jitters) < 2 or before.motion.shape != now.motion.shape:
        return sums
    earlier = replace(before, jitter=jitters[-2]).jitter_pixels(reading)
    change = pair.shift(reading) - (before.jitter_pixels(reading) - earlier)
    moved = np.median(now.vectors(reading, pair.pixels) - before.vectors(reading, pair.pixels), axis=0)
    x, y = moved * change
    return sums[0] + float(x), sums[1] + float(y), sums[2] + float(change @ change)


def vectors_have_jitter(sums: JitterInVectors, factor: tuple[float, float] = (1.0, 1.0)) -> bool:
    """Return whether motion, multiplied by `factor`, changes with the jitter, by a similar amount."""
    along = factor[0] * sums[0] + factor[1] * sums[1]
    return sums[2] > 0 and 0.5 < along / sums[2] < 2.0


def amplitude_mistakes(
    errors: AmplitudeErrors, pairs: int, varied: JitterInVectors, side: int
) -> Iterator[Mistake]:
    """Yield the mistake that the image has no jitter, a part or a multiple of it, or vectors contain it."""
    found = wrong_amplitude(errors, pairs, side)
    if found is None:
        return
    x, y, none = found
    mean = (x + y) / 2
    if (none or mean < 0.5) and vectors_have_jitter(varied):  # vectors with jitter in them add it twice
        reading = Conventions(motion_jittered=True)
        times = errors[1.0, 1.0][0] / max(errors[0.0, 0.0][0], 1e-6)
        text = probe.reading_text("motion", reading)
        yield mistakes.MOTION_MISREAD.found(times=times, reading=text, call=repr(reading))
    elif none:
        yield mistakes.JITTER_NOT_APPLIED
    else:
        axes = f" ({x:.2f} in x, {y:.2f} in y)" if abs(x - y) >= 0.25 else ""
        yield mistakes.JITTER_AMPLITUDE.found(factor=f"{mean:.2f}{axes}")


def wrong_amplitude(errors: AmplitudeErrors, pairs: int, side: int) -> Amplitude | None:
    """Return the amplitude if it is clearly not 1, otherwise None, from errors summed over pairs of frames.

    The error is nearly a quadratic function of the factors; the estimate is its minimum. `side` is the
    shorter side of the frames in pixels.
    """
    if pairs < _MIN_PAIRS:
        return None
    x, y = np.array(list(errors)).T
    values, (variance, *_) = np.array(list(errors.values())).T
    c = np.linalg.lstsq(np.stack([x * x, x * y, y * y, x, y, np.ones_like(x)], axis=1), values, rcond=None)[0]
    hessian: NDArray[np.float64] = np.array([[2 * c[0], c[1]], [c[1], 2 * c[2]]])
    stated = errors[1.0, 1.0][0]
    if np.linalg.eigvalsh(hessian)[0] <= 0 or stated <= _NOISE * pairs:
        return None
    found = np.linalg.solve(hessian, -c[3:5])
    lowest, few = values.min(), pairs < _MIN_PAIRS_OF_AN_AXIS
    uneven = found.max() > 1.0 - _RIGHT and found.min() < 1.0 + _RIGHT
    if uneven and (few or side < _MIN_SIDE_OF_AN_AXIS):
        return None
    gain = _MIN_GAIN_OF_AN_AXIS if uneven else _MIN_GAIN_OF_FEW if few else _MIN_GAIN
    if lowest > min((1 - gain) * stated, _MAX_ERROR * variance):
        return None
    none = errors[0.0, 0.0][0] == lowest
    if not none and (found.min() < -0.25 or found.max() > 3.0):
        return None
    off = (found < _PLAUSIBLE[0]) | (found > _PLAUSIBLE[1])
    if off.any() or not _PLAUSIBLE_MEAN[0] <= found.mean() <= _PLAUSIBLE_MEAN[1]:
        return Amplitude(float(found[0]), float(found[1]), none)
    return None


# --- motion to the next frame, compared with the next frame's motion, which leads back ---


def motion_next_mistakes(before: FrameProbe, now: FrameProbe) -> Iterator[Mistake]:
    """Yield the mistake in the motion to the next frame of `before`, if it does not lead to `now`.

    The motion of a pixel leads to the same surface in the next frame, whose motion leads back: the sum of
    both is nearly 0.
    """
    if before.motion_next is None or now.reset or now.size != before.size:
        return
    rows, columns = probe.pixel_grid(before.size)
    stated = before.motion_next[rows, columns].astype(np.float64)
    there = -now.motion[rows, columns].astype(np.float64)  # approximates the motion if `stated` is wrong
    moves = np.isfinite(stated).all(1) & np.isfinite(there).all(1)
    moves &= np.maximum(np.abs(stated).max(1), np.abs(there).max(1)) > _MIN_MOVE
    found = {}
    for reading in _NEXT_READINGS:
        differences, lengths = _there_and_back(
            before, now, rows[moves], columns[moves], stated[moves] * reading
        )
        if len(differences) >= max(1, min(_MIN_PIXELS, len(rows) // 20)):
            found[reading] = float(np.median(differences)), float(np.median(lengths))
    fitting = {
        reading
        for reading, (off, length) in found.items()
        if off <= max(_MAX_DIFFERENCE, _MAX_FRACTION * length)
    }
    if (1, 1) not in found or (1, 1) in fitting:
        return
    best = min(found, key=lambda reading: found[reading][0])
    text = f"; it fits if it is {_NEXT_READINGS[best]}" if best in fitting else ""
    difference, length = found[1, 1]
    yield mistakes.MOTION_NEXT_MISREAD.found(difference=difference, length=length, reading=text)


def _there_and_back(
    before: FrameProbe, now: FrameProbe, rows: NDArray[Any], columns: NDArray[Any], vectors: NDArray[Any]
) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return the lengths of vector + motion at its end, and of the longer of both."""
    shift = np.subtract(before.jitter, now.jitter)
    x, y = np.rint(columns + vectors[:, 0] + shift[0]), np.rint(rows + vectors[:, 1] + shift[1])
    inside = (x >= 0) & (x < now.size[0]) & (y >= 0) & (y < now.size[1])
    row, column = y[inside].astype(np.intp), x[inside].astype(np.intp)
    here, there = before.depth[rows[inside], columns[inside]], now.depth[row, column]
    same = np.abs(here - there) <= _SAME_SURFACE * np.maximum(here, there)
    back, vectors = now.motion[row, column][same].astype(np.float64), vectors[inside][same]
    return np.hypot(*(vectors + back).T), np.maximum(np.hypot(*vectors.T), np.hypot(*back.T))
