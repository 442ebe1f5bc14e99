"""How long the first picture takes: where a method was never used, and in each process after that."""

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

Its gray frame is made, not read: an engine has its frames in memory.
"""


@dataclass(frozen=True)
class Started:
    """Seconds from a process's first line, before it imports anything, to the first picture; medians.

    Attributes:
        method: the model's name.
        fresh: where no kernels are kept.
        later: where they are.
        kept: bytes of the kernels.
    """

    method: str
    fresh: float
    later: float
    kept: int


def measure_start(
    methods: Sequence[str],
    render: Size,
    *,
    scale: float = 2.0,
    fresh: int = 3,
    later: int = 5,
    on_start: Callable[[], None] = lambda: None,
) -> list[Started]:
    """Start processes, one after the other; each of the fresh ones has an empty folder to keep kernels in.

    Args:
        methods: names of shipped models or model folders that read no G-buffers.
        render: (width, height) of the frame.
        scale: display over render size.
        fresh: processes for each method that begin with nothing kept.
        later: processes after one of those.
        on_start: called after each.
    """
    results = []
    for method in methods:
        command = [sys.executable, "-c", FIRST_IMAGE, method, *map(str, render), str(scale)]
        first, others, kept = [], [], 0
        for index in range(fresh):
            with TemporaryDirectory() as cache:
                first.append(_seconds(command, cache))
                on_start()
                kept = sum(path.stat().st_size for path in Path(cache).rglob("*") if path.is_file())
                for _ in range(later if index == fresh - 1 else 0):
                    others.append(_seconds(command, cache))
                    on_start()
        results.append(Started(method, median(first), median(others), kept))
    return results


def _seconds(command: Sequence[str], cache: str) -> float:
    environment = {**os.environ, "XDG_CACHE_HOME": cache}
    done = subprocess.run(  # noqa: S603  # ourselves
        command, check=True, capture_output=True, text=True, env=environment
    )
    return float(done.stdout)


def start_record(results: Sequence[Started], render: Size, scale: float) -> dict[str, Any]:
    """Return all values, ready for JSON."""
    return {
        "bench": "startup",
        "render": list(render),
        "scale": scale,
        "started": [asdict(result) for result in results],
    }


def markdown_table(record: Record) -> str:
    """Return the table of a record as Markdown, with its caption."""
    width, height = record["render"]
    rows = [
        "| method | first time, s | later, s | kernels kept, KiB |",
        "| --- | ---: | ---: | ---: |",
        *(
            f"| {r.method} | {r.fresh:.1f} | {r.later:.2f} | {r.kept / 1024:.0f} |"
            for r in (Started(**row) for row in record["started"])
        ),
        "",
        "Seconds from the first line of a program, before it imports anything, to its first picture. "
        f"Medians. Frames of {width}x{height}, ratio {record['scale']:g}. {machine_name(record)}.",
    ]
    return "\n".join(rows)
