"""The record of a quality measurement: scores and classes of each shot and of their means."""

import hashlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product
from typing import Any

from supersampler.io.shot import Shot
from supersampler_bench.quality.class_table import class_record, counts_of
from supersampler_bench.quality.confusion import Counts
from supersampler_bench.quality.summaries import (
    BORDER,
    WARM_UP_FRAMES,
    FrameScores,
    MeanScores,
    MethodScores,
    Scores,
    Summarized,
)
from supersampler_bench.record import Record, setting


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


def scores_record(scores: Summarized) -> dict[str, Any]:
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


def _with_nan(scores: Mapping[str, float | None]) -> Scores:
    return {name: math.nan if value is None else value for name, value in scores.items()}
