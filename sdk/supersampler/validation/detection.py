"""What the detector returns: ranked hypotheses, and the conventions to write."""

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
    """What was found out about one field.

    Attributes:
        name: "motion", "jitter" or "depth".
        ranked: hypotheses, best first; empty where the frames hold nothing to go by.
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

    def row(self) -> dict[str, Any]:
        """Return name, found, certain, error, margin, runner_up and reason; for tables."""
        first, second = ([h.text for h in self.ranked] + ["", ""])[:2]
        error = self.ranked[0].error if self.ranked else None
        return {
            "name": self.name, "found": first, "certain": self.certain, "error": error,
            "margin": self.margin, "runner_up": second, "reason": self.reason,
        }  # fmt: skip


@dataclass(frozen=True, slots=True)
class Detection:
    """What a few frames say about the conventions they are in.

    Attributes:
        motion, jitter, depth: the verdicts.
        stated: the conventions that were given; they stand wherever the frames cannot tell.
        conventions: the conventions found. `call` is how to write them.
        notes: what else was seen, one sentence each.
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

    def rows(self) -> list[dict[str, Any]]:
        """Return one dict a verdict, as `Verdict.row` makes it: plain data for a table."""
        return [verdict.row() for verdict in (self.motion, self.jitter, self.depth)]

    def summary(self) -> str:
        """Return lines for people: each verdict with its margin, the notes, and the call to write."""
        lines = [_line(row) for row in self.rows()] + list(self.notes)
        if self.agrees:
            return "\n".join([*lines, f"The frames are as stated: {self.call}"])
        return "\n".join([*lines, f"The frames are not as stated: {self.stated!r}", f"Write: {self.call}"])


def ranked(name: str, hypotheses: Sequence[Hypothesis], stated: Conventions) -> Verdict:
    """Return the verdict of these hypotheses, of which there are some; near a tie the stated one is first."""

    def error(hypothesis: Hypothesis) -> float:
        holds = all(getattr(stated, key) == value for key, value in hypothesis.overrides.items())
        return hypothesis.error / (_ALIKE if holds else 1.0)

    verdict = Verdict(name, tuple(sorted(hypotheses, key=error)))
    if len(verdict.ranked) > 1 and verdict.margin < SURE:
        first, second = verdict.ranked[:2]
        return Verdict(name, verdict.ranked, f"'{first.text}' and '{second.text}' fit alike")
    return verdict


def _line(row: Mapping[str, Any]) -> str:
    if not row["certain"]:
        return f"{row['name']}: cannot tell, {row['reason']}"
    return f"{row['name']}: {row['found']}; the next best, {row['runner_up']}, is {row['margin']:.2f}x worse"
