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
from itertools import product
from pathlib import Path
from typing import Any, TypeAlias

from supersampler.errors import ArgumentError
from supersampler.io.atomic import replacing
from supersampler.io.machine import machine
from supersampler.io.shot import Shot
from supersampler_bench.class_table import class_record, counts_of
from supersampler_bench.confusion import Counts
from supersampler_bench.scores import (
    BORDER,
    WARM_UP_FRAMES,
    FrameScores,
    MeanScores,
    MethodScores,
    Scores,
    Summarised,
)

Record: TypeAlias = Mapping[str, Any]
"""What a measurement leaves behind, ready for JSON or read back from it."""

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


def quality_record(measured: Sequence[Measured]) -> dict[str, Any]:
    """Return everything about a quality measurement, ready for JSON; only `date` differs from run to run.

    Args:
        measured: the shots. Of several each knows its ratio (`Measured.origin`), those of a ratio have the
            same methods, and there is a mean at each ratio.
    """
    ratios = dict.fromkeys(m.origin["ratio"] for m in measured) if len(measured) > 1 else ()
    return {
        "bench": "quality",
        "warm_up_frames": WARM_UP_FRAMES,
        "border": BORDER,
        "shots": [
            {**shot_record(m.shot), **m.origin, "methods": [_method_record(r) for r in m.methods]}
            for m in measured
        ],
        "means": [
            {"ratio": ratio, **scores_record(mean)}
            for ratio in ratios
            for mean in _means([m for m in measured if m.origin["ratio"] == ratio])
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


def machine_name(record: Record) -> str:
    """Return what a record was measured on, in a few words."""
    return f"{record['machine']['cpu']}, {record['machine']['cores']} cores"


def read_record(path: Path) -> dict[str, Any]:
    """Return a record that a bench command wrote with `--json`.

    Raises:
        ArgumentError: it is none.
    """
    try:
        record = json.loads(path.read_text(encoding="utf-8"))
        if isinstance(record["bench"], str):
            return dict(record)
    except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
        raise ArgumentError("record", got=f"{path} ({error})", want="a file of `bench ... --json`") from error
    raise ArgumentError("record", got=str(path), want="a file of `bench ... --json`")


def is_record(path: Path) -> bool:
    """Tell whether a file is a record that a bench command wrote."""
    try:
        read_record(path)
    except ArgumentError:
        return False
    return True


def write_json(record: Record, path: Path) -> None:
    """Write a record, whole or not at all; NaN becomes null, as JSON has none.

    Raises:
        ShotError: the file cannot be written.
    """
    text = json.dumps(_without_nan(record), indent=1, allow_nan=False) + "\n"
    with replacing(path) as partial:
        partial.write_text(text, encoding="utf-8", newline="\n")


def ratio_of(shot: Record) -> float:
    """Display over render size of a shot, of what `shot_record` says of it."""
    ratio: float = shot["display_size"][0] / shot["render_size"][0]
    return ratio


def shot_record(shot: Shot) -> dict[str, Any]:
    """Return what a record says of a shot, besides where its pixels are from."""
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
    return {**scores_record(result), "frames": frames}


def scores_record(scores: Summarised) -> dict[str, Any]:
    """Return the summaries of one method, as `RecordedScores` reads them."""
    ways = list(product((True, False), repeat=2))
    return {
        "method": scores.method,
        "summary": {_way(w, c): scores.summary(warm=w, cropped=c) for w, c in ways},
        "classes": {_way(w, c): class_record(scores.classes(warm=w, cropped=c)) for w, c in ways},
    }


def _way(warm: bool, cropped: bool) -> str:
    return f"{'warm' if warm else 'all'}_{'cropped' if cropped else 'full'}"


@dataclass(frozen=True)
class RecordedScores:
    """The summaries of one method; `row` is one of a record's `means`, or of the `methods` of a shot."""

    row: Record

    @property
    def method(self) -> str:
        """Its name."""
        return str(self.row["method"])

    def summary(self, *, warm: bool = True, cropped: bool = True) -> Scores:
        """See `MethodScores`."""
        return _with_nan(self.row["summary"][_way(warm, cropped)])

    def classes(self, *, warm: bool = True, cropped: bool = True) -> Counts | None:
        """See `MethodScores`."""
        return counts_of(self.row["classes"][_way(warm, cropped)])


def method_scores(row: Record) -> MethodScores:
    """Return the scores by frame, without classes, of one of the `methods` of a record's shot."""
    frames = [FrameScores(f["frame"], _with_nan(f["full"]), _with_nan(f["cropped"])) for f in row["frames"]]
    return MethodScores(row["method"], frames)


def _means(measured: Sequence[Measured]) -> list[MeanScores]:
    by_method = zip(*(m.methods for m in measured), strict=True)
    return [MeanScores(scores[0].method, list(scores)) for scores in by_method]


def _has_classes(shot: Shot) -> bool:
    return bool(shot.reference_indices) and shot.read_classes(shot.reference_indices[0]) is not None


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None  # onnxruntime, say, goes by other names too


def _with_nan(scores: Mapping[str, float | None]) -> Scores:
    return {name: math.nan if value is None else value for name, value in scores.items()}


def _without_nan(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _without_nan(item) for key, item in value.items()}
    if isinstance(value, list):
        return [_without_nan(item) for item in value]
    return None if isinstance(value, float) and math.isnan(value) else value
