"""`FrameChecker`: runs the pixel checks on selected frames, and warns of mistakes or raises them."""

import warnings
from collections.abc import Collection, Sequence
from typing import Literal, get_args

from supersampler.arguments import checked_choice
from supersampler.errors import FrameWarning
from supersampler.frame import Frame, Size
from supersampler.validation.evidence import Evidence
from supersampler.validation.gbuffers import gbuffer_mistakes
from supersampler.validation.mistakes import Mistake
from supersampler.validation.single_frame import single_frame_mistakes
from supersampler.validation.temporal import FramesSeen, temporal_mistakes

Validate = Literal["off", "warn", "strict"]

_WARN_FRAMES = 3  # number that "warn" checks after a start or cut: two pairs, and three jitters


class FrameChecker:
    """Checks the pixels of a frame sequence, in order, and infers which conventions are wrong.

    Frames are compared at a few thousand pixels, so that the cost hardly depends on their size.

    Args:
        validate: "off" checks nothing; "warn" checks the first three frames after a start or cut and emits a
            `FrameWarning` once for each kind of mistake; "strict" checks every frame and raises.

    Raises:
        ArgumentError: `validate` is another value.
    """

    def __init__(self, validate: Validate = "warn") -> None:
        self.validate = checked_choice("validate", validate, get_args(Validate))
        self.reset()

    def reset(self) -> None:
        """Drop all earlier frames, as after a cut."""
        self._seen, self._read = FramesSeen(), 0
        self._reported: frozenset[str] = frozenset()

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
        if self.validate == "strict" or (self.validate == "warn" and read < _WARN_FRAMES):
            evidence = Evidence.of_frame(frame)
            seen = seen.after(evidence, display_size)
            found = [*single_frame_mistakes(frame, evidence.light), *gbuffer_mistakes(frame, gbuffers)]
            if evidence.light is not None:
                found += temporal_mistakes(seen, frame.size, display_size)
            reported = self._report(found, reported)
            read += 1
        elif self.validate == "warn":
            seen = FramesSeen()  # nothing is checked until the next cut
        self._seen, self._read, self._reported = seen, read, reported

    def _report(self, found: Sequence[Mistake], reported: frozenset[str]) -> frozenset[str]:
        """Raise the first certain mistake, or warn of each kind once; return the kinds reported so far."""
        for mistake in found:
            if self.validate == "strict" and not mistake.only_a_hint:
                raise mistake.error()
        for mistake in found:
            if mistake.kind not in reported:
                warnings.warn(str(mistake.error()), FrameWarning, stacklevel=4)
        return reported | {mistake.kind for mistake in found}
