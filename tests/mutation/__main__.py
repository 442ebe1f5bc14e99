"""Mutate a random sample of places and print the changes that no test notices.

MUTATIONS=300 places, run from the FIRST=1 on, at most MINUTES=60 minutes, SEED=0, ONLY=part of a path,
BUDGET=15 seconds of tests for one mutant.
One worker for each core. The map of lines that tests run is kept in out/mutation.
"""

import os
import sys
import time
import tomllib
from collections import Counter
from dataclasses import dataclass
from functools import partial
from itertools import accumulate
from pathlib import Path

from mutation.coverage_map import CoverageMap, record, targets_of
from mutation.mutants import Mutant, mutants_of, sample
from mutation.session import HERE, Outcome, copy_tree, in_child, pool, preload, run_tests

ROOT = Path(__file__).parents[2]
OUT = ROOT / "out" / "mutation"
TREES = [OUT / f"tree-{number}" for number in range(os.cpu_count() or 1)]
"""A copy of the repository for each worker: one mutant at a time is in it."""
TREE = TREES[0]
BUDGET = float(os.environ.get("BUDGET", "15"))
"""Seconds of tests for one mutant, as they take by themselves; quick ones come first."""
KILLED, SURVIVED, UNREACHED = "killed", "survived", "no test runs it"


@dataclass(frozen=True)
class Examination:
    """A mutant with the tests that may notice it.

    Attributes:
        mutant: the change.
        tests: the quickest tests that take `BUDGET` together.
        seconds: duration of these by themselves.
        left_out: number of further tests.
        end: time after which nothing is begun.
    """

    mutant: Mutant
    tests: list[str]
    seconds: float
    left_out: int
    end: float

    @classmethod
    def of(cls, mutant: Mutant, coverage: CoverageMap, end: float) -> "Examination":
        """Choose the tests of a mutant."""
        found = coverage.tests_for(mutant)
        totals = list(accumulate(coverage.seconds[test] for test in found))
        count = max(sum(total <= BUDGET for total in totals), min(len(found), 1))
        return cls(mutant, found[:count], totals[count - 1] if count else 0.0, len(found) - count, end)


def examine(planned: Examination) -> tuple[str, str, float] | None:
    """Return outcome, the test that noticed the mutant or what was left out, and seconds; None: too late."""
    started = time.monotonic()
    if started > planned.end:
        return None
    if not planned.tests:
        return UNREACHED, "", 0.0
    file = HERE.tree / planned.mutant.path
    source = file.read_bytes()
    try:
        file.write_bytes(planned.mutant.applied(source))
        seconds = 30.0 + 4.0 * min(planned.seconds, BUDGET)
        failed = in_child(partial(_tested, planned.tests), seconds, HERE.log).failed
    finally:
        file.write_bytes(source)
    note = failed or f"{planned.left_out} slow tests left out" * bool(planned.left_out)
    return KILLED if failed else SURVIVED, note, time.monotonic() - started


def _tested(tests: list[str]) -> Outcome:
    return run_tests(HERE.tree, ["-x", *tests], [])


def equivalents() -> set[tuple[str, ...]]:
    """Return (where,) of functions left out and (where, before, after) of mutants that change nothing."""
    listed = tomllib.loads((Path(__file__).parent / "equivalent.toml").read_text(encoding="utf-8"))
    names = ("where", "before", "after")
    return {tuple(e[n] for n in names if n in e) for e in listed["equivalent"] if e["reason"]}


def chosen_mutants(targets: list[str], count: int, seed: int) -> list[Mutant]:
    """Return a random sample of the mutants that are not equivalent."""
    places = [place for path in targets for place in mutants_of(path, (TREE / path).read_bytes())]
    skipped = equivalents()
    sampled = (
        mutant
        for mutant in sample(places, seed)
        if not {(mutant.where,), (mutant.where, mutant.before, mutant.after)} & skipped
        and mutant.is_change((TREE / mutant.path).read_bytes())
    )
    print(f"{sum(map(len, places))} mutants at {len(places)} places of {len(targets)} files", flush=True)
    return [mutant for mutant, _ in zip(sampled, range(count), strict=False)]


def main() -> None:
    """Run the tool."""
    settings = os.environ.get
    count, first, seed = (int(settings(*s)) for s in (("MUTATIONS", "300"), ("FIRST", "1"), ("SEED", "0")))
    end = time.monotonic() + 60.0 * float(settings("MINUTES", "60"))
    sys.dont_write_bytecode = True
    os.environ |= {"PYTHONDONTWRITEBYTECODE": "1", "OMP_NUM_THREADS": "1"}
    OUT.mkdir(parents=True, exist_ok=True)
    for tree in TREES:
        copy_tree(ROOT, tree)
    preload()
    with pool(TREES) as workers:
        tests = record(TREE, OUT / "coverage.json", workers)
    mutants = chosen_mutants([path for path in targets_of(TREE) if settings("ONLY", "") in path], count, seed)
    survivors: list[str] = []
    counts = Counter[str]()
    with pool(TREES) as workers:
        planned = [Examination.of(mutant, tests, end) for mutant in mutants[first - 1 :]]
        outcomes = zip(planned, workers.map(examine, planned), strict=True)
        for number, (mutant, found) in enumerate(((one.mutant, found) for one, found in outcomes), first):
            if found is None:
                print(f"out of time; FIRST={number} goes on from here")
                break
            outcome, note, seconds = found
            counts[outcome] += 1
            said = (
                f"{mutant.path}:{mutant.line} {mutant.where}: {mutant.before}  ->  {mutant.after}  ({note})"
            )
            survivors += [said] if outcome != KILLED else []
            print(f"[{number:3}/{len(mutants)}] {seconds:5.1f} s {outcome:8} {said}", flush=True)
    print("\nsurvivors:", *sorted(survivors), sep="\n  ")
    if done := counts.total():
        share = 100.0 * len(survivors) / done
        print(f"{len(survivors)} of {done} mutants survive ({share:.1f} %): {dict(counts)}")


if __name__ == "__main__":
    main()
