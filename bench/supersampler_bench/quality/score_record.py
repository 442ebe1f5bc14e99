"""The record of a quality measurement: scores and classes of each shot and of their means."""

import hashlib
from collections.abc import Iterator, Mapping, Sequence
from itertools import product
from typing import Any, Protocol

import numpy as np

from supersampler.io.shot import Shot
from supersampler_bench.quality.confusion import Counts, class_record, counts_of
from supersampler_bench.quality.summaries import BORDER, WARM_UP_FRAMES, MethodScores, Scores
from supersampler_bench.record import Record, setting

WAYS = {
    f"{'warm' if warm else 'all'}_{'cropped' if cropped else 'full'}": {"warm": warm, "cropped": cropped}
    for warm, cropped in product((True, False), repeat=2)
}
"""Names of the four summaries: with or without the first frames, with or without the border."""


class Summarized(Protocol):
    """Scores of one method that have summaries; see `MethodScores`."""

    @property
    def method(self) -> str:
        """Name of the method."""

    def summary(self, *, warm: bool, cropped: bool) -> Scores:
        """Return each metric; NaN where it is unknown."""

    def classes(self, *, warm: bool, cropped: bool) -> Counts | None:
        """Return class counts; None where classes are unknown."""


def quality_record(shots: Sequence[Record]) -> dict[str, Any]:
    """Return all of a quality measurement, ready for JSON; only `date` and `seconds` differ from run to run.

    Args:
        shots: by `shot_scores`. If there are several, each has its ratio, those of a ratio have the same
            methods, and the record has a mean at each ratio.
    """
    means = [
        {"ratio": ratio, **mean_row(rows)}
        for ratio, group in shots_by_ratio(shots).items()
        for rows in zip(*(shot["methods"] for shot in group), strict=True)
    ]
    facts = {"warm_up_frames": WARM_UP_FRAMES, "border": BORDER}
    return {"bench": "quality", **facts, "shots": list(shots), "means": means, **setting()}


def shot_scores(shot: Shot, methods: Sequence[MethodScores], origin: Record | None = None) -> dict[str, Any]:
    """Return the part of a record about one shot; `origin` is what else is known of the shot's pixels."""
    rows = []
    for scores in methods:
        frames = [{"frame": f.frame, "full": f.full, "cropped": f.cropped} for f in scores.frames]
        rows.append({**scores_row(scores), "frames": frames})
    return {**shot_record(shot), **(origin or {}), "methods": rows}


def summaries_of(record: Record) -> dict[str, Any]:
    """Return a record by `quality_record` without the values of single frames, which are most of its size."""
    shots = [
        {**shot, "methods": [{k: v for k, v in row.items() if k != "frames"} for row in shot["methods"]]}
        for shot in record["shots"]
    ]
    return {**record, "shots": shots}


def shot_record(shot: Shot) -> dict[str, Any]:
    """Return what a record says of a shot, except where its pixels are from."""
    file = shot.path if shot.path.is_file() else shot.path / "shot.json"
    references = shot.reference_indices
    classes = shot.read_classes(references[0]) if references else None
    return {
        "name": shot.name,
        "shot_json_sha256": hashlib.sha256(file.read_bytes()).hexdigest() if file.is_file() else None,
        "frames": len(shot),
        "reference_frames": references,
        "render_size": list(shot.render_size),
        "display_size": list(shot.display_size or ()),
        "masks": "depth and motion" if classes is None else "truth classes",
    }


def scores_row(scores: Summarized) -> dict[str, Any]:
    """Return the summaries of one method, ready for JSON."""
    return {
        "method": scores.method,
        "summary": {name: scores.summary(**way) for name, way in WAYS.items()},
        "classes": {name: class_record(scores.classes(**way)) for name, way in WAYS.items()},
    }


def mean_row(rows: Sequence[Record]) -> dict[str, Any]:
    """Return the mean of one method's rows of several shots: of each metric, over the shots that have it."""
    return {
        "method": rows[0]["method"],
        "summary": {name: _mean([row["summary"][name] for row in rows]) for name in WAYS},
        "classes": {name: _sum([counts_of(row["classes"][name]) for row in rows]) for name in WAYS},
    }


def _mean(summaries: Sequence[Mapping[str, float]]) -> Scores:
    columns = {name: [s[name] for s in summaries if not np.isnan(s[name])] for name in summaries[0]}
    return {name: float(np.mean(values)) if values else float("nan") for name, values in columns.items()}


def _sum(counts: Sequence[Counts | None]) -> dict[str, Any] | None:
    known = [c for c in counts if c is not None]
    return class_record(np.sum(known, axis=0)) if known else None


def shots_by_ratio(shots: Sequence[Record]) -> dict[float, list[Record]]:
    """Return the shots of each ratio; nothing for a single shot, which has no mean."""
    groups: dict[float, list[Record]] = {}
    for shot in shots if len(shots) > 1 else ():
        groups.setdefault(shot["ratio"], []).append(shot)
    return groups


def rows_by_ratio(record: Record, rows: str) -> Iterator[dict[str, Any]]:
    """Yield a record's means, or those `rows` of its only shot, each with its ratio."""
    if record.get("means"):
        yield from record["means"]
        return
    for shot in record.get("shots", ()):
        ratio = shot["display_size"][0] / shot["render_size"][0]
        yield from ({"ratio": ratio, **row} for row in shot[rows])
