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
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
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
from supersampler_bench.markdown import size_text, table
from supersampler_bench.record import BenchRecord
from supersampler_bench.specs import compatible, gbuffers_of, parse_spec, with_default_gbuffers
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
for index in range(10 + request["steps"]):
    began, spent = time.perf_counter(), time.process_time()
    upscaler.step(frames[index % len(frames)], out=image)
    wall.append(time.perf_counter() - began)
    cores.append(time.process_time() - spent)
print(json.dumps({"wall": wall[10:], "cores": cores[10:]}))
"""
"""Prints the seconds of each step after ten of warm-up, wall time and time of all cores.

Request: method, frames (NPZ file), display (width, height), threads, steps.
"""
_ABOUT = """
import json, platform, supersampler
print(json.dumps({"version": supersampler.__version__, "python": platform.python_version()}))
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

    def run(self, program: str, **request: Any) -> dict[str, Any]:
        """Run a program in a new process, and return its answer.

        Args:
            program: `FIRST_IMAGE` or `STEPS`.
            request: request of the program.

        Raises:
            ArgumentError: it fails; with its last message.
        """
        environment = {**os.environ, "XDG_CACHE_HOME": str(self.cache), "PYTHONSAFEPATH": "1"}
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
        option, want = "PYTHON", "an interpreter that has the other version of supersampler"
        if self.name == "this":
            option, want = "--methods", "methods that run in this version"
        return ArgumentError(option, got=f"{self.python}: {problem}", want=want)


def _last_line(output: bytes) -> str:
    lines = output.decode(errors="replace").split("\n")
    return next((line.strip() for line in reversed(lines) if line.strip()), "")


@dataclass(frozen=True)
class FirstFrame:
    """Median seconds from a process's first line, before any import, to its first image.

    Attributes:
        method: the model's name.
        cold_seconds: seconds with an empty kernel cache.
        warm_seconds: seconds with the kernels cached.
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
MIN_ROUNDS = 6
"""Minimum number of rounds that gives an interval of `COVERAGE`."""

STEP_WALL, STEP_CORES, FIRST = "step, wall", "step, all cores", "first image"
"""Kinds of times: of a step; from the first line of a program to its first image, with cached kernels."""
Pair: TypeAlias = tuple[float, float]
"""Times of this version and of the other."""
T = TypeVar("T")
R = TypeVar("R")


@dataclass(frozen=True)
class Compared:
    """One time of one method in both versions; medians over the rounds, milliseconds.

    Attributes:
        method: the model's name.
        display: (width, height) of the images.
        threads: threads on the CPU; 0 for first images, which use the version's default.
        what: `STEP_WALL`, `STEP_CORES` or `FIRST`.
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
    rounds: int = 10,
    steps: int = 30,
    on_round: Callable[[], None] = lambda: None,
    on_left_out: Callable[[str], None] = lambda _: None,
) -> tuple[dict[str, dict[str, str]], list[Compared]]:
    """Time methods in this version and in another one.

    Args:
        python: interpreter of an environment in which the other version is installed.
        methods: names of models that both have.
        displays: (width, height) of the images.
        threads: numbers of CPU threads.
        ratio: display over render size.
        rounds: rounds of each setting; at least MIN_ROUNDS.
        steps: steps that count, of each version in a round.
        on_round: called after each round of each method.
        on_left_out: called with what is not timed, and why.

    Returns:
        Facts of the versions "this" and "other", and the times.

    Raises:
        ArgumentError: `python` is no interpreter, has no supersampler, lacks a method, or a process died.
    """
    results: list[Compared] = []
    with TemporaryDirectory() as name:
        folder = Path(name)
        sides = Version("this", sys.executable, folder / "this"), Version("other", python, folder / "other")
        other, this = (side.run(_ABOUT) for side in reversed(sides))  # a wrong interpreter fails at once
        for display, count in product(displays, threads):
            render, frames = render_size(display, ratio), folder / "frames.npz"
            able = compatible(methods, render, display, on_left_out)
            _write_frames(frames, able, render, display)
            for method in able:
                request = {"method": method, "frames": str(frames), "display": display, "threads": count}
                timed = partial(_step_times, request={**request, "steps": steps})
                pairs = _in_rounds(rounds, sides, timed, on_round)
                for number, what in enumerate((STEP_WALL, STEP_CORES)):
                    one = [(this[number], other[number]) for this, other in pairs]
                    results.append(compared(method, display, count, what, one))
        render = render_size(displays[0], ratio)
        for method in compatible(methods, render, displays[0], lambda _: None):
            if not gbuffers_of([method]):  # the program's frame has none
                timed_first = partial(
                    _first_time, request={"method": method, "render": render, "scale": ratio}
                )
                for side in sides:
                    timed_first(side)  # fills the kernel cache
                firsts = _in_rounds(rounds, sides, timed_first, on_round)
                results.append(compared(method, displays[0], 0, FIRST, firsts))
    return {"this": this, "other": other}, results


def _step_times(version: Version, request: Mapping[str, Any]) -> Pair:
    seconds = version.run(STEPS, **request)
    return 1e3 * median(seconds["wall"]), 1e3 * fmean(seconds["cores"])


def _first_time(version: Version, request: Mapping[str, Any]) -> float:
    return 1e3 * float(version.run(FIRST_IMAGE, **request)["seconds"])


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
    with replacing(path) as partial_path:
        np.savez(partial_path, **arrays)  # type: ignore[arg-type]  # its stub mistakes the names for other arguments


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
    sides: dict[str, dict[str, str]]
    steps: int
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
        this, other = (f"{side['version']}, Python {side['python']}" for side in self.sides.values())
        caption = (
            f"This version ({this}) and another ({other}) in turns, {self.steps} steps a round at ratio "
            f"{self.ratio:g}; medians over the rounds, and of the ratios in each round, with an interval of "
            f"order statistics that holds the median with at least {COVERAGE:.0%}. {self.machine_name}."
        )
        headings = ["display", "threads:", "method", "what", "other, ms:", "this, ms:", "this / other:"]
        return table([*headings, "95 % interval"], rows, caption)
