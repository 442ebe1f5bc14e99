"""`FrameChecker`: runs pixel checks on selected frames, and warns of mistakes or raises them."""

from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import get_args

import numpy as np

from supersampler.arguments import Validate, checked_choice, ieee_arithmetic
from supersampler.errors import FrameWarning, warn
from supersampler.frame import Frame, Size
from supersampler.methods.at_rest import MAX_STATIC_MOTION
from supersampler.validation import mistakes
from supersampler.validation.gbuffers import gbuffer_mistakes
from supersampler.validation.mistakes import Mistake
from supersampler.validation.probe import FrameProbe
from supersampler.validation.reprojection import frame_pairs
from supersampler.validation.single_frame import single_frame_mistakes
from supersampler.validation.temporal import FramesSeen, temporal_mistakes

_WARN_FRAMES = 3  # frames that "warn" checks after a start or cut: two pairs, and three jitters
_MAX_RESETS = 4  # consecutive frames with `reset` that continue each other, until it is reported
_HELD_FRAMES = 8  # consecutive static frames with the same jitter, until it is reported
_STRIDE = 8  # pixels between the motion vectors that are read for it
_JITTERS = 32  # number of shaded frames whose jitter is averaged
_ONE_SIDED = 0.15  # render pixels: minimum mean jitter of an axis that is reported


class FrameChecker:
    """Checks the pixels of a frame sequence, in order, and infers which conventions are wrong.

    Frames are compared at a few thousand pixels, so that the cost hardly depends on their size. The mean
    jitter of the first 32 shaded frames after a start or cut is checked, too.

    Args:
        validate: "off" checks nothing; "warn" checks the first three frames after a start or cut and emits a
            `FrameWarning` once for each kind of mistake; "strict" checks every frame and raises.
        converges: whether the method's image converges where nothing moves (`ModelInfo.converges`). "warn"
            then also reports, in any frame, a jitter that stays the same while nothing moves.

    Raises:
        ArgumentError: `validate` has another value.
    """

    def __init__(self, validate: Validate = "warn", *, converges: bool = False) -> None:
        self.validate = checked_choice("validate", validate, get_args(Validate))
        self._converges = converges
        self._seen, self._read = FramesSeen(), 0
        self._reported: frozenset[str] = frozenset()
        self._resets = 0  # in a row
        self._jitter: tuple[float, float] | None = None
        self._held = 0  # frames in a row with `_jitter` in which nothing moved
        self._jitters: tuple[tuple[float, float], ...] = ()  # of the first shaded frames

    @ieee_arithmetic
    def check(self, frame: Frame, display_size: Size, gbuffers: Collection[str] = ()) -> None:
        """Check one frame alone and against the earlier frames, which its `reset` drops.

        `gbuffers` are names of `ModelInfo.gbuffers`.

        Raises:
            FrameError: a mistake was found and `validate` is "strict". The checker is then unchanged.

        Warns:
            FrameWarning: a mistake was found and `validate` is "warn"; or a possible mistake was found.
        """
        fresh = frame.reset
        seen = FramesSeen() if fresh else self._seen
        read, reported = (0, frozenset[str]()) if fresh else (self._read, self._reported)
        resets = self._resets
        found: list[Mistake] = []
        if self.validate == "strict" or (self.validate == "warn" and read < _WARN_FRAMES):
            probe = FrameProbe.of_frame(frame)
            resets = self._resets_with(probe)
            seen = seen.after(probe, display_size)
            found = [*frame_mistakes(frame, probe, seen, display_size), *gbuffer_mistakes(frame, gbuffers)]
            if resets == _MAX_RESETS:
                found.append(mistakes.RESET_ALWAYS.found(frames=resets))
            read += 1
        elif self.validate == "warn":
            seen, resets = FramesSeen(), 0  # nothing is checked until the next cut
        held = 1 if fresh else self._held_after(frame)
        if held == _HELD_FRAMES and frame.size != display_size:  # at ratio 1 frames may be anti-aliased
            found.append(mistakes.JITTER_HELD.found(jitter=frame.jitter, frames=held))
        jitters = () if fresh else self._jitters
        if frame.color is not None and self.validate != "off" and len(jitters) < _JITTERS:
            jitters = (*jitters, frame.jitter)
            x, y = np.mean(jitters, axis=0).tolist()
            if len(jitters) == _JITTERS and len(set(jitters)) > 1 and max(abs(x), abs(y)) >= _ONE_SIDED:
                found.append(mistakes.JITTER_ONE_SIDED.found(x=x, y=y, frames=_JITTERS))
        self._reported = self._report(found, reported)
        self._seen, self._read, self._resets = seen, read, resets
        self._jitter, self._held, self._jitters = frame.jitter, held, jitters

    def _resets_with(self, frame: FrameProbe) -> int:
        """Return the number of consecutive frames with `reset`, up to this one, that continue each other."""
        previous = self._seen.previous
        if not frame.reset or previous is None:
            return int(frame.reset)
        pairs = frame_pairs([previous, replace(frame, reset=False)])
        return self._resets + 1 if pairs and pairs[0].continues else 1

    def _held_after(self, frame: Frame) -> int:
        """Return the number of consecutive frames, up to this one, with the same jitter and no motion."""
        if self.validate != "warn" or not self._converges or frame.jitter != self._jitter:
            return 1
        moves = np.abs(frame.motion[::_STRIDE, ::_STRIDE]) > MAX_STATIC_MOTION
        return 1 if moves.any() else self._held + 1

    def _report(self, found: Sequence[Mistake], reported: frozenset[str]) -> frozenset[str]:
        """Raise the first certain mistake, or warn once for each kind; return the kinds reported so far."""
        for mistake in found:
            if self.validate == "strict" and mistake.severity == "error":
                raise mistake.error()
        for mistake in found:
            of_reprojection = mistake.kind in mistakes.OF_REPROJECTION
            if mistake.kind not in reported and not (of_reprojection and reported & mistakes.OF_REPROJECTION):
                warning = FrameWarning(str(mistake.error()))
                warning.kind = mistake.kind
                warn(warning)
            reported |= {mistake.kind}
        return reported


def frame_mistakes(frame: Frame, probe: FrameProbe, seen: FramesSeen, display_size: Size) -> list[Mistake]:
    """Return the mistakes in a frame alone, and in the frames since the cut; `seen` includes the frame."""
    found = list(single_frame_mistakes(frame, probe.light))
    upside_down = any(mistake.kind == mistakes.COLOR_UPSIDE_DOWN.kind for mistake in found)
    if probe.light is not None and not upside_down:  # with colour upside down, no reading of motion fits
        found += temporal_mistakes(seen, frame.size, display_size)
    return found
