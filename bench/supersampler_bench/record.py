"""What a measurement leaves behind: one JSON file with the values, and all that they depend on."""

import hashlib
import json
import math
import os
import platform
import sys
from collections.abc import Sequence
from dataclasses import asdict
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from supersampler.image_io import replacing
from supersampler.shot import Shot
from supersampler_bench.quality import BORDER, WARM_UP_FRAMES, MethodScores

_PACKAGES = ("supersampler", "numpy", "onnxruntime", "flip-evaluator")


def quality_record(shot: Shot, results: Sequence[MethodScores]) -> dict[str, Any]:
    """Return everything about a quality measurement, ready for JSON; only `date` differs from run to run."""
    return {
        "bench": "quality",
        "shot": _shot_record(shot),
        "warm_up_frames": WARM_UP_FRAMES,
        "border": BORDER,
        "methods": [_method_record(result) for result in results],
        "versions": {"python": platform.python_version(), **{name: _version(name) for name in _PACKAGES}},
        "machine": machine(),
        "command": ["supersampler", *sys.argv[1:]],
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
    }


def machine() -> dict[str, Any]:
    """Return the CPU's model, its logical cores and the operating system."""
    return {"cpu": _cpu_model(), "cores": os.cpu_count(), "os": platform.platform()}


def write_json(record: dict[str, Any], path: Path) -> None:
    """Write a record, whole or not at all; NaN becomes null, as JSON has none.

    Raises:
        ShotError: the file cannot be written.
    """
    text = json.dumps(_without_nan(record), indent=1, allow_nan=False) + "\n"
    with replacing(path) as partial:
        partial.write_text(text, encoding="utf-8", newline="\n")


def _shot_record(shot: Shot) -> dict[str, Any]:
    file = shot.path / "shot.json"
    return {
        "name": shot.name,
        "shot_json_sha256": hashlib.sha256(file.read_bytes()).hexdigest() if file.is_file() else None,
        "frames": len(shot),
        "reference_frames": shot.reference_indices,
        "render_size": list(shot.render_size),
        "display_size": list(shot.display_size or ()),
    }


def _method_record(result: MethodScores) -> dict[str, Any]:
    summaries = {
        f"{frames}_{area}": result.summary(warm=frames == "warm", cropped=area == "cropped")
        for frames in ("warm", "all")
        for area in ("cropped", "full")
    }
    return {"method": result.method, "summary": summaries, "frames": [asdict(f) for f in result.frames]}


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None  # onnxruntime, say, goes by other names too


def _cpu_model() -> str:
    """Return the model's name where the system tells it, else the architecture."""
    info = Path("/proc/cpuinfo")
    if info.is_file():
        for line in info.read_text(encoding="utf-8", errors="replace").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()


def _without_nan(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _without_nan(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_without_nan(item) for item in value]
    return None if isinstance(value, float) and math.isnan(value) else value
