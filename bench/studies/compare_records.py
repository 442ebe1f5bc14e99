"""Show which values got worse from one record of a bench to a later one, worst first.

    python bench/studies/compare_records.py bench/results/quality-plaza.json mine.json --above 0.05

Fails where something got worse.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

from supersampler.cli.terminal import Terminal
from supersampler.errors import ArgumentError
from supersampler_bench.cli.options import say
from supersampler_bench.markdown_table import table
from supersampler_bench.record import Record, read_record

HIGHER, LOWER = 1.0, -1.0
OF_BOUND, BROKEN = "share of the bound", "out of bounds"
"""Value of a figure of stress over its bound; 1 for a scenario out of bounds, else 0."""
DIRECTIONS: Mapping[str, float] = {
    **dict.fromkeys(("psnr", "ssim", "tpsnr", "samples_per_hour"), HIGHER),
    **dict.fromkeys(("flip", "warped_error_difference", "strred"), LOWER),
    **dict.fromkeys(("median", "p95", "processor", "milliseconds", "resident", "work", "last"), LOWER),
    **dict.fromkeys(("cold_seconds", "warm_seconds", "cache_bytes"), LOWER),
    **dict.fromkeys(("multiply_adds", "parameters", "operators"), LOWER),
    **dict.fromkeys((OF_BOUND, BROKEN), LOWER),
}
"""Which way is better, by the name of a value or its first part ("psnr" of "psnr_moving")."""
DECIBELS = ("psnr", "tpsnr")
IGNORED = ("frames", "all_cropped", "all_full", "warm_full", "classes", "machine", "limits", "stages")
"""Parts of records that are not compared: single frames, the other three summaries, what is not a score."""
_NOT_IDENTIFYING = ("moved", "shot_json_sha256", "pixels_sha256", "passed", "error", "bound")
"""Keys that do not identify a row, because their values change from run to run."""
CONTAINERS = (
    *("shots", "means", "alternations", "methods", "summary", "warm_cropped", "timed", "first_frames"),
    *("results", "rows", "scenes", "networks", "outcomes", "figures"),
)
"""Keys that are left out of the name of a value."""


@dataclass(frozen=True)
class Change:
    """One value in both records.

    Attributes:
        what: its name.
        before: its value in the first record.
        after: its value in the second.
        worse: by how much it got worse: dB for PSNR, a fraction of the bound for stress figures, else a
            fraction of `before`. Negative: it got better.
    """

    what: str
    before: float
    after: float
    worse: float


def changes(before: Record, after: Record) -> list[Change]:
    """Return all values that both records have, the worst first.

    Raises:
        ArgumentError: they are of different benches.
    """
    if before["bench"] != after["bench"]:
        want = f"records of one bench, as of {before['bench']!r}"
        raise ArgumentError("records", got=f"one of {after['bench']!r}", want=want)
    old, new = dict(_values(before)), dict(_values(after))
    found = [_change(what, old[what], new[what]) for what in old if what in new]
    return sorted(found, key=lambda change: -change.worse)


def _values(node: Any, path: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], float]]:
    """Yield all scores under a node, each with its path."""
    if isinstance(node, dict) and "bound" in node:
        yield (*path, OF_BOUND), node["value"] / (node["bound"] or 1.0)
    elif isinstance(node, dict):
        if "passed" in node:
            yield (*path, BROKEN), float(not node["passed"])
        for name, value in node.items():
            if name not in IGNORED:
                yield from _values(value, (*path, name))
    elif isinstance(node, list):
        for item in node:
            if isinstance(item, dict):
                yield from _values(item, (*path, _identity(item)))
    elif isinstance(node, (int, float)) and not isinstance(node, bool) and _direction(path):
        yield path, node


def _identity(item: Mapping[str, Any]) -> str:
    """Return what identifies a row: all of its values that are not scores, as text."""
    words = []
    for name, value in item.items():
        if isinstance(value, dict) and name == "setting":
            words.append(_identity(value))
        elif _direction((name,)) or name in _NOT_IDENTIFYING:
            continue
        elif isinstance(value, (str, int)) or (name == "ratio" and isinstance(value, float)):
            words.append(str(value))
        elif isinstance(value, list) and len(value) == 2 and all(isinstance(part, int) for part in value):
            words.append("x".join(map(str, value)))  # a size; longer lists do not identify a row
    return " ".join(words)


def _direction(path: Sequence[str]) -> float:
    for name in reversed(path):
        for known, direction in DIRECTIONS.items():
            if name == known or name.startswith(f"{known}_"):
                return direction
    return 0.0


def _change(path: tuple[str, ...], before: float, after: float) -> Change:
    lost = _direction(path) * (before - after)
    absolute = path[-1] in (OF_BOUND, BROKEN) or any(name.startswith(DECIBELS) for name in path)
    what = ", ".join(name for name in path if name not in CONTAINERS)
    return Change(what, before, after, lost if absolute else lost / max(abs(before), 1e-12))


def markdown_table(found: Sequence[Change]) -> str:
    """Return changes as Markdown."""
    rows = []
    for change in found:
        worse = f"{change.worse:+.3f} dB" if "psnr" in change.what else f"{change.worse:+.1%}"
        rows.append([change.what, f"{change.before:.5g}", f"{change.after:.5g}", worse])
    return table(["what", "before:", "after:", "worse by:"], rows)


def main(
    before: Annotated[Path, typer.Argument(help="A file of `bench ... --json`.")],
    after: Annotated[Path, typer.Argument(help="A later one of the same bench.")],
    above: Annotated[
        float, typer.Option(min=0.0, help="Leave out what got worse by less: dB, or a fraction.")
    ] = 0.01,
) -> None:
    """Show which values got worse from one record to the next, worst first; fail where any did."""
    found = changes(read_record(before), read_record(after))
    if not found:
        want = "values that both have"
        raise ArgumentError("records", got="none in common", want=want, hint="Run the same command twice.")
    worse = [change for change in found if change.worse > above]
    Terminal().print(markdown_table(worse) if worse else "Nothing is worse.", soft_wrap=True)
    better = sum(change.worse < -above for change in found)
    say(f"{len(found)} values: {len(worse)} worse, {better} better, by more than {above:g}")
    if worse:
        raise typer.Exit(1)


if __name__ == "__main__":
    typer.run(main)
