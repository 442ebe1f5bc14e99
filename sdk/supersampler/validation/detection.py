"""Results of `detect_conventions`: ranked hypotheses and the detected conventions."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from supersampler.conventions import Conventions

SURE = 1.15
"""Minimum ratio of the second-best error to the best for a certain verdict."""

_TIE = 1.02  # within this ratio of errors, the stated hypothesis ranks first


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
        reason: why the result is uncertain; "" where it is certain.
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
        """The second-best error divided by the best: 1 is a tie."""
        if len(self.ranked) < 2:
            return 1.0
        return max(1.0, self.ranked[1].error / max(self.ranked[0].error, 1e-6))

    @property
    def overrides(self) -> Mapping[str, Any]:
        """Overrides of the best hypothesis; empty where it is uncertain."""
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
        stated: the given conventions, kept where a verdict is uncertain.
        conventions: the detected conventions; `call` is their Python expression.
        notes: other mistakes, one text each.
    """

    motion: Verdict
    jitter: Verdict
    depth: Verdict
    stated: Conventions
    conventions: Conventions
    notes: tuple[str, ...] = ()

    @property
    def agrees(self) -> bool:
        """Whether the detected conventions are the stated ones."""
        return self.conventions == self.stated

    @property
    def call(self) -> str:
        """The Python expression of the detected conventions: `Conventions(...)` without defaults."""
        return repr(self.conventions)

    @property
    def verdicts(self) -> tuple[Verdict, Verdict, Verdict]:
        """The verdicts of motion, jitter and depth."""
        return self.motion, self.jitter, self.depth

    def summary(self) -> str:
        """Return lines of text: each verdict with its margin, the notes, and the call to write."""
        lines = [*(verdict.text for verdict in self.verdicts), *self.notes]
        if self.agrees:
            return "\n".join([*lines, f"The frames are as stated: {self.call}"])
        return "\n".join([*lines, f"The frames are not as stated: {self.stated!r}", f"Write: {self.call}"])


def ranked(name: str, hypotheses: Sequence[Hypothesis], stated: Conventions) -> Verdict:
    """Return the verdict on at least one hypothesis; near a tie the stated one ranks first."""

    def error(hypothesis: Hypothesis) -> float:
        holds = all(getattr(stated, key) == value for key, value in hypothesis.overrides.items())
        return hypothesis.error / (_TIE if holds else 1.0)

    verdict = Verdict(name, tuple(sorted(hypotheses, key=error)))
    if len(verdict.ranked) > 1 and verdict.margin < SURE:
        first, second = verdict.ranked[:2]
        return Verdict(name, verdict.ranked, f"'{first.text}' and '{second.text}' fit alike")
    return verdict
