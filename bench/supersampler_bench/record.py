"""What a measurement leaves behind: one JSON file with the values, and all that they depend on."""

import hashlib
import json
import math
import platform
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from supersampler.files import replacing
from supersampler.machine import machine
from supersampler.shot import Shot
from supersampler_bench.class_table import class_record
from supersampler_bench.scores import BORDER, WARM_UP_FRAMES, MeanScores, MethodScores

_PACKAGES = ("supersampler", "numpy", "onnxruntime", "flip-evaluator", "cvvdp")


@dataclass(frozen=True)
class Measured:
    """The scores of all methods on one shot.

    Attributes:
        shot: what was measured on.
        methods: their scores.
        origin: what else is known of the shot's pixels, ready for JSON.
    """

    shot: Shot
    methods: list[MethodScores]
    origin: dict[str, Any] = field(default_factory=dict)


def quality_record(
    measured: Sequence[Measured], means: Mapping[float, Sequence[MeanScores]] | None = None
) -> dict[str, Any]:
    """Return everything about a quality measurement, ready for JSON; only `date` differs from run to run.

    Args:
        measured: each shot.
        means: over the shots of each ratio, where there are several.
    """
    return {
        "bench": "quality",
        "warm_up_frames": WARM_UP_FRAMES,
        "border": BORDER,
        "shots": [
            {**_shot_record(m.shot), **m.origin, "methods": [_method_record(r) for r in m.methods]}
            for m in measured
        ],
        "means": [
            {"ratio": ratio, **_scores_record(mean)}
            for ratio, of_ratio in (means or {}).items()
            for mean in of_ratio
        ],
        **setting(),
    }


def setting() -> dict[str, Any]:
    """Return what any measurement depends on besides what it measures, and its date."""
    return {
        "versions": {"python": platform.python_version(), **{name: _version(name) for name in _PACKAGES}},
        "machine": machine(),
        "command": ["supersampler", *sys.argv[1:]],
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
    }


def write_json(record: dict[str, Any], path: Path) -> None:
    """Write a record, whole or not at all; NaN becomes null, as JSON has none.

    Raises:
        ShotError: the file cannot be written.
    """
    text = json.dumps(_without_nan(record), indent=1, allow_nan=False) + "\n"
    with replacing(path) as partial:
        partial.write_text(text, encoding="utf-8", newline="\n")


def _shot_record(shot: Shot) -> dict[str, Any]:
    file = shot.path if shot.path.is_file() else shot.path / "shot.json"
    return {
        "name": shot.name,
        "shot_json_sha256": hashlib.sha256(file.read_bytes()).hexdigest() if file.is_file() else None,
        "frames": len(shot),
        "reference_frames": shot.reference_indices,
        "render_size": list(shot.render_size),
        "display_size": list(shot.display_size or ()),
        "masks": "truth classes" if _has_classes(shot) else "depth and motion",
    }


def _method_record(result: MethodScores) -> dict[str, Any]:
    frames = [{"frame": f.frame, "full": f.full, "cropped": f.cropped} for f in result.frames]
    return {**_scores_record(result), "frames": frames}


def _scores_record(scores: MethodScores | MeanScores) -> dict[str, Any]:
    ways = {
        f"{frames}_{area}": {"warm": frames == "warm", "cropped": area == "cropped"}
        for frames in ("warm", "all")
        for area in ("cropped", "full")
    }
    return {
        "method": scores.method,
        "summary": {name: scores.summary(**way) for name, way in ways.items()},
        "classes": {name: class_record(scores.classes(**way)) for name, way in ways.items()},
    }


def _has_classes(shot: Shot) -> bool:
    return bool(shot.reference_indices) and shot.read_classes(shot.reference_indices[0]) is not None


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None  # onnxruntime, say, goes by other names too


def _without_nan(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _without_nan(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_without_nan(item) for item in value]
    return None if isinstance(value, float) and math.isnan(value) else value
