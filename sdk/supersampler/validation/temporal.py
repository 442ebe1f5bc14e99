"""Checks of a frame against those before: is there a reading of motion or jitter that fits better?"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from itertools import product
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

from supersampler.conventions import Conventions
from supersampler.conventions.conventions import Direction, Unit
from supersampler.conventions.factors import jitter_factor, motion_factor
from supersampler.frame import Float32, Frame, Size
from supersampler.validation.depth_order import DepthOrder, uncovered
from supersampler.validation.mistake import Mistake
from supersampler.validation.reprojection import MIN_PLACES, Pair, grid, moving

Sums = Mapping[str, tuple[float, float]]

_BETTER_ONCE = 0.65  # a reading's error in parts of the frame's own, to be believed after one pair of frames
_BETTER_LATER = 0.75  # and after more of them, errors added
_VISIBLE = 1e-5  # errors below this are noise: squares of compressed luminance
_SURFACES = 20  # so many places must be seen to be uncovered
_REPEATS = 3  # frames with one jitter that are no accident


@dataclass(frozen=True, slots=True, kw_only=True)
class Memory:
    """What is kept of the frames since the last cut. Arrays are copies: engines reuse their buffers.

    Attributes:
        light, depth, jitter: of the frame before; None where there is none, or it was not shaded: motion does
            not lead to the one that was.
        pairs: how many pairs of frames were compared.
        errors: for each reading, the sums over the pairs of (the frame's own error, that of the reading).
        surfaces: for each depth order, how many (closer, farther) surfaces places were uncovered by.
        jitters: of all frames.
    """

    light: Float32 | None = None
    depth: Float32 | None = None
    jitter: tuple[float, float] = (0.0, 0.0)
    pairs: int = 0
    errors: Sums = field(default_factory=dict)
    surfaces: Mapping[DepthOrder, tuple[int, int]] = field(default_factory=dict)
    jitters: tuple[tuple[float, float], ...] = ()


def remembered(memory: Memory, frame: Frame, light: Float32, display_size: Size) -> Memory:
    """Return the memory with this shaded frame in it."""
    if memory.light is not None and memory.depth is not None and memory.light.shape == light.shape:
        pair = Pair(light, memory.light)
        if pair.textured >= MIN_PLACES:
            errors = _added(memory.errors, _errors(pair, frame, memory.jitter, display_size))
            surfaces = _added(memory.surfaces, _surfaces(frame, memory.depth, memory.jitter))
            memory = replace(memory, pairs=memory.pairs + 1, errors=errors, surfaces=surfaces)
    jitters = (*memory.jitters, frame.jitter)[-64:]
    return replace(memory, light=light, depth=frame.depth.copy(), jitter=frame.jitter, jitters=jitters)


def mistakes_between(memory: Memory, size: Size, display_size: Size) -> Iterator[Mistake]:
    """Yield what the frames since the last cut, this one with them, show to be wrong."""
    yield from _jitter_values(memory.jitters, size)
    reading = _better_reading(memory)
    if reading:
        yield _misread(reading, _readings(size, display_size)[reading], memory.errors[reading])
        return  # with wrong motion, what hides what says nothing
    kind = _other_order(memory.surfaces)
    if kind:
        got = f"of another kind: what moves hides what is closer, as if depth were {kind.replace('_', ', ')}"
        hint = f"Conventions(depth='{kind}', ...) converts it."
        want = "near / distance, 0 at the sky"
        yield Mistake(kind="depth not reversed", field="depth", got=got, want=want, hint=hint)


def _readings(size: Size, display_size: Size) -> dict[str, Conventions]:
    """Other ways to read a frame's motion and jitter, by what is overridden."""
    found = [
        Conventions(
            motion_unit=unit, motion_direction=direction, motion_flip_y=flip, motion_jittered=jittered
        )
        for unit, direction, flip, jittered in product(
            get_args(Unit), get_args(Direction), (False, True), (False, True)
        )
    ]
    found += [Conventions(jitter_sign=sign, jitter_flip_y=flip) for sign in (1, -1) for flip in (False, True)]
    found.append(Conventions(motion_scale=(size[0] / display_size[0], size[1] / display_size[1])))
    return {repr(conventions): conventions for conventions in found if conventions != Conventions()}


def _errors(pair: Pair, frame: Frame, jitter: tuple[float, float], display_size: Size) -> Sums:
    """Errors of this frame (as it is, under each reading), where the reading makes a difference."""
    motion = frame.motion[pair.rows, pair.columns].astype(np.float32)
    shift = np.subtract(frame.jitter, jitter)
    moves = moving(motion)
    few = moves.sum() < MIN_PLACES / 4
    as_is = {True: 0.0 if few else pair.error(motion + shift, moves), False: pair.error(motion + shift)}
    still = 0.0 if few else pair.error(shift, moves)
    errors = {}
    for text, reading in _readings(frame.size, display_size).items():
        about_motion = motion_factor(reading, frame.size, frame.size) != (1.0, 1.0)
        if about_motion and few:
            continue
        offset = _offset(reading, motion, shift, frame.size)
        error = pair.error(offset, moves if about_motion else None)
        if about_motion and error > _BETTER_LATER * still:
            error = max(error, as_is[True])  # no better than no motion at all: a fluke
        errors[text] = (min(as_is[about_motion], 1.0), min(error, 1.0))
    return errors


def _offset(
    reading: Conventions, motion: Float32, shift: NDArray[np.float64], size: Size
) -> NDArray[np.floating[Any]]:
    vectors = motion * np.array(motion_factor(reading, size, size), np.float32)
    return vectors if reading.motion_jittered else vectors + shift * jitter_factor(reading, size)


def _better_reading(memory: Memory) -> str:
    """The reading that leaves the smallest part of the error, if that is convincing; else ""."""
    parts = {
        text: other / own
        for text, (own, other) in memory.errors.items()
        if own > _VISIBLE * memory.pairs
    }  # fmt: skip
    if not parts:
        return ""
    best = min(parts, key=lambda text: parts[text])
    return best if parts[best] < (_BETTER_ONCE if memory.pairs == 1 else _BETTER_LATER) else ""


def _misread(text: str, reading: Conventions, sums: tuple[float, float]) -> Mistake:
    own, other = sums
    name = "jitter" if text.startswith("Conventions(jitter") else "motion"
    wants = {
        "motion": "render pixels without jitter, previous minus current, y down",
        "jitter": "pixel centre to sample, render pixels, y down",
    }
    return Mistake(
        kind=f"{name} misread",
        field=name,
        got=f"misread: frames fit {own / max(other, 1e-6):.1f} times better with it taken {_words(reading)}",
        want=wants[name],
        hint=f"Try {text}.",
    )


def _words(reading: Conventions) -> str:
    """Say in words what a reading overrides."""
    words = []
    if reading.motion_unit != "pixels":
        words.append(f"as {reading.motion_unit.upper()}")
    if reading.motion_scale != (1.0, 1.0):
        words.append("as display pixels")
    if reading.motion_direction != "previous_minus_current":
        words.append("as current minus previous")
    if reading.motion_jittered:
        words.append("as having jitter in it")
    if reading.jitter_sign == -1:
        words.append("with the other sign")
    if reading.motion_flip_y or reading.jitter_flip_y:
        words.append("with y flipped")
    return " and ".join(words)


def _surfaces(
    frame: Frame, before: Float32, jitter: tuple[float, float]
) -> Mapping[DepthOrder, tuple[int, int]]:
    places = grid(frame.size, 30_000)
    offset = frame.motion[places].astype(np.float32) + np.subtract(frame.jitter, jitter)
    orders: tuple[DepthOrder, ...] = ("reversed", "forward")
    return {order: uncovered(frame.depth, before, order, places, offset) for order in orders}


def _other_order(surfaces: Mapping[DepthOrder, tuple[int, int]]) -> str:
    closer, farther = surfaces.get("reversed", (0, 0))
    if farther >= _SURFACES and farther > 4 * closer:
        return "linear"
    closer_if_forward, farther_if_forward = surfaces.get("forward", (0, 0))
    if closer_if_forward >= _SURFACES and closer_if_forward > 4 * (farther_if_forward + closer):
        return "forward_infinite"
    return ""


def _jitter_values(jitters: tuple[tuple[float, float], ...], size: Size) -> Iterator[Mistake]:
    if len(jitters) < _REPEATS:
        return
    values = np.array(jitters)
    want = "a new place in the pixel each frame, in render pixels"
    if np.ptp(values, axis=0).max() == 0:
        hint = "halton_jitter and jittered_projection make one; without it no detail can be gained."
        got = f"{jitters[-1]} in {len(jitters)} frames on end"
        yield Mistake(kind="jitter constant", field="jitter", got=got, want=want, hint=hint)
    elif min(size) >= 64 and (np.abs(values) <= 1.0 / np.array(size)).all():
        hint = "Try Conventions(jitter_unit='ndc') or 'uv'."
        got = f"never more than {np.abs(values).max():.2g}"
        yield Mistake(kind="jitter too small", field="jitter", got=got, want=want, hint=hint)


def _added(sums: Mapping[Any, Any], more: Mapping[Any, Any]) -> dict[Any, Any]:
    return {key: tuple(np.add(sums.get(key, (0, 0)), value).tolist()) for key, value in more.items()}
