"""Run time against error: settings that no other beats in both, and presets.

Errors come from records of `bench quality`, which do not depend on the machine, or from an earlier Pareto
record; times are measured here. Settings are compared at one ratio, because a ratio saves time in the
renderer, not in the upscaler.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import TYPE_CHECKING, Any

from supersampler.errors import ArgumentError, ModelError
from supersampler.frame import Size
from supersampler.methods.model_file import find_model, model_names, read_model_info
from supersampler_bench.compatibility import gbuffers_of
from supersampler_bench.markdown_table import size_text, table
from supersampler_bench.quality.score_record import rows_by_ratio
from supersampler_bench.quality.score_table import CLIP_COLUMNS, Column
from supersampler_bench.record import Record, machine_name
from supersampler_bench.specs import Spec, parse_spec
from supersampler_bench.timing.latency import Setting, measure_settings
from supersampler_bench.timing.two_passes import measure_passes

if TYPE_CHECKING:
    from supersampler_bench.timing.pareto_extrapolated import UnshadedPoint

SPATIAL = ("bilinear", "bicubic")
PRESET_RATIO = 2.0
PRESET_RATIOS = 1.0, 3.0
"""Least and largest ratio that a method of a preset must serve."""
LEAST_GAIN, NEGLIGIBLE_GAIN = 1.0, 0.05  # dB: of a preset over no history; not worth any time


@dataclass(frozen=True)
class Point:
    """One setting at one ratio.

    Attributes:
        spec: method, precision, and what it does at rest.
        runs: executor and precision that were chosen.
        ratio: display over render size.
        milliseconds: median wall time of a step; for two passes, of a frame: that of a step, times the ratio
            of runs of two passes to runs of one.
        scores: by the name of a column, mean over the test shots.
    """

    spec: Spec
    runs: str
    ratio: float
    milliseconds: float
    scores: Mapping[str, float]


def measure_pareto(
    records: Sequence[Record],
    display: Size,
    *,
    threads: int,
    steps: int = 20,
    on_left_out: Callable[[str], None] = lambda _: None,
    on_round: Callable[[], None] = lambda: None,
) -> list[Point]:
    """Time all settings that quality records have scores of, on this machine.

    Two passes are timed where the records have scores of one pass of the same setting.

    Args:
        records: of `bench quality --json` or `bench pareto --json`, of the same shots.
        display: (width, height) of the images that are timed.
        threads: on the CPU.
        steps: that count, of each setting.
        on_left_out: called with the reason why a method is left out: no such model, or another ratio.
        on_round: called 2 x `steps` times for each ratio of `scores_of`.

    Raises:
        ArgumentError: a record has no scores of shots, or is of other shots than the first.
    """
    points, scored = [], scores_of(records)
    missing = dict(_missing(spec.model for scores in scored.values() for spec in scores))
    for model, reason in missing.items():
        on_left_out(f"{model} is left out: {reason}")
    for ratio, scores in scored.items():
        setting_of = {
            spec: Setting(spec.model, display, "auto", threads, spec.precision)
            for spec in scores
            if spec.passes == 1 and spec.model not in missing
        }
        settings = list(dict.fromkeys(setting_of.values()))
        found = measure_settings(
            settings, ratio=ratio, steps=steps, on_left_out=on_left_out, on_round=on_round
        )
        timed = {t.setting: t for t in found}
        for spec in scores:
            setting = setting_of.get(replace(spec, passes=1))
            if setting is not None and (t := timed.get(setting)) is not None:
                factor = 1.0
                if spec.passes == 2:
                    factor = measure_passes(spec, display, ratio=ratio, threads=threads).ratio
                runs = f"{t.executor}, {t.precision}"
                points.append(Point(spec, runs, ratio, t.median * factor, scores[spec]))
    return points


def _missing(models: Iterable[str]) -> Iterator[tuple[str, ModelError]]:
    """Yield the models that are not there, each once, and why: a record may be of a model folder."""
    for model in dict.fromkeys(models):
        try:
            find_model(model)
        except ModelError as error:
            yield model, error


def scores_of(records: Sequence[Record]) -> dict[float, dict[Spec, dict[str, float]]]:
    """Return scores by ratio and setting, without warm-up and border: means, or those of the only shot.

    Raises:
        ArgumentError: a record has no scores of shots, or is of other shots than the first.
    """
    found: dict[float, dict[Spec, dict[str, float]]] = {}
    for record in records:
        scores = list(_scores(record))
        if not scores or shots_of(record) != shots_of(records[0]):
            got = f"of bench {record.get('bench')!r}, shots {', '.join(shots_of(record)) or 'none'}"
            want = "of `bench quality test-shots --json` or `bench pareto --json`, all of the same shots"
            raise ArgumentError("record", got=got, want=want)
        for ratio, spec, summary in scores:
            known = {name: score for name, score in summary.items() if score is not None}
            found.setdefault(ratio, {})[spec] = {
                c.name: known[c.name] for c in CLIP_COLUMNS if not math.isnan(known.get(c.name, math.nan))
            }
    return dict(sorted(found.items()))


def _scores(record: Record) -> Iterator[tuple[float, Spec, Mapping[str, float | None]]]:
    """Yield ratio, setting and scores of all that a record has."""
    if record["bench"] == "pareto":
        yield from ((point.ratio, point.spec, point.scores) for point in points_of(record))
        return
    for row in rows_by_ratio(record, "methods"):
        yield row["ratio"], parse_spec(row["method"], two_passes=True), row["summary"]["warm_cropped"]


def frontier(points: Sequence[Point], metric: Column) -> list[Point]:
    """Return the points of one ratio that no other beats in both time and error, the fastest first."""
    sign = 1.0 if metric.higher else -1.0
    known = [p for p in points if metric.name in p.scores]
    found: list[Point] = []
    for point in sorted(known, key=lambda p: (p.milliseconds, -sign * p.scores[metric.name])):
        if not found or sign * (point.scores[metric.name] - found[-1].scores[metric.name]) > 0.0:
            found.append(point)
    return found


def presets(points: Sequence[Point]) -> dict[str, Spec]:
    """Choose "fast", "balanced" and "high" from the frontier of time and PSNR, at one ratio.

    fast: the fastest that is better by `LEAST_GAIN` than images without a history.
    high: the fastest within `NEGLIGIBLE_GAIN` of the best.
    balanced: of those between, the one that gains most over fast per additional millisecond; else high.

    Only settings with the default `at_rest` compete, because shots in motion do not show what it gains.
    Methods that read G-buffers are left out, because not all frames have them, those that do not serve
    PRESET_RATIOS, because a preset is for any ratio, and two passes, because a live view has no later frames.
    """
    special = {name for name in model_names() if gbuffers_of([name]) or not _serves_presets(name)}
    live = [p for p in points if p.spec.model not in special and p.spec.passes == 1]
    line = frontier([p for p in live if p.spec.at_rest == "converge"], CLIP_COLUMNS[0])
    floor = max(p.scores["psnr"] for p in points if p.spec.model in SPATIAL)
    good = [p for p in line if p.scores["psnr"] >= floor + LEAST_GAIN] or line[-1:]
    best = max(p.scores["psnr"] for p in line)
    fast = good[0]
    high = next(p for p in line if p.scores["psnr"] >= best - NEGLIGIBLE_GAIN)
    between = [p for p in good if fast.milliseconds < p.milliseconds < high.milliseconds]
    balanced = max(between, key=lambda p: _gain(p, fast), default=high)
    return {"fast": fast.spec, "balanced": balanced.spec, "high": high.spec}


def _serves_presets(model: str) -> bool:
    least, most = read_model_info(find_model(model)).ratios
    return least <= PRESET_RATIOS[0] and most >= PRESET_RATIOS[1]


def _gain(point: Point, fast: Point) -> float:
    return (point.scores["psnr"] - fast.scores["psnr"]) / (point.milliseconds - fast.milliseconds)


def best_within(points: Sequence[Point], budget: float) -> list[Point]:
    """Return the settings of highest PSNR whose step takes at most `budget` milliseconds, at each ratio.

    Where the best one reads G-buffers, the best that reads none follows it. Two passes are no step.
    """
    found = []
    for group in by_ratio(points).values():
        steps = (p for p in group if p.milliseconds <= budget and p.spec.passes == 1)
        fast_enough = sorted(steps, key=lambda p: p.scores["psnr"], reverse=True)
        for point in fast_enough:
            found.append(point)
            if not gbuffers_of([point.spec.model]):
                break
    return found


def by_ratio(points: Sequence[Point]) -> dict[float, list[Point]]:
    """Return the points of each ratio."""
    return {ratio: [p for p in points if p.ratio == ratio] for ratio in sorted({p.ratio for p in points})}


def at_ratio(points: Sequence[Point], ratio: float) -> list[Point]:
    """Return the points of the nearest ratio."""
    groups = by_ratio(points)
    return groups[min(groups, key=lambda known: abs(known - ratio))]


def pareto_record(
    points: Sequence[Point],
    shots: Sequence[str],
    display: Size,
    threads: int,
    unshaded: Sequence["UnshadedPoint"] = (),
) -> dict[str, Any]:
    """Return all values, ready for JSON.

    Args:
        points: by `measure_pareto`.
        shots: names of those that were scored.
        display: (width, height) of the images that were timed.
        threads: on the CPU.
        unshaded: by `measure_unshaded`.
    """
    rows = [{**asdict(point), "spec": str(point.spec)} for point in points]
    facts = {"shots": list(shots), "display": list(display), "threads": threads}
    return {"bench": "pareto", **facts, "points": rows, "unshaded": [asdict(point) for point in unshaded]}


def shots_of(record: Record) -> list[str]:
    """Return the names of a record's shots."""
    if record.get("bench") == "pareto":
        return list(record["shots"])
    return list(dict.fromkeys(shot["name"] for shot in record.get("shots", ())))


def points_of(record: Record) -> list[Point]:
    """Return the points of a record by `pareto_record`."""
    return [Point(**{**row, "spec": parse_spec(row["spec"], two_passes=True)}) for row in record["points"]]


def markdown_table(record: Record) -> str:
    """Return the table of a record as Markdown, with its caption; bold figures are on their frontier."""
    points, shots = points_of(record), record["shots"]
    columns = [c for c in CLIP_COLUMNS if any(c.name in p.scores for p in points)]
    rows = []
    for ratio, group in by_ratio(points).items():
        lines = {c.name: frontier(group, c) for c in columns}
        for point in sorted(group, key=lambda p: p.milliseconds):
            figures = [(c.figure(point.scores), point in lines[c.name]) for c in columns]
            cells = [f"**{text}**" if leads else text for text, leads in figures]
            rows.append([f"{ratio:g}", point.spec, point.runs, f"{point.milliseconds:.1f}", *cells])
    scores = f"scores of {shots[0]}" if len(shots) == 1 else "mean scores of the test shots"
    size = size_text(record["display"])
    caption = (
        f"Time of a step to {size} on {record['threads']} threads ({machine_name(record)}), and "
        f"{scores}. Bold: no other setting at that ratio is both faster and better."
    )
    headings = ["ratio:", "setting", "runs", "ms:", *(f"{c.title}:" for c in columns)]
    return table(headings, rows, caption)


def preset_table(record: Record) -> str:
    """Return the presets that follow from a record, as Markdown."""
    return table(["preset", "setting"], presets(at_ratio(points_of(record), PRESET_RATIO)).items())
