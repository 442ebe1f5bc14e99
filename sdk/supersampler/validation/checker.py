"""`FrameChecker`: which frames are read, and what happens to what is found."""

import warnings
from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import Literal, get_args

from supersampler.arguments import checked_choice
from supersampler.errors import FrameWarning
from supersampler.frame import Frame, Size
from supersampler.validation.gbuffers import mistakes_of_gbuffers
from supersampler.validation.mistake import Mistake
from supersampler.validation.reprojection import luminance
from supersampler.validation.single_frame import mistakes_alone
from supersampler.validation.temporal import Memory, mistakes_between, remembered

Validate = Literal["off", "warn", "strict"]

_FRAMES = 3  # of a start or cut that "warn" reads: two pairs, and one jitter three times is no accident


class FrameChecker:
    """Reads the pixels of the frames of one sequence, in order, and guesses which convention was missed.

    It compares frames at some thousand places, so that its cost hardly grows with their size.

    Args:
        validate: "off" reads nothing; "warn" reads the first three frames after a start or cut and warns with
            `FrameWarning`, once for each kind of mistake; "strict" reads every frame and raises.

    Raises:
        ArgumentError: `validate` is something else.
    """

    def __init__(self, validate: Validate = "warn") -> None:
        self.validate = checked_choice("validate", validate, get_args(Validate))
        self.reset()

    def reset(self) -> None:
        """Forget all frames, as after a cut."""
        self._memory, self._seen = Memory(), 0
        self._told: frozenset[str] = frozenset()

    def check(self, frame: Frame, display_size: Size, gbuffers: Collection[str] = ()) -> None:
        """Check one frame against itself and those before it.

        Args:
            frame: the next frame; one with `reset` starts anew.
            display_size: (width, height) of the output.
            gbuffers: names of those that are used, as `ModelInfo.gbuffers` has them; others are not read.

        Raises:
            FrameError: a mistake was found and `validate` is "strict". The checker is then as it was before.

        Warns:
            FrameWarning: a mistake was found and `validate` is "warn"; or something was seen that may be one.
        """
        fresh = frame.reset
        memory = Memory() if fresh else self._memory
        seen, told = (0, frozenset[str]()) if fresh else (self._seen, self._told)
        if self.validate == "strict" or (self.validate == "warn" and seen < _FRAMES):
            memory, found = _examined(frame, display_size, memory, gbuffers)
            told = self._tell(found, told)
            seen += 1
        elif self.validate == "warn":
            memory = Memory()  # no more is read until the next cut
        self._memory, self._seen, self._told = memory, seen, told

    def _tell(self, found: Sequence[Mistake], told: frozenset[str]) -> frozenset[str]:
        """Raise the first real mistake, or warn of each that was not told; return the kinds that were."""
        for mistake in found:
            if self.validate == "strict" and not mistake.only_a_hint:
                raise mistake.error()
        for mistake in found:
            if mistake.kind not in told:
                warnings.warn(str(mistake.error()), FrameWarning, stacklevel=4)
        return told | {mistake.kind for mistake in found}


def _examined(
    frame: Frame, display_size: Size, memory: Memory, gbuffers: Collection[str]
) -> tuple[Memory, list[Mistake]]:
    light = None if frame.color is None else luminance(frame.color)
    found = [*mistakes_alone(frame, light), *mistakes_of_gbuffers(frame, gbuffers)]
    if light is None:
        memory = replace(memory, light=None, depth=None)
    else:
        memory = remembered(memory, frame, light, display_size)
        found += mistakes_between(memory, frame.size, display_size)
    return memory, found
