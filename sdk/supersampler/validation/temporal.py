"""Pixel checks over several frames: whether another reading of motion, jitter or depth fits better."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from supersampler.conventions import Conventions
from supersampler.conventions.factors import motion_factor
from supersampler.frame import Size
from supersampler.validation import mistakes
from supersampler.validation.amplitude import (
    AmplitudeErrors,
    JitterInVectors,
    amplitude_errors,
    jitter_in_vectors,
    vectors_have_jitter,
    wrong_amplitude,
)
from supersampler.validation.depth_order import DepthOrder, bend
from supersampler.validation.evidence import Evidence
from supersampler.validation.mistakes import Mistake
from supersampler.validation.motion_next import motion_next_mistakes
from supersampler.validation.readings import JITTERS, MOTIONS, reading_text
from supersampler.validation.reprojection import MIN_PLACES, FramePair, frame_pairs
from supersampler.validation.steps import depth_values

Sums = Mapping[str, tuple[float, float]]

_MAX_RATIO_FIRST = 0.65  # maximum ratio of a reading's error to the frame's own, after one pair of frames
_MAX_RATIO_LATER = 0.75  # and after several pairs, with summed errors
_NOISE = 1e-5  # squares of tone-mapped luminance; smaller errors are noise
_MIN_DISOCCLUDED = 20  # minimum number of disoccluded places
_MAX_DISOCCLUDED = 15  # number that one pair of frames can add: in one pair, jitter alone hides thin things
_MIN_REPEATS = 3  # minimum number of frames with one jitter
_ORDERS: tuple[DepthOrder, ...] = ("reversed", "forward")
_BOTTOM_UP = Conventions(motion_flip_y=True, jitter_flip_y=True)


@dataclass(frozen=True, slots=True, kw_only=True)
class FramesSeen:
    """State of the checks since the last cut.

    Attributes:
        previous: copy of the previous frame; None where it is missing or was not shaded.
        pairs: number of compared pairs of frames.
        errors: for each reading, sums over the pairs of (the frame's own error, the reading's error).
        surfaces: for each depth order, numbers of disoccluded places with (closer, farther) occluders,
            at most _MAX_DISOCCLUDED of a pair.
        jitters: jitter of the last 64 frames.
        amplitudes: for each factor of the jitter, the error summed over the pairs.
        varied: how much the motion changes with the jitter.
        lacks_motion: whether all motion is 0 in an image that moves.
        following: mistakes in the motion from the previous frame to this one.
    """

    previous: Evidence | None = None
    pairs: int = 0
    errors: Sums = field(default_factory=dict)
    surfaces: Mapping[DepthOrder, tuple[float, float]] = field(default_factory=dict)
    jitters: tuple[tuple[float, float], ...] = ()
    amplitudes: AmplitudeErrors = field(default_factory=dict)
    varied: JitterInVectors = (0.0, 0.0)
    lacks_motion: bool = False
    following: tuple[Mistake, ...] = ()

    def after(self, frame: Evidence, display_size: Size) -> "FramesSeen":
        """Return the state after one more frame."""
        if frame.light is None:
            return replace(self, previous=None, following=())
        seen = replace(self, following=())
        if self.previous is not None:
            seen = replace(seen, following=tuple(motion_next_mistakes(self.previous, frame)))
        for pair in frame_pairs([frame] if self.previous is None else [self.previous, frame]):
            if pair.textured:
                errors = _added(self.errors, _errors(pair, display_size))
                seen = replace(
                    seen,
                    pairs=self.pairs + 1,
                    errors=errors,
                    surfaces=_added(self.surfaces, _surfaces(pair)),
                    amplitudes=_added(self.amplitudes, amplitude_errors(pair, Conventions())),
                    varied=jitter_in_vectors(self.varied, pair, self.jitters, Conventions()),
                    lacks_motion=self.lacks_motion or pair.lacks_motion,
                )
        return replace(seen, previous=frame.copied(), jitters=(*self.jitters, frame.jitter)[-64:])


def temporal_mistakes(seen: FramesSeen, size: Size, display_size: Size) -> Iterator[Mistake]:
    """Yield the mistakes in the frames since the last cut."""
    yield from _jitter_values(seen.jitters, size)
    if seen.lacks_motion:
        yield mistakes.MOTION_ZERO
        return
    call = _better_reading(seen)
    if call:
        own, other = seen.errors[call]
        if call == repr(_BOTTOM_UP):
            yield mistakes.ROWS_BOTTOM_UP.found(times=own / max(other, 1e-6), call=call)
            return
        is_jitter = call.startswith("Conventions(jitter")
        text = reading_text("jitter" if is_jitter else "motion", _readings(size, display_size)[call])
        mistake = mistakes.JITTER_MISREAD if is_jitter else mistakes.MOTION_MISREAD
        yield mistake.found(times=own / max(other, 1e-6), reading=text, call=call)
        return  # with wrong motion, disocclusions are no evidence
    yield from seen.following
    if np.ptp(seen.jitters, axis=0).max() > 0:
        yield from amplitude_mistakes(seen.amplitudes, seen.pairs, seen.varied)
    kind = _other_order(seen.surfaces)
    if kind and not _planes_are_reversed(seen.previous, kind):
        yield mistakes.depth_kind(f"moving surfaces hide closer ones, as if depth were {kind}", kind)


def amplitude_mistakes(errors: AmplitudeErrors, pairs: int, varied: JitterInVectors) -> Iterator[Mistake]:
    """Yield the mistake that the image has not the jitter that is stated, or a fraction of it.

    Where the motion changes with the jitter, the vectors contain it, so that it is added twice.
    """
    found = wrong_amplitude(errors, pairs)
    if found is not None and found.is_small and vectors_have_jitter(varied):
        reading = Conventions(motion_jittered=True)
        times = errors[1.0, 1.0][0] / max(errors[0.0, 0.0][0], 1e-6)
        yield mistakes.MOTION_MISREAD.found(
            times=times, reading=reading_text("motion", reading), call=repr(reading)
        )
    elif found is not None and found.none:
        yield mistakes.JITTER_NOT_APPLIED
    elif found is not None:
        yield mistakes.JITTER_AMPLITUDE.found(factor=found.text)


def _readings(size: Size, display_size: Size) -> dict[str, Conventions]:
    """Return other readings of a frame's motion or jitter, by their Python calls."""
    scale = (size[0] / display_size[0], size[1] / display_size[1])
    found = [
        Conventions(**motion, motion_jittered=jittered) for motion in MOTIONS for jittered in (False, True)
    ]
    found += [Conventions(**jitter) for jitter in JITTERS if jitter["jitter_unit"] == "pixels"]
    found += [Conventions(motion_scale=scale), _BOTTOM_UP]
    return {repr(reading): reading for reading in found if reading != Conventions()}


def _errors(pair: FramePair, display_size: Size) -> Sums:
    """Return the errors of a pair (as stated, by the reading) for each reading, where they can differ."""
    size, as_stated = pair.now.size, Conventions()
    moves, error_of = pair.moving(as_stated), pair.error
    few = moves.sum() < MIN_PLACES / 4
    own = {
        True: 0.0 if few else error_of(pair.offset(as_stated), moves),
        False: error_of(pair.offset(as_stated)),
    }
    still = 0.0 if few else error_of(pair.shift(as_stated), moves)
    errors = {}
    for call, reading in _readings(size, display_size).items():
        about_motion = motion_factor(reading, size, size) != (1.0, 1.0)
        if about_motion and few:
            continue
        error = error_of(pair.offset(reading), moves if about_motion else None)
        if about_motion and error > _MAX_RATIO_LATER * still:
            error = max(error, own[True])  # not better than no motion: chance
        errors[call] = (min(own[about_motion], 1.0), min(error, 1.0))
    return errors


def _better_reading(seen: FramesSeen) -> str:
    """Return the reading with the smallest error relative to the stated one, if clearly smaller; else ""."""
    visible = _NOISE * seen.pairs
    parts = {call: other / own for call, (own, other) in seen.errors.items() if own > visible}
    if seen.pairs < 2 and seen.previous is not None and not seen.previous.motion.any():
        return ""  # it may be the motion that is missing
    if seen.pairs < 2 or not vectors_have_jitter(seen.varied):
        # An image without the stated jitter fits vectors with jitter in them, too.
        parts = {call: part for call, part in parts.items() if "unit" in call or "jittered" not in call}
    best = min(parts, key=lambda call: parts[call], default="")
    return best if best and parts[best] < (_MAX_RATIO_FIRST if seen.pairs == 1 else _MAX_RATIO_LATER) else ""


def _surfaces(pair: FramePair) -> dict[DepthOrder, tuple[float, float]]:
    """Return the disocclusions in each order; none where one step of depth may be a distance."""
    if depth_values(pair.now.depth):
        return {}
    counts = {order: pair.disoccluded(order, Conventions(), 30_000) for order in _ORDERS}
    most = max(max(count) for count in counts.values())
    scale = min(1.0, _MAX_DISOCCLUDED / max(most, 1))
    return {order: (scale * closer, scale * farther) for order, (closer, farther) in counts.items()}


def _other_order(surfaces: Mapping[DepthOrder, tuple[float, float]]) -> DepthOrder | None:
    closer, farther = surfaces.get("reversed", (0, 0))
    if farther >= _MIN_DISOCCLUDED and farther > 4 * closer:
        return "linear"
    closer_if_forward, farther_if_forward = surfaces.get("forward", (0, 0))
    if closer_if_forward >= _MIN_DISOCCLUDED and closer_if_forward > 4 * (farther_if_forward + closer):
        return "forward"
    return None


def _planes_are_reversed(frame: Evidence | None, kind: DepthOrder) -> bool:
    """Return whether planes fit reversed depth better than this kind; aliased things mislead the counts."""
    if frame is None:
        return False
    return bend(frame.depth, "reversed") < bend(frame.depth, kind)


def _jitter_values(jitters: tuple[tuple[float, float], ...], size: Size) -> Iterator[Mistake]:
    if len(jitters) < _MIN_REPEATS:
        return
    values = np.array(jitters)
    if np.ptp(values, axis=0).max() == 0:
        yield mistakes.JITTER_CONSTANT.found(jitter=jitters[-1], frames=len(jitters))
    elif min(size) >= 64 and (np.abs(values) <= 1.0 / np.array(size)).all():
        yield mistakes.JITTER_TOO_SMALL.found(most=np.abs(values).max())


def _added(sums: Mapping[Any, Any], more: Mapping[Any, Any]) -> dict[Any, Any]:
    return {key: tuple(np.add(sums.get(key, 0), value).tolist()) for key, value in more.items()}
