"""Mutate a random sample of places and print the changes that no test notices.

MUTATIONS=300 places, run from the FIRST=1 on, at most MINUTES=60 minutes, SEED=0, ONLY=part of a path.
Results are kept in out/mutation: the same mutant is not run again while its file and tests are the same.
"""

import hashlib
import json
import os
import sys
import time
import tomllib
from collections import Counter
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from mutation.coverage_map import CoverageMap, files_of, hash_of, record, targets_of
from mutation.mutants import Mutant, mutants_of, sample
from mutation.session import Outcome, copy_tree, in_child, preload, run_tests
from mutation.targets import EXCLUDED, TESTS

ROOT = Path(__file__).parents[2]
OUT = ROOT / "out" / "mutation"
TREE, LOG = OUT / "tree", OUT / "last.log"
BUDGET = 15.0
"""Seconds of tests for one mutant, as they take by themselves; quick ones come first."""
KILLED, SURVIVED, UNREACHED = "killed", "survived", "no test runs it"


@dataclass(frozen=True)
class StepResult:
    """Result of a mutant.

    Attributes:
        outcome: KILLED, SURVIVED or UNREACHED.
        by: the test that noticed.
        after: hash of what the outcome depends on beside the mutated file.
    """

    outcome: str
    by: str
    after: str


class Results:
    """Results of earlier runs, by mutant, in a file that is added to line by line."""

    def __init__(self, file: Path) -> None:
        self.file = file
        self.all_tests = hash_of(*(TREE / path for path in files_of(TREE, TESTS, EXCLUDED)))
        self.known: dict[str, StepResult] = {}
        for line in file.read_text().splitlines() if file.exists() else ():
            entry = json.loads(line)
            mutant = entry.pop("mutant")
            self.known[mutant] = StepResult(**entry)

    def find(self, mutant: str) -> StepResult | None:
        """Return a result that still holds: the killing test is as it was, or all tests are."""
        result = self.known.get(mutant)
        return result if result and result.after == self._state(result) else None

    def add(self, mutant: str, outcome: str, by: str) -> StepResult:
        """Keep a result."""
        result = StepResult(outcome, by, self._state(StepResult(outcome, by, "")))
        self.known[mutant] = result
        with self.file.open("a") as file:
            file.write(json.dumps({"mutant": mutant, **vars(result)}) + "\n")
        return result

    def _state(self, result: StepResult) -> str:
        test = TREE / result.by.split("::")[0].removesuffix(" (import)")
        return hash_of(test) if result.outcome == KILLED and test.is_file() else self.all_tests


def key_of(mutant: Mutant) -> str:
    """Name of a mutant: the text of the file with it."""
    return hashlib.sha256(mutant.applied((TREE / mutant.path).read_bytes())).hexdigest()[:24]


def examine(mutant: Mutant, tests: CoverageMap, importers: dict[str, list[str]]) -> tuple[str, str]:
    """Return the outcome of a mutant, and the test that noticed it or what was left out."""
    chosen: list[str] = []
    total = 0.0
    for test in (found := tests.tests_for(mutant, importers[mutant.path])):
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
        limit = 30.0 + 4.0 * min(total, BUDGET)
        outcome = in_child(partial(_tested, chosen), limit, LOG)
    finally:
        file.write_bytes(source)
    left_out = len(found) - len(chosen)
    return (
        (KILLED, outcome.failed)
        if outcome.failed
        else (SURVIVED, f"{left_out} slow tests left out" * bool(left_out))
    )


def _tested(tests: list[str]) -> Outcome:
    return run_tests(TREE, ["-x", *tests], [])


def importers_of(targets: list[str]) -> dict[str, list[str]]:
    """Return, for each target, those that import it."""
    texts = {path: (TREE / path).read_text(encoding="utf-8") for path in targets}
    names = {path: ".".join(Path(path).with_suffix("").parts[1:]) for path in targets}
    return {
        path: [other for other, text in texts.items() if f"from {name} import" in text]
        for path, name in names.items()
    }


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
    """Run."""
    settings = os.environ.get
    count, first, seed = (int(settings(*s)) for s in (("MUTATIONS", "300"), ("FIRST", "1"), ("SEED", "0")))
    end = time.monotonic() + 60.0 * float(settings("MINUTES", "60"))
    sys.dont_write_bytecode = True
    os.environ |= {"PYTHONDONTWRITEBYTECODE": "1", "OMP_NUM_THREADS": "1"}
    OUT.mkdir(parents=True, exist_ok=True)
    copy_tree(ROOT, TREE)
    preload()
    tests = record(TREE, OUT / "coverage.json", LOG)
    targets = [path for path in targets_of(TREE) if settings("ONLY", "") in path]
    importers, results = importers_of(targets_of(TREE)), Results(OUT / "results.jsonl")
    mutants = chosen_mutants(targets, count, seed)
    done: list[tuple[Mutant, StepResult]] = []
    for i, mutant in list(enumerate(mutants, 1))[first - 1 :]:
        started, key = time.monotonic(), key_of(mutant)
        if started > end:
            print("out of time; the same command goes on from here")
            break
        result = results.find(key) or results.add(key, *examine(mutant, tests, importers))
        done.append((mutant, result))
        seconds = f"{time.monotonic() - started:5.1f} s"
        print(
            f"[{i:3}/{len(mutants)}] {seconds} {result.outcome:8} {_said(mutant)}  ({result.by})", flush=True
        )
    _report(done)


def _said(mutant: Mutant) -> str:
    return f"{mutant.path}:{mutant.line} {mutant.where}: {mutant.before}  ->  {mutant.after}"


def _report(done: list[tuple[Mutant, StepResult]]) -> None:
    counts = Counter(result.outcome for _, result in done)
    survivors = [(mutant, result) for mutant, result in done if result.outcome != KILLED]
    print("\nsurvivors:" if survivors else "\nno survivors")
    for mutant, result in sorted(survivors, key=lambda s: (s[0].path, s[0].line)):
        print(f"  {_said(mutant)}  ({result.by or result.outcome})")
    if done:
        share = 100.0 * len(survivors) / len(done)
        print(f"{len(survivors)} of {len(done)} mutants survive ({share:.1f} %): {dict(counts)}")


if __name__ == "__main__":
    main()
