"""Times of programs in new processes: first images, and step times against another installed version.

The speed of a machine changes from minute to minute by more than versions differ, and the speed of a process
depends on where its memory lies. So in each round a method steps on the same frames in a new process of each
version, one after the other, in alternating order. The result is the median over the rounds of the ratio of
their times, with an interval.

A program is given as text and uses the package alone, so the other environment needs no bench. Its argument
is a request as JSON; the last line that it prints is its answer, as JSON.
"""

import json
import os
import subprocess
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from functools import cached_property
from itertools import product
from math import comb
from pathlib import Path
from statistics import fmean, median
from tempfile import TemporaryDirectory
from typing import Any, TypeAlias, TypeVar

import numpy as np

from supersampler.errors import ArgumentError
from supersampler.frame import Size
from supersampler.io.child_process import end_text, run
from supersampler.io.files import replacing
from supersampler.methods.gbuffers import GBUFFERS
from supersampler.methods.model_file import find_model, read_model_info
from supersampler_bench.markdown import size_text, table
from supersampler_bench.record import BenchRecord
from supersampler_bench.specs import gbuffers_of, incompatibility, parse_spec, with_default_gbuffers
from supersampler_bench.timing.latency import frames_of
from supersampler_model.data.shots import render_size

FIRST_IMAGE = """
import time
began = time.perf_counter()
import json, sys
import numpy as np
from supersampler import Frame, Upscaler
request = json.loads(sys.argv[1])
width, height = request["render"]
gray, still = np.full((height, width, 3), 0.5, np.float32), np.zeros((height, width, 2), np.float32)
frame = Frame(color=gray, depth=gray[..., 0].copy(), motion=still, jitter=(0.0, 0.0))
where = {"executor": request["executor"]} if "executor" in request else {"providers": "cpu"}
Upscaler(request["method"], scale=request["scale"], **where).step(frame)
print(json.dumps({"seconds": time.perf_counter() - began}))
"""
"""Prints the seconds from its first line to its first image. Request: method, render (width, height), scale;
executor, where the processor is not to be used.

The frame is made in memory, as an engine does; reading files is not timed.
"""
STEPS = """
import json, sys, time
import numpy as np
from supersampler import Frame, Upscaler
request = json.loads(sys.argv[1])
arrays, groups = dict(np.load(request["frames"])), {}
for name in [name for name in arrays if "." in name]:  # gbuffer.NAME, gbuffer_display.NAME
    group, _, key = name.partition(".")
    groups.setdefault(group, {})[key] = arrays.pop(name)
frames = [
    Frame(**{name: array[i] for name, array in arrays.items() if array[i].ndim > 1},
          jitter=tuple(map(float, arrays["jitter"][i])), exposure=float(arrays["exposure"][i]), **groups)
    for i in range(len(arrays["color"]))
]
width, height = request["display"]
upscaler = Upscaler(request["method"], display_size=(width, height), providers="cpu",
                    threads=request["threads"], validate="off")
image = np.empty((height, width, 3), np.float32)
wall, cores = [], []
for index in range(request["warm_up"] + request["steps"]):
    began, spent = time.perf_counter(), time.process_time()
    upscaler.step(frames[index % len(frames)], out=image)
    wall.append(time.perf_counter() - began)
    cores.append(time.process_time() - spent)
print(json.dumps({"wall": wall[request["warm_up"]:], "cores": cores[request["warm_up"]:]}))
"""
"""Prints the seconds of each step, wall time and time of all cores.

Request: method, frames (NPZ file), display (width, height), threads, warm_up (steps not counted), steps.
"""
_GIT_SECONDS = 30.0
_ABOUT = """
import json, os, platform, supersampler
folder = os.path.dirname(os.path.abspath(supersampler.__file__))
about = {"version": supersampler.__version__, "folder": folder, "python": platform.python_version()}
print(json.dumps(about))
"""


@dataclass(frozen=True)
class Version:
    """An installed version of the package.

    Attributes:
        name: "this" or "other".
        python: interpreter of the environment that has it.
        cache: folder for its compiled kernels.
    """

    name: str
    python: str
    cache: Path

    @cached_property
    def about(self) -> dict[str, Any]:
        """Version, Python, and the commit if the package is a git checkout, else None.

        Raises:
            ArgumentError: there is no such interpreter, or it has no supersampler.
        """
        about = self.run(_ABOUT)
        return {**about, "commit": commit(Path(about.pop("folder")))}

    def run(self, program: str, *, cache: Path | None = None, **request: Any) -> dict[str, Any]:
        """Run a program in a new process, and return its answer.

        Args:
            program: `FIRST_IMAGE` or `STEPS`.
            cache: folder for compiled kernels, instead of the version's own.
            request: of the program.

        Raises:
            ArgumentError: it fails; with its last message.
        """
        environment = {**os.environ, "XDG_CACHE_HOME": str(cache or self.cache), "PYTHONSAFEPATH": "1"}
        if self.name == "other":
            environment.pop("PYTHONPATH", None)  # it may lead to this version
        command = [self.python, "-c", program.strip(), json.dumps(request)]
        try:
            done = run(command, environment=environment, seconds=None)
        except OSError as error:
            raise self._error(f"not to be started: {error.strerror}") from error
        answer = _last_line(done.stdout)
        if done.returncode or not answer:
            raise self._error(
                f"ended with {end_text(done.returncode)}: {_last_line(done.stderr)[:200]}".removesuffix(": ")
            )
        try:
            return dict(json.loads(answer))
        except ValueError:
            raise self._error(f"no Python: it prints {answer[:60]!r}") from None

    def _error(self, problem: str) -> ArgumentError:
        option, want = "--against", "an interpreter that has the other version of supersampler"
        if self.name == "this":
            option, want = "--methods", "methods that run in this version"
        return ArgumentError(option, got=f"{self.python}: {problem}", want=want)


def _last_line(output: bytes) -> str:
    lines = output.decode(errors="replace").split("\n")
    return next((line.strip() for line in reversed(lines) if line.strip()), "")


def commit(folder: Path) -> str | None:
    """Return the commit that a package's folder is a checkout of; None if it is none or git is missing."""
    with suppress(OSError, subprocess.SubprocessError):
        _git(folder, "ls-files", "--error-unmatch", "__init__.py")
        return _git(folder, "describe", "--always", "--dirty", "--exclude=*", "--abbrev=12")
    return None


def _git(folder: Path, *command: str) -> str:
    done = run(["git", "-C", str(folder), *command], seconds=_GIT_SECONDS)
    done.check_returncode()
    return done.stdout.decode(errors="replace").strip()


@dataclass(frozen=True)
class FirstFrame:
    """Median seconds from a process's first line, before any import, to its first image.

    Attributes:
        method: the model's name.
        cold_seconds: with an empty kernel cache.
        warm_seconds: with the kernels cached.
        cache_bytes: size of the cached kernels.
    """

    method: str
    cold_seconds: float
    warm_seconds: float
    cache_bytes: int


def measure_startup(
    methods: Sequence[str],
    render: Size,
    *,
    scale: float = 2.0,
    cold: int = 3,
    warm: int = 5,
    on_process: Callable[[], None] = lambda: None,
) -> list[FirstFrame]:
    """Start processes, one after the other; each cold one has an empty cache folder of its own.

    Args:
        methods: shipped models or model folders that read no G-buffers; NAME:gpu on the GPU backend.
        render: (width, height) of the frame.
        scale: display over render size.
        cold: processes for each method that start with an empty cache.
        warm: processes that use the cache of the last cold one.
        on_process: called after each process.

    Raises:
        ArgumentError: a process fails.
    """
    results = []
    for method in methods:
        spec = parse_spec(method)
        request: dict[str, Any] = {"method": spec.model, "render": list(render), "scale": scale}
        if spec.executor == "gpu":
            request["executor"] = spec.executor
        cold_seconds, warm_seconds, cache_bytes = [], [], 0
        for index in range(cold):
            with TemporaryDirectory() as name:
                version = Version("this", sys.executable, Path(name))
                cold_seconds.append(version.run(FIRST_IMAGE, **request)["seconds"])
                on_process()
                cache_bytes = sum(path.stat().st_size for path in version.cache.rglob("*") if path.is_file())
                for _ in range(warm if index == cold - 1 else 0):
                    warm_seconds.append(version.run(FIRST_IMAGE, **request)["seconds"])
                    on_process()
        results.append(FirstFrame(method, median(cold_seconds), median(warm_seconds), cache_bytes))
    return results


@dataclass(frozen=True)
class StartupRecord(BenchRecord):
    """First-frame times of methods, at a render size and scale."""

    render: Size
    scale: float
    first_frames: list[FirstFrame]
    BENCH = "startup"

    def table(self) -> str:
        """Return the table as Markdown, with its caption."""
        rows = [
            [r.method, f"{r.cold_seconds:.1f}", f"{r.warm_seconds:.2f}", f"{r.cache_bytes / 1024:.0f}"]
            for r in self.first_frames
        ]
        caption = (
            "Median seconds from the first line of a program, before any import, to its first image. "
            f"Frames of {size_text(self.render)}, ratio {self.scale:g}. {self.machine_name}."
        )
        return table(["method", "cold cache, s:", "warm cache, s:", "cache, KiB:"], rows, caption)


COVERAGE = 0.95
"""Minimum probability with which the interval of a median contains it."""
ROUNDS, MIN_ROUNDS = 10, 6
"""Rounds of steps by default; minimum number that gives an interval of `COVERAGE`."""
_WARM_UP = 10  # steps of each process before those that count

STEP_WALL, STEP_CORES = "step, wall", "step, all cores"
FIRST, FIRST_FRESH = "first image", "first image, nothing kept"
"""Kinds of times: of a step; from the first line of a program to its first image, kernels cached or not."""
Pair: TypeAlias = tuple[float, float]
"""Times of this version and of the other."""
Versions: TypeAlias = tuple[Version, Version]
T = TypeVar("T")
R = TypeVar("R")


@dataclass(frozen=True)
class Rounds:
    """Numbers of rounds.

    Attributes:
        rounds: rounds of steps.
        steps: steps that count, of each version and method in a round.
        starts: rounds of first images with cached kernels.
        fresh: rounds of first images with an empty kernel cache.
    """

    rounds: int = ROUNDS
    steps: int = 10
    starts: int = ROUNDS
    fresh: int = 0

    def total(self, settings: int) -> int:
        """Return the rounds of one method at so many sizes and numbers of threads."""
        return settings * self.rounds + self.starts + self.fresh


@dataclass(frozen=True)
class Compared:
    """One time of one method in both versions; medians over the rounds, milliseconds.

    Attributes:
        method: the model's name.
        display: (width, height) of the images.
        threads: on the CPU; 0 for first images, which use the version's default.
        what: `STEP_WALL`, `STEP_CORES`, `FIRST` or `FIRST_FRESH`.
        this: of the installed version.
        other: of the other one.
        median: of the ratios this / other in each round.
        low, high: interval that contains the median with at least `COVERAGE`, of order statistics.
        rounds: (this, other) of each round.
    """

    method: str
    display: Size
    threads: int
    what: str
    this: float
    other: float
    median: float
    low: float
    high: float
    rounds: list[Pair]


def measure_against(
    python: str,
    methods: Sequence[str],
    displays: Sequence[Size],
    threads: Sequence[int],
    *,
    ratio: float = 2.0,
    rounds: Rounds = Rounds(),
    on_round: Callable[[], None] = lambda: None,
    on_left_out: Callable[[str], None] = lambda _: None,
) -> tuple[dict[str, Any], list[Compared]]:
    """Time methods in this version and in another one.

    Args:
        python: interpreter of an environment in which the other version is installed.
        methods: names of models that both have.
        displays: (width, height) of the images.
        threads: numbers of CPU threads.
        ratio: display over render size.
        rounds: how often.
        on_round: called after each round of each method.
        on_left_out: called with what is not timed, and why.

    Returns:
        Facts of the versions "this" and "other", and the times.

    Raises:
        ArgumentError: `python` is no interpreter, has no supersampler, lacks a method, or a process died; or
            rounds are too few for an interval.
    """
    for name, count in asdict(rounds).items():
        if name != "steps" and 0 < count < MIN_ROUNDS:
            want = f"at least {MIN_ROUNDS}, or 0"
            raise ArgumentError(f"--{name}", got=count, want=want, hint="Fewer give no interval.")
    results: list[Compared] = []
    with TemporaryDirectory() as name:
        folder = Path(name)
        sides = Version("this", sys.executable, folder / "this"), Version("other", python, folder / "other")
        about = {side.name: side.about for side in reversed(sides)}  # a wrong interpreter fails at once
        for display, count in product(displays, threads):
            render, frames = render_size(display, ratio), folder / "frames.npz"
            able = [method for method in methods if not incompatibility(method, render, display)]
            _write_frames(frames, able, render, display)
            for method in able:
                results += _steps(sides, frames, method, display, count, rounds, on_round)
        for method in methods:
            if reason := _no_first_image(method, render_size(displays[0], ratio), displays[0]):
                on_left_out(reason)
            else:
                results += _first_images(sides, method, displays[0], ratio, rounds, on_round)
    return about, results


def _no_first_image(method: str, render: Size, display: Size) -> str:
    if reason := incompatibility(method, render, display):
        return reason
    info = read_model_info(find_model(method))
    return f"{method}: no first image is timed, as its frames have no G-buffers." if info.gbuffers else ""


def _write_frames(path: Path, methods: Sequence[str], render: Size, display: Size) -> None:
    """Write frames for both sides: each field of all frames, and default G-buffers of the first."""
    frames = frames_of(render)
    arrays = {name: np.stack([getattr(f, name) for f in frames]) for name in ("color", "depth", "motion")}
    arrays["jitter"] = np.array([frame.jitter for frame in frames])
    arrays["exposure"] = np.array([frame.exposure for frame in frames])
    names = gbuffers_of(methods)
    first = with_default_gbuffers(frames[0], names, display)
    for name in names:
        place, array = GBUFFERS[name], GBUFFERS[name].find(first)
        if array is not None:
            arrays[f"{place.group}.{place.key}"] = array
    with replacing(path) as partial:
        np.savez(partial, **arrays)  # type: ignore[arg-type]  # its stub mistakes the names for other arguments


def _steps(
    sides: Versions,
    frames: Path,
    method: str,
    display: Size,
    threads: int,
    rounds: Rounds,
    on_round: Callable[[], None],
) -> Iterator[Compared]:
    request: dict[str, Any] = {
        "method": method,
        "frames": str(frames),
        "display": display,
        "threads": threads,
    }

    def timed(version: Version) -> Pair:
        seconds = version.run(STEPS, **request, warm_up=_WARM_UP, steps=rounds.steps)
        return 1e3 * median(seconds["wall"]), 1e3 * fmean(seconds["cores"])

    found = _in_rounds(rounds.rounds, sides, timed, on_round)
    for number, what in enumerate((STEP_WALL, STEP_CORES)):
        pairs = [(this[number], other[number]) for this, other in found]
        yield compared(method, display, threads, what, pairs)


def _first_images(
    sides: Versions, method: str, display: Size, ratio: float, rounds: Rounds, on_round: Callable[[], None]
) -> Iterator[Compared]:
    request: dict[str, Any] = {"method": method, "render": render_size(display, ratio), "scale": ratio}

    def kept(version: Version) -> float:
        return 1e3 * float(version.run(FIRST_IMAGE, **request)["seconds"])

    def fresh(version: Version) -> float:
        with TemporaryDirectory() as empty:
            return 1e3 * float(version.run(FIRST_IMAGE, cache=Path(empty), **request)["seconds"])

    if rounds.fresh:
        pairs = _in_rounds(rounds.fresh, sides, fresh, on_round)
        yield compared(method, display, 0, FIRST_FRESH, pairs)
    if rounds.starts:
        for version in sides:
            kept(version)  # fills the kernel caches
        yield compared(method, display, 0, FIRST, _in_rounds(rounds.starts, sides, kept, on_round))


def _in_rounds(
    count: int, sides: tuple[T, T], timed: Callable[[T], R], on_round: Callable[[], None]
) -> list[tuple[R, R]]:
    """Time this version, then the other; in every second round the other first."""
    found = []
    for index in range(count):
        first = index % 2
        results = {side: timed(sides[side]) for side in (first, 1 - first)}
        found.append((results[0], results[1]))
        on_round()
    return found


def compared(method: str, display: Size, threads: int, what: str, rounds: list[Pair]) -> Compared:
    """Summarise all rounds."""
    ratios = [this / other for this, other in rounds]
    low, high = interval(ratios)
    this, other = (median(times) for times in zip(*rounds, strict=True))
    return Compared(method, display, threads, what, this, other, median(ratios), low, high, rounds)


def interval(values: Sequence[float], coverage: float = COVERAGE) -> Pair:
    """Return an interval that contains the median of the distribution behind some samples.

    Its ends are the k-th values from either end, with the largest k for which the median lies between them
    with probability `coverage`, whatever the distribution. 0.95 takes `MIN_ROUNDS` values.
    """
    count, ordered = len(values), sorted(values)
    outside, k = 2.0 * 0.5**count, 0  # the probability that the median is beyond the k-th from either end
    while k + 1 < count // 2 and outside + 2.0 * comb(count, k + 1) * 0.5**count <= 1.0 - coverage:
        k += 1
        outside += 2.0 * comb(count, k) * 0.5**count
    return ordered[k], ordered[-1 - k]


@dataclass(frozen=True)
class AgainstRecord(BenchRecord):
    """Times of two versions, "this" and "other"."""

    ratio: float
    sides: dict[str, Any]
    taken: Rounds
    compared: list[Compared]
    BENCH = "against"

    def table(self) -> str:
        """Return the table as Markdown, with its caption."""
        rows = [
            [
                size_text(c.display),
                c.threads or "all",
                c.method,
                c.what,
                *(f"{c.other:.1f}", f"{c.this:.1f}", f"{c.median:.3f}", f"{c.low:.3f} to {c.high:.3f}"),
            ]
            for c in self.compared
        ]
        caption = (
            f"This version ({_named(self.sides['this'])}) and another ({_named(self.sides['other'])}) in "
            f"turns, {self.taken.rounds} rounds of {self.taken.steps} steps each at ratio {self.ratio:g}; "
            "medians over the rounds, and of the ratios in each round, with an interval of order statistics "
            f"that holds the median with at least {COVERAGE:.0%}. {self.machine_name}."
        )
        headings = ["display", "threads:", "method", "what", "other, ms:", "this, ms:", "this / other:"]
        return table([*headings, "95 % interval"], rows, caption)


def _named(version: Mapping[str, Any]) -> str:
    commit = f", commit {version['commit']}" if version["commit"] else ""
    return f"{version['version']}{commit}, Python {version['python']}"
