"""What the detector returns: ranked hypotheses and the conventions to write."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from supersampler.conventions import Conventions

SURE = 1.15
"""A verdict counts when the runner-up's error is at least this many times the winner's."""

_ALIKE = 1.02  # errors this close are one error: the reading that was stated wins


@dataclass(frozen=True, slots=True)
class Hypothesis:
    """One way to read a field: what to override in `Conventions`, and the error that it leaves."""

    text: str
    overrides: Mapping[str, Any]
    error: float


@dataclass(frozen=True, slots=True)
class Verdict:
    """What the frames show about one field.

    Attributes:
        name: "motion", "jitter" or "depth".
        ranked: hypotheses, best first; empty where the frames hold no evidence.
        reason: why the frames cannot tell; "" where they can.
    """

    name: str
    ranked: tuple[Hypothesis, ...] = ()
    reason: str = ""

    @property
    def certain(self) -> bool:
        """True where the frames can tell."""
        return not self.reason

    @property
    def margin(self) -> float:
        """The runner-up's error divided by the winner's: 1 is a tie."""
        if len(self.ranked) < 2:
            return 1.0
        return max(1.0, self.ranked[1].error / max(self.ranked[0].error, 1e-6))

    @property
    def overrides(self) -> Mapping[str, Any]:
        """What the winner changes; nothing where the frames cannot tell."""
        return self.ranked[0].overrides if self.certain else {}

    @property
    def text(self) -> str:
        """One line for people: what was found and its margin, or why not."""
        if not self.certain:
            return f"{self.name}: cannot tell, {self.reason}"
        found, runner_up = ([h.text for h in self.ranked] + [""])[:2]
        return f"{self.name}: {found}; the next best, {runner_up}, is {self.margin:.2f}x worse"


@dataclass(frozen=True, slots=True)
class Detection:
    """What a few frames say about the conventions they are in.

    Attributes:
        motion, jitter, depth: the verdicts.
        stated: the conventions that were given; they are kept where the frames cannot tell.
        conventions: the conventions found. `call` is how to write them.
        notes: other mistakes that were seen, one text each.
    """

    motion: Verdict
    jitter: Verdict
    depth: Verdict
    stated: Conventions
    conventions: Conventions
    notes: tuple[str, ...] = ()

    @property
    def agrees(self) -> bool:
        """True where nothing that was found contradicts what was stated."""
        return self.conventions == self.stated

    @property
    def call(self) -> str:
        """The Python expression to write: `Conventions(...)` with what is not as by default."""
        return repr(self.conventions)

    @property
    def verdicts(self) -> tuple[Verdict, Verdict, Verdict]:
        """Of motion, jitter and depth."""
        return self.motion, self.jitter, self.depth

    def summary(self) -> str:
        """Return lines for people: each verdict with its margin, the notes, and the call to write."""
        lines = [verdict.text for verdict in self.verdicts] + list(self.notes)
        if self.agrees:
            return "\n".join([*lines, f"The frames are as stated: {self.call}"])
        return "\n".join([*lines, f"The frames are not as stated: {self.stated!r}", f"Write: {self.call}"])


def ranked(name: str, hypotheses: Sequence[Hypothesis], stated: Conventions) -> Verdict:
    """Return the verdict over at least one hypothesis; near a tie the stated one is first."""

    def error(hypothesis: Hypothesis) -> float:
        holds = all(getattr(stated, key) == value for key, value in hypothesis.overrides.items())
        return hypothesis.error / (_ALIKE if holds else 1.0)

    verdict = Verdict(name, tuple(sorted(hypotheses, key=error)))
    if len(verdict.ranked) > 1 and verdict.margin < SURE:
        first, second = verdict.ranked[:2]
        return Verdict(name, verdict.ranked, f"'{first.text}' and '{second.text}' fit alike")
    return verdict
