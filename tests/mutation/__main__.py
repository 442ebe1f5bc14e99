"""Mutate a random sample of places and print the changes that no test notices.

MUTATIONS=300 places, run from the FIRST=1 on, at most MINUTES=60 minutes, SEED=0, ONLY=part of a path.
The map of lines that tests run is kept in out/mutation.
"""

import os
import sys
import time
import tomllib
from collections import Counter
from functools import partial
from pathlib import Path

from mutation.coverage_map import CoverageMap, record, targets_of
from mutation.mutants import Mutant, mutants_of, sample
from mutation.session import Outcome, copy_tree, in_child, preload, run_tests

ROOT = Path(__file__).parents[2]
OUT = ROOT / "out" / "mutation"
TREE, LOG = OUT / "tree", OUT / "last.log"
BUDGET = 15.0
"""Seconds of tests for one mutant, as they take by themselves; quick ones come first."""
KILLED, SURVIVED, UNREACHED = "killed", "survived", "no test runs it"


def examine(mutant: Mutant, tests: CoverageMap) -> tuple[str, str]:
    """Return the outcome of a mutant, and the test that noticed it or what was left out."""
    chosen: list[str] = []
    total = 0.0
    for test in (found := tests.tests_for(mutant)):
        total += tests.seconds[test]
        if chosen and total > BUDGET:
            break
        chosen.append(test)
    if not chosen:
        return UNREACHED, ""
    file = TREE / mutant.path
    source = file.read_bytes()
    try:
        file.write_bytes(mutant.applied(source))
        outcome = in_child(partial(_tested, chosen), 30.0 + 4.0 * min(total, BUDGET), LOG)
    finally:
        file.write_bytes(source)
    if outcome.failed:
        return KILLED, outcome.failed
    left_out = len(found) - len(chosen)
    return SURVIVED, f"{left_out} slow tests left out" * bool(left_out)


def _tested(tests: list[str]) -> Outcome:
    return run_tests(TREE, ["-x", *tests], [])


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
    copy_tree(ROOT, TREE)
    preload()
    tests = record(TREE, OUT / "coverage.json", LOG)
    mutants = chosen_mutants([path for path in targets_of(TREE) if settings("ONLY", "") in path], count, seed)
    survivors: list[str] = []
    counts = Counter[str]()
    for number, mutant in list(enumerate(mutants, 1))[first - 1 :]:
        if (started := time.monotonic()) > end:
            print(f"out of time; FIRST={number} goes on from here")
            break
        outcome, note = examine(mutant, tests)
        counts[outcome] += 1
        said = f"{mutant.path}:{mutant.line} {mutant.where}: {mutant.before}  ->  {mutant.after}  ({note})"
        survivors += [said] if outcome != KILLED else []
        seconds = time.monotonic() - started
        print(f"[{number:3}/{len(mutants)}] {seconds:5.1f} s {outcome:8} {said}", flush=True)
    print("\nsurvivors:", *sorted(survivors), sep="\n  ")
    if done := counts.total():
        share = 100.0 * len(survivors) / done
        print(f"{len(survivors)} of {done} mutants survive ({share:.1f} %): {dict(counts)}")


if __name__ == "__main__":
    main()
