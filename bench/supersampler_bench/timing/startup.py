"""Times of programs in new processes: first images, and step times against another installed version.

Versions differ by less than the speed of a machine changes from minute to minute, and the speed of a process
depends on its memory addresses. So each round steps a method on the same frames in a new process of each
version, one after the other, in alternating order. The result is the median of the rounds' time ratios, with
the minimum and the maximum.

Programs are text and use only the package, so that the other environment needs no bench. A program's argument
is a request as JSON; the last line that it prints is its answer as JSON.
"""

import json
import os
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import Any

from supersampler.cli.arguments import size_text
from supersampler.errors import ArgumentError
from supersampler.frame import Size
from supersampler.io.child_process import end_text, run
from supersampler_bench.record import BenchRecord, table
from supersampler_bench.specs import parse_spec
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
"""Prints the seconds from its first line to its first image, of a frame in memory.

Request: method, render (width, height), scale; executor, unless it is the CPU's.
"""
STEPS = """
import json, sys, time
from statistics import median
import numpy as np
from supersampler import Frame, Shot, Upscaler
request = json.loads(sys.argv[1])
(width, height), (w, h) = request["display"], request["render"]

def tiled(image):
    times = (-(-h // image.shape[0]), -(-w // image.shape[1]), *[1] * (image.ndim - 2))
    return np.ascontiguousarray(np.tile(image, times)[:h, :w], np.float32)

shot = [item.frame for item in Shot.open("plaza")][8:16]
frames = [Frame(color=tiled(f.color), depth=tiled(f.depth), motion=tiled(f.motion), jitter=f.jitter,
                exposure=f.exposure or 1.0) for f in shot]
upscaler = Upscaler(request["method"], display_size=(width, height), providers="cpu",
                    threads=request["threads"], validate="off")
image = np.empty((height, width, 3), np.float32)
times = []
for index in range(10 + request["steps"]):
    began = time.perf_counter()
    upscaler.step(frames[index % 8], out=image)
    times.append(time.perf_counter() - began)
print(json.dumps({"ms": 1e3 * median(times[10:])}))
"""
"""Prints the median milliseconds of a step, after ten warm-up steps, on the shipped shot tiled to the size.

Request: method, display and render (width, height), threads, steps.
"""


@dataclass(frozen=True)
class Version:
    """An installed version of the package."""

    name: str  # "this" or "other"
    python: str  # interpreter of its environment
    cache: Path  # folder where drivers keep compiled shaders

    def run(self, program: str, **request: Any) -> dict[str, Any]:
        """Run a program in a new process, and return its answer.

        Raises:
            ArgumentError: it fails; with its last message.
        """
        environment = {**os.environ, "XDG_CACHE_HOME": str(self.cache), "PYTHONSAFEPATH": "1"}
        if self.name == "other":
            environment.pop("PYTHONPATH", None)  # it may contain this version
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
    """Median seconds from a process's first line, before any import, to its first image."""

    method: str
    cold_seconds: float  # with an empty cache, in which GPU drivers keep shaders
    warm_seconds: float  # with a warm cache
    cache_bytes: int


STARTUP_SCALE = 2.0


def measure_startup(
    methods: Sequence[str],
    render: Size,
    *,
    cold: int = 3,
    warm: int = 5,
    on_process: Callable[[], None] = lambda: None,
) -> list[FirstFrame]:
    """Start processes for each method, one after the other. Methods read no G-buffers.

    `cold` processes have an empty cache folder each; `warm` ones then use the cache of the last cold one.
    NAME:gpu runs on the GPU backend.
    """
    results = []
    for method in methods:
        spec = parse_spec(method)
        request: dict[str, Any] = {"method": spec.model, "render": list(render), "scale": STARTUP_SCALE}
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
        """Return the table of methods."""
        rows = [
            [r.method, f"{r.cold_seconds:.1f}", f"{r.warm_seconds:.2f}", f"{r.cache_bytes / 1024:.0f}"]
            for r in self.first_frames
        ]
        caption = (
            "Median seconds from the first line of a program, before any import, to its first image. "
            f"Frames of {size_text(self.render)}, ratio {self.scale:g}. {self.machine_name}."
        )
        return table(["method", "cold cache, s:", "warm cache, s:", "cache, KiB:"], rows, caption)


@dataclass(frozen=True)
class Compared:
    """Median step times of a method in both versions."""

    method: str
    rounds: list[tuple[float, float]]  # (this, other)

    @property
    def ratios(self) -> list[float]:
        """This version's time over the other's, in each round."""
        return [this / other for this, other in self.rounds]


def measure_against(
    python: str,
    methods: Sequence[str],
    display: Size,
    threads: int,
    *,
    ratio: float,
    rounds: int,
    steps: int,
    on_round: Callable[[], None],
) -> list[Compared]:
    """Time `steps` steps of methods per round in this version and in the one of another interpreter.

    Both versions have the methods, which read no G-buffers. A round is a pair of processes.
    """
    size = {"display": list(display), "render": list(render_size(display, ratio))}
    results = [Compared(method, []) for method in methods]
    with TemporaryDirectory() as name:
        this = Version("this", sys.executable, Path(name, "this"))
        other = Version("other", python, Path(name, "other"))
        for result in results:
            request = {"method": result.method, **size, "threads": threads, "steps": steps}
            for index in range(rounds):
                pair = (other, this) if index % 2 == 0 else (this, other)  # a wrong interpreter fails at once
                times = {side.name: float(side.run(STEPS, **request)["ms"]) for side in pair}
                result.rounds.append((times["this"], times["other"]))
                on_round()
    return results


@dataclass(frozen=True)
class AgainstRecord(BenchRecord):
    """Step times of two versions."""

    display: Size
    ratio: float
    threads: int
    steps: int
    compared: list[Compared]
    BENCH = "against"

    def table(self) -> str:
        """Return the table of methods."""
        rows = []
        for one in self.compared:
            this, other = (median(times) for times in zip(*one.rounds, strict=True))
            spread = f"{min(one.ratios):.3f} to {max(one.ratios):.3f}"
            rows.append([one.method, f"{other:.1f}", f"{this:.1f}", f"{median(one.ratios):.3f}", spread])
        caption = (
            f"Steps to {size_text(self.display)} at ratio {self.ratio:g} on {self.threads} threads, "
            f"alternately in this version and in another, {self.steps} per round. Medians over the rounds; "
            f"for the rounds' ratios also minimum and maximum. {self.machine_name}."
        )
        return table(["method", "other, ms:", "this, ms:", "this / other:", "min to max"], rows, caption)
