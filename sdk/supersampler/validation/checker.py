"""`FrameChecker`: runs the pixel checks on selected frames, and warns of mistakes or raises them."""

import warnings
from collections.abc import Collection, Sequence
from typing import Literal, get_args

import numpy as np

from supersampler.arguments import checked_choice
from supersampler.errors import FrameWarning
from supersampler.frame import Frame, Size
from supersampler.methods.convergence import MAX_STATIC_MOTION
from supersampler.validation import mistakes
from supersampler.validation.evidence import Evidence
from supersampler.validation.gbuffers import gbuffer_mistakes
from supersampler.validation.mistakes import Mistake
from supersampler.validation.single_frame import single_frame_mistakes
from supersampler.validation.temporal import FramesSeen, temporal_mistakes

Validate = Literal["off", "warn", "strict"]

_WARN_FRAMES = 3  # number that "warn" checks after a start or cut: two pairs, and three jitters
_HELD_FRAMES = 8  # number with one jitter and nothing that moves, after which "warn" reports it
_STRIDE = 8  # pixels between those whose motion is read for that


class FrameChecker:
    """Checks the pixels of a frame sequence, in order, and infers which conventions are wrong.

    Frames are compared at a few thousand pixels, so that the cost hardly depends on their size.

    Args:
        validate: "off" checks nothing; "warn" checks the first three frames after a start or cut and emits a
            `FrameWarning` once for each kind of mistake; "strict" checks every frame and raises.
        converges: whether the method's image converges where nothing moves (`ModelInfo.converges`). "warn"
            then tells, in any frame, that the jitter stays the same while nothing moves.

    Raises:
        ArgumentError: `validate` is another value.
    """

    def __init__(self, validate: Validate = "warn", *, converges: bool = False) -> None:
        self.validate = checked_choice("validate", validate, get_args(Validate))
        self._converges = converges
        self.reset()

    def reset(self) -> None:
        """Drop all earlier frames, as after a cut."""
        self._seen, self._read = FramesSeen(), 0
        self._reported: frozenset[str] = frozenset()
        self._jitter: tuple[float, float] | None = None
        self._held = 0  # frames in a row with `_jitter` in which nothing moved

    def check(self, frame: Frame, display_size: Size, gbuffers: Collection[str] = ()) -> None:
        """Check one frame alone and against the earlier ones.

        Args:
            frame: the next frame; `reset` drops the earlier ones.
            display_size: (width, height) of the output.
            gbuffers: G-buffers to check, by their names in `ModelInfo.gbuffers`.

        Raises:
            FrameError: a mistake was found and `validate` is "strict". The checker is then unchanged.

        Warns:
            FrameWarning: a mistake was found and `validate` is "warn"; or a possible mistake was found.
        """
        fresh = frame.reset
        seen = FramesSeen() if fresh else self._seen
        read, reported = (0, frozenset[str]()) if fresh else (self._read, self._reported)
        found: list[Mistake] = []
        if self.validate == "strict" or (self.validate == "warn" and read < _WARN_FRAMES):
            evidence = Evidence.of_frame(frame)
            seen = seen.after(evidence, display_size)
            found = [*single_frame_mistakes(frame, evidence.light), *gbuffer_mistakes(frame, gbuffers)]
            if evidence.light is not None:
                found += temporal_mistakes(seen, frame.size, display_size)
            read += 1
        elif self.validate == "warn":
            seen = FramesSeen()  # nothing is checked until the next cut
        held = 1 if fresh else self._held_after(frame)
        if held == _HELD_FRAMES and frame.size != display_size:  # at ratio 1 frames may be anti-aliased
            found.append(mistakes.JITTER_HELD.found(jitter=frame.jitter, frames=held))
        self._reported = self._report(found, reported)
        self._seen, self._read, self._jitter, self._held = seen, read, frame.jitter, held

    def _held_after(self, frame: Frame) -> int:
        """Return the number of frames in a row, this one too, with one jitter in which nothing moved."""
        if self.validate != "warn" or not self._converges or frame.jitter != self._jitter:
            return 1
        moves = np.abs(frame.motion[::_STRIDE, ::_STRIDE]) > MAX_STATIC_MOTION
        return 1 if moves.any() else self._held + 1

    def _report(self, found: Sequence[Mistake], reported: frozenset[str]) -> frozenset[str]:
        """Raise the first certain mistake, or warn of each kind once; return the kinds reported so far."""
        for mistake in found:
            if self.validate == "strict" and not mistake.only_a_hint:
                raise mistake.error()
        for mistake in found:
            if mistake.kind not in reported:
                warnings.warn(str(mistake.error()), FrameWarning, stacklevel=4)
        return reported | {mistake.kind for mistake in found}
