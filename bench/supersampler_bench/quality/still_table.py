"""Records of `bench still`, and their tables."""

from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

from supersampler.frame import Size
from supersampler_bench.markdown_table import figure, size_text, table
from supersampler_bench.quality.still import PERIODS, TIMED_RATIO, TIMED_SCENE, StillScores, StillTimes
from supersampler_bench.record import Record, machine_name

_RATIO = 2.0
"""Summary and figure show the ratio of a record that is closest to this."""


def still_record(
    results: Sequence[StillScores],
    display: Size,
    times: Sequence[StillTimes],
    timed_display: Size,
    *,
    quick: bool = False,
) -> dict[str, Any]:
    """Return all values, ready for JSON."""
    return {
        "bench": "still",
        "display": list(display),
        "quick": quick,
        "scores": [asdict(result) for result in results],
        "timed_display": list(timed_display),
        "times": [asdict(time) for time in times],
    }


def scores_of(record: Record) -> list[StillScores]:
    """Return the scores of a record."""
    return [StillScores(**row) for row in record["scores"]]


def scores_at_one_ratio(record: Record) -> list[StillScores]:
    """Return the scores of a record at the ratio that summary and figure show."""
    scores = scores_of(record)
    ratio = min((score.ratio for score in scores), key=lambda value: abs(value - _RATIO))
    return [score for score in scores if score.ratio == ratio]


def markdown_table(record: Record) -> str:
    """Return the table of a record as Markdown, with its caption."""
    rows = [
        [
            score.scene,
            f"{score.ratio:g}",
            score.method,
            score.executor,
            figure(100.0 * score.scored, 0, " %"),
            *(figure(score.after(count), 1) for count in PERIODS),
            figure(score.flicker, 4),
        ]
        for score in scores_of(record)
    ]
    headings = [
        "scene", "ratio:", "method", "backend", "pixels:", *(f"PSNR dB, {count}:" for count in PERIODS),
        "flicker:",
    ]  # fmt: skip
    caption = (
        f"Images of {size_text(record['display'])}, of the part of the pixels that never change: PSNR after "
        "1, 2 and 4 jitter periods; "
        f"flicker within the last period. {machine_name(record)}."
    )
    return table(headings, rows, caption)


def summary_table(record: Record) -> str:
    """Return a row for each method and backend, of all scenes at one ratio, as Markdown with its caption."""
    shown = scores_at_one_ratio(record)
    scenes = list(dict.fromkeys(score.scene for score in shown))
    times = {(row["method"], "cpu"): StillTimes(**row) for row in record["times"]}
    rows = []
    for method, executor in dict.fromkeys((score.method, score.executor) for score in shown):
        first, *others = [s for s in shown if (s.method, s.executor) == (method, executor)]
        timed = times.get((method, executor))  # the ONNX backend computes full steps
        rows.append(
            [
                method,
                executor,
                *(figure(first.after(count), 1) for count in PERIODS),
                *(figure(score.after(PERIODS[-1]), 1) for score in others),
                figure(timed.settling if timed else 1.0, 2),
                figure(timed.rest if timed else 1.0, 2),
            ]
        )
    headings = [
        "method", "backend",
        *(f"{scenes[0]}, {count} period{'s' * (count > 1)}:" for count in PERIODS),
        *(f"{scene}, {PERIODS[-1]}:" for scene in scenes[1:]),
        "time, settling:", "time, at rest:",
    ]  # fmt: skip
    caption = (
        f"PSNR, dB, after jitter periods at ratio {shown[0].ratio:g}, of pixels that never change; images of "
        f"{size_text(record['display'])}. Time of a frame in the second period and in the fourth, as a "
        f"share of the method's full step: {TIMED_SCENE} at ratio {TIMED_RATIO:g}, images of "
        f"{size_text(record['timed_display'])}. {machine_name(record)}."
    )
    return table(headings, rows, caption)
