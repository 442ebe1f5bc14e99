"""Map of the lines that tests run: recorded file by file, kept as long as neither side changes."""

import hashlib
import json
from collections import Counter
from collections.abc import Generator, Iterable, Iterator
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import coverage
import pytest

from mutation.mutants import Mutant
from mutation.session import HERE, Outcome, in_child, run_tests
from mutation.targets import EXCLUDED, STRONG, TARGETS, TESTS

SETUP = "(setup)"
"""Stands for all tests of a file: fixtures are made for the first that needs them."""
FILE_SECONDS = 400.0
"""Most that a file of tests may take while it is recorded."""


def files_of(tree: Path, globs: Iterable[str], without: Iterable[str] = ()) -> list[str]:
    """Return the files that globs find, sorted, by their paths from `tree`."""
    left_out = {path for glob in without for path in tree.glob(glob)}
    found = {path for glob in globs for path in tree.glob(glob)} - left_out
    return sorted(str(path.relative_to(tree)) for path in found)


def targets_of(tree: Path) -> list[str]:
    """Return the files to be mutated."""
    return files_of(tree, TARGETS, EXCLUDED)


def hash_of(*files: Path) -> str:
    """Hash of the files' texts."""
    return hashlib.sha256(b"\0".join(f.read_bytes() if f.exists() else b"" for f in files)).hexdigest()[:16]


class Recorder:
    """A pytest plugin: coverage with a context for each test."""

    def __init__(self, tree: Path, targets: list[str]) -> None:
        self.tree, self.targets = tree, targets
        include = [str(tree / path) for path in targets]
        self.coverage = coverage.Coverage(data_file=None, config_file=False, include=include, messages=False)

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def pytest_runtest_setup(self) -> Generator[None]:
        """Fixtures are of all tests of their file."""
        self.coverage.switch_context(SETUP)
        return (yield)

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def pytest_runtest_call(self, item: pytest.Item) -> Generator[None]:
        """Lines are of this test."""
        self.coverage.switch_context(item.nodeid)
        return (yield)

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def pytest_runtest_teardown(self) -> Generator[None]:
        """Ignore lines that run from now on."""
        self.coverage.switch_context("(teardown)")
        return (yield)

    def record(self, test_file: str) -> Outcome:
        """Run a file of tests and return what each has run."""
        self.coverage.start()
        outcome = run_tests(self.tree, [test_file], [self])
        self.coverage.stop()
        data = self.coverage.get_data()
        for path in self.targets:
            contexts = data.contexts_by_lineno(str(self.tree / path))
            if contexts:
                outcome.lines[path] = dict(contexts)
        return outcome


@dataclass(frozen=True)
class CoverageMap:
    """Tests by the lines that they run.

    Attributes:
        seconds: seconds that each test takes by itself.
        lines: lines of each target, by line, the tests of which one may notice a change there.
    """

    seconds: dict[str, float]
    lines: dict[str, dict[int, set[str]]]

    def tests_for(self, mutant: Mutant) -> list[str]:
        """Return the tests for a change: those that run its line, strong ones and then quick ones first.

        A change that runs on import may be noticed by any test that runs its module; those that run more of
        it come first.
        """
        here, (first, last) = self.lines.get(mutant.path, {}), mutant.lines
        if not mutant.on_import:
            tests = {test for line in range(first, last + 1) for test in here.get(line, ())}
            return sorted(tests, key=lambda test: (not _is_strong(test), self.seconds[test], test))
        run = Counter(test for found in here.values() for test in found)
        return sorted(run, key=lambda t: (not _is_strong(t), (0.1 + self.seconds[t]) / run[t], t))


def _is_strong(test: str) -> bool:
    return test.partition("::")[0] in STRONG


def record(tree: Path, kept: Path, workers: Executor) -> CoverageMap:
    """Return the map of `tree`: what `kept` holds and, where that is out of date, tests recorded anew."""
    records = json.loads(kept.read_text()) if kept.exists() else {}
    files = files_of(tree, TESTS, EXCLUDED)

    def digest(test_file: str) -> str:
        return hash_of(tree / test_file, *(tree / target for target in records[test_file]["lines"]))

    due = [file for file in files if file not in records or records[file]["hash"] != digest(file)]
    due.sort(key=lambda file: -sum(records.get(file, {}).get("seconds", {"": 0.0}).values()))
    for number, (test_file, outcome) in enumerate(workers.map(_recorded, due), 1):
        problem = f", failed: {outcome.failed}" if outcome.failed else ""
        print(
            f"[{number:3}/{len(due)}] {test_file}: {sum(outcome.seconds.values()):.1f} s{problem}", flush=True
        )
        records[test_file] = {"seconds": outcome.seconds, "lines": outcome.lines}
        records[test_file]["hash"] = digest(test_file)
        kept.write_text(json.dumps(records))
    return _joined(records[file] for file in files)


def _recorded(test_file: str) -> tuple[str, Outcome]:
    recorder = Recorder(HERE.tree, targets_of(HERE.tree))
    return test_file, in_child(partial(recorder.record, test_file), FILE_SECONDS, HERE.log)


def _joined(records: Iterator[dict[str, dict[str, dict[str, list[str]]]]]) -> CoverageMap:
    seconds: dict[str, float] = {}
    lines: dict[str, dict[int, set[str]]] = {}
    for entry in records:
        own: dict[str, float] = entry["seconds"]  # type: ignore[assignment]
        seconds |= own
        for path, contexts in entry["lines"].items():
            of_file = lines.setdefault(path, {})
            for line, tests in contexts.items():
                found = of_file.setdefault(int(line), set())
                found |= set(own) if SETUP in tests else {t for t in tests if t in own}
    return CoverageMap(seconds, lines)
