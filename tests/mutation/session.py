"""Tests run in copies of the tree, in child processes that find torch already imported."""

import importlib
import multiprocessing
import os
import resource
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from multiprocessing.connection import Connection
from multiprocessing.queues import SimpleQueue
from pathlib import Path

import pytest

from mutation.targets import PACKAGES

PRELOADED = ["numpy", "torch", "onnx", "onnxscript", "OpenImageIO", "scipy"]
"""Slow to import, and the same for all mutants."""
MEMORY = 12 << 30
"""Bytes of data that a child may hold: a mutant may ask for any size."""


@dataclass
class Outcome:
    """Result of a run of tests.

    Attributes:
        failed: the first test that failed, or what else went wrong; None where all passed.
        seconds: seconds of each test that passed, with what is set up for it.
        lines: lines of each target file, the tests that ran each line; see `coverage_map`.
    """

    failed: str | None = None
    seconds: dict[str, float] = field(default_factory=dict)
    lines: dict[str, dict[int, list[str]]] = field(default_factory=dict)


class Watch:
    """A pytest plugin that notes times and the first failure."""

    def __init__(self) -> None:
        self.outcome = Outcome()
        self.failures: set[str] = set()

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        """Add a phase of a test."""
        seconds = self.outcome.seconds
        seconds[report.nodeid] = seconds.get(report.nodeid, 0.0) + report.duration
        if report.failed:
            self.outcome.failed = self.outcome.failed or report.nodeid
            self.failures.add(report.nodeid)

    def pytest_collectreport(self, report: pytest.CollectReport) -> None:
        """Note a file that cannot be imported."""
        if report.failed and self.outcome.failed is None:
            self.outcome.failed = f"{report.nodeid} (import)"


@dataclass
class Workplace:
    """The copy of the tree, and the log, of one worker process."""

    tree: Path = Path()

    @property
    def log(self) -> Path:
        """Output of the last run of tests."""
        return self.tree.with_suffix(".log")


HERE = Workplace()
"""Set in each worker of `pool`."""


def pool(trees: Sequence[Path]) -> ProcessPoolExecutor:
    """Return one worker process for each copy of the tree, which it has to itself."""
    context = multiprocessing.get_context("fork")
    free = context.SimpleQueue()
    for tree in trees:
        free.put(tree)
    return ProcessPoolExecutor(len(trees), context, _take, (free,))


def _take(free: "SimpleQueue[Path]") -> None:
    HERE.tree = free.get()


def preload() -> None:
    """Import what is not mutated, once."""
    for name in PRELOADED:
        try:
            importlib.import_module(name)
        except ImportError:  # not everything is installed everywhere
            continue


def run_tests(tree: Path, arguments: list[str], plugins: list[object]) -> Outcome:
    """Run pytest in this process, which is a child, on the copy in `tree`."""
    folders = [str(tree / package) for package in PACKAGES]
    sys.path[:0] = folders
    os.environ["PYTHONPATH"] = os.pathsep.join(folders)  # of processes that tests start
    os.chdir(tree)
    watch = Watch()
    code = pytest.main(["-q", "-p", "no:cacheprovider", "-p", "no:xdist", *arguments], [watch, *plugins])
    for test in watch.failures:
        del watch.outcome.seconds[test]
    if code not in (0, 1) and watch.outcome.failed is None:
        watch.outcome.failed = f"pytest ended with {int(code)}"
    return watch.outcome


def in_child(work: Callable[[], Outcome], seconds: float, log: Path) -> Outcome:
    """Return what `work` returns in a child process, which writes to `log` and ends after `seconds`."""
    context = multiprocessing.get_context("fork")
    ours, theirs = context.Pipe(duplex=False)
    child = context.Process(target=_child, args=(work, theirs, log))
    child.start()
    theirs.close()
    try:
        outcome: Outcome = ours.recv() if _answers(ours, seconds) else Outcome(failed="out of time")
    except EOFError:
        child.join()
        outcome = Outcome(failed=f"the process ended with {child.exitcode}")
    _kill_group(child.pid)
    child.join()
    return outcome


def _answers(answer: Connection, seconds: float) -> bool:
    """Wait second by second: while both processes are stopped, by Ctrl+Z say, no time passes."""
    return any(answer.poll(1.0) for _ in range(round(seconds)))


def _child(work: Callable[[], Outcome], answer: Connection, log: Path) -> None:
    os.setsid()
    resource.setrlimit(resource.RLIMIT_DATA, (MEMORY, MEMORY))
    descriptor = os.open(log, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
    os.dup2(descriptor, 1)
    os.dup2(descriptor, 2)
    answer.send(work())
    sys.stdout.flush()
    os._exit(0)  # no handlers of a mutant


def _kill_group(group: int | None) -> None:
    """End a child and what its tests have started."""
    for _ in range(50):
        try:
            os.killpg(group or 0, signal.SIGKILL)
        except ProcessLookupError:
            return
        except PermissionError:
            time.sleep(0.01)
        time.sleep(0.01)


def copy_tree(root: Path, tree: Path) -> None:
    """Make `tree` hold what git sees in `root`: changed files alone are copied."""
    listed = ["git", "-C", str(root), "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    names = {
        n for n in subprocess.run(listed, capture_output=True, check=True).stdout.decode().split("\0") if n
    }
    names = {name for name in names if (root / name).is_file()}
    for file in [f for f in tree.rglob("*") if f.is_file() and f.suffix != ".pyc"]:
        if str(file.relative_to(tree)) not in names:
            file.unlink()
    for name in names:
        source, target = root / name, tree / name
        if not target.exists() or source.read_bytes() != target.read_bytes():
            target.parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(source, target)
