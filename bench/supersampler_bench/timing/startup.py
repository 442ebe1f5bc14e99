"""First-frame time: from the start of a process to its first image, with a cold and a warm kernel cache."""

import os
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import Any

from supersampler.frame import Size
from supersampler_bench.markdown_table import size_text, table
from supersampler_bench.record import Record, machine_name

FIRST_IMAGE = """
import time
began = time.perf_counter()
import sys
import numpy as np
from supersampler import Frame, Upscaler
method, width, height, scale = sys.argv[1], int(sys.argv[2]), int(sys.argv[3]), float(sys.argv[4])
gray, still = np.full((height, width, 3), 0.5, np.float32), np.zeros((height, width, 2), np.float32)
frame = Frame(color=gray, depth=gray[..., 0].copy(), motion=still, jitter=(0.0, 0.0))
Upscaler(method, scale=scale, providers="cpu").step(frame)
print(time.perf_counter() - began)
"""
"""A program that prints the seconds to its first image. Arguments: method, render width and height, scale.

It makes its frame in memory, as an engine does; reading files is not timed.
"""


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
        methods: names of shipped models or model folders that read no G-buffers.
        render: (width, height) of the frame.
        scale: display over render size.
        cold: processes for each method that start with an empty cache.
        warm: processes that use the cache of the last cold one.
        on_process: called after each process.
    """
    results = []
    for method in methods:
        command = [sys.executable, "-c", FIRST_IMAGE, method, *map(str, render), str(scale)]
        first, others, cache_bytes = [], [], 0
        for index in range(cold):
            with TemporaryDirectory() as cache:
                first.append(_seconds(command, cache))
                on_process()
                cache_bytes = sum(path.stat().st_size for path in Path(cache).rglob("*") if path.is_file())
                for _ in range(warm if index == cold - 1 else 0):
                    others.append(_seconds(command, cache))
                    on_process()
        results.append(FirstFrame(method, median(first), median(others), cache_bytes))
    return results


def _seconds(command: Sequence[str], cache: str) -> float:
    environment = {**os.environ, "XDG_CACHE_HOME": cache}
    done = subprocess.run(  # noqa: S603  # our own interpreter and program
        command, check=True, capture_output=True, text=True, env=environment
    )
    return float(done.stdout)


def startup_record(results: Sequence[FirstFrame], render: Size, scale: float) -> dict[str, Any]:
    """Return all values, ready for JSON."""
    first_frames = [asdict(result) for result in results]
    return {"bench": "startup", "render": list(render), "scale": scale, "first_frames": first_frames}


def markdown_table(record: Record) -> str:
    """Return the table of a record as Markdown, with its caption."""
    rows = [
        [r.method, f"{r.cold_seconds:.1f}", f"{r.warm_seconds:.2f}", f"{r.cache_bytes / 1024:.0f}"]
        for r in (FirstFrame(**row) for row in record["first_frames"])
    ]
    caption = (
        "Median seconds from the first line of a program, before any import, to its first image. "
        f"Frames of {size_text(record['render'])}, ratio {record['scale']:g}. {machine_name(record)}."
    )
    return table(["method", "cold cache, s:", "warm cache, s:", "cache, KiB:"], rows, caption)
