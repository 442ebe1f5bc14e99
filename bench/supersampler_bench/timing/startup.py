"""Times of first images, each in a new process."""

import json
import os
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory

from supersampler.cli.arguments import size_text
from supersampler.errors import ArgumentError
from supersampler.frame import Size
from supersampler.io.child_process import end_text, run
from supersampler_bench.record import BenchRecord, table
from supersampler_bench.specs import Spec, parse_spec

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
Upscaler(request["method"], scale=request["scale"], **request["where"]).step(frame)
print(json.dumps({"seconds": time.perf_counter() - began}))
"""
"""Prints the seconds from its first line to its first image, of a frame in memory.

Its argument is a request as JSON: method, render (width, height), scale, and where it runs; its output, too.
"""
RATIO = 2.0  # of the image to the frame


@dataclass(frozen=True)
class FirstFrame:
    """Median seconds from a process's first line, before any import, to its first image."""

    method: str
    cold_seconds: float  # with an empty cache, in which GPU drivers keep shaders
    warm_seconds: float  # with a warm cache
    cache_bytes: int


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
    For suffixes of the methods, see `parse_spec`.

    Raises:
        ArgumentError: a process fails; with its last message.
    """
    results = []
    for method in methods:
        spec = parse_spec(method)
        cold_seconds, warm_seconds, cache_bytes = [], [], 0
        for index in range(cold):
            with TemporaryDirectory() as cache:
                cold_seconds.append(_first_image(spec, render, cache))
                on_process()
                cache_bytes = sum(path.stat().st_size for path in Path(cache).rglob("*") if path.is_file())
                for _ in range(warm if index == cold - 1 else 0):
                    warm_seconds.append(_first_image(spec, render, cache))
                    on_process()
        results.append(FirstFrame(method, median(cold_seconds), median(warm_seconds), cache_bytes))
    return results


def _first_image(spec: Spec, render: Size, cache: str) -> float:
    """Return the seconds to the first image of a new process, whose drivers keep shaders in `cache`."""
    where: dict[str, str] = {"precision": spec.precision, "at_rest": spec.at_rest}
    where |= {"executor": "gpu"} if spec.executor == "gpu" else {"providers": "cpu"}
    request = {"method": spec.model, "render": render, "scale": RATIO, "where": where}
    environment = {**os.environ, "XDG_CACHE_HOME": cache, "PYTHONSAFEPATH": "1"}
    command = [sys.executable, "-c", FIRST_IMAGE.strip(), json.dumps(request)]
    done = run(command, environment=environment, seconds=None)
    if done.returncode:
        last = done.stderr.decode(errors="replace").strip().rpartition("\n")[2]
        got = f"{spec}, whose process ended with {end_text(done.returncode)}: {last[:200]}"
        raise ArgumentError("--methods", got=got, want="methods that run here")
    return float(json.loads(done.stdout.splitlines()[-1])["seconds"])


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
