"""First-frame time: from the start of a process to its first image, with a cold and a warm kernel cache."""

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
from supersampler_bench.specs import parse_spec
from supersampler_bench.timing.child_process import FIRST_IMAGE, Version


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
