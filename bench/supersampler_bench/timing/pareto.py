"""Run time against error: settings that no other beats in both, and presets.

Errors come from records of `bench quality`, which any machine measures alike, or from a Pareto record that
has kept them; times are measured here.
Settings are compared at one ratio: what a ratio saves, it saves where frames are rendered.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

from supersampler.errors import ArgumentError
from supersampler.frame import Size
from supersampler.methods.model_file import model_names
from supersampler_bench.compatibility import gbuffers_of
from supersampler_bench.quality.score_record import ratio_of
from supersampler_bench.record import Record, machine_name
from supersampler_bench.specs import Spec, parse_spec
from supersampler_bench.timing.speed import Setting, measure_settings

SPATIAL = ("bilinear", "bicubic")
PRESET_RATIO = 2.0
CLEARLY, HARDLY = 1.0, 0.05  # dB: what a preset must gain over no history, and what no preset pays time for


@dataclass(frozen=True)
class Metric:
    """An error or a quality of images.

    Attributes:
        name: in a quality record.
        heading: for people.
        digits: after the point.
        scale: what it is shown times.
        higher: whether more is better.
    """

    name: str
    heading: str
    digits: int
    scale: float = 1.0
    higher: bool = True


METRICS = (
    Metric("psnr", "PSNR dB", 2),
    Metric("ssim", "SSIM", 4),
    Metric("flip", "FLIP", 4, higher=False),
    Metric("tpsnr", "tPSNR dB", 2),
    Metric("warped_error_difference", "warped error 1e-3", 2, 1e3, higher=False),
    Metric("strred", "STRRED", 1, higher=False),
)


@dataclass(frozen=True)
class Point:
    """One setting at one ratio.

    Attributes:
        spec: method, precision and skipping.
        runs: executor and precision that it came to.
        ratio: display over render size.
        milliseconds: median wall time of a step.
        scores: by the metric's name, mean over the test shots.
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
    on_ratio: Callable[[float], None] = lambda _: None,
    on_left_out: Callable[[str], None] = lambda _: None,
) -> list[Point]:
    """Time all settings that quality records have scores of, on this machine.

    Args:
        records: of `bench quality --json` or `bench pareto --json`, of the same shots.
        display: (width, height) of the images that are timed.
        threads: of the processor.
        steps: that count, of each setting.
        on_ratio: called before the settings of a ratio.
        on_left_out: called with the name of a method that does not run at that size and ratio, and why.

    Raises:
        ArgumentError: a record has no scores of shots, or is of other shots than the first.
    """
    points = []
    for ratio, scores in scores_of(records).items():
        on_ratio(ratio)
        wanted = {
            spec: Setting(spec.model, display, "auto", threads, spec.precision, spec.skip) for spec in scores
        }
        settings = list(wanted.values())
        found = measure_settings(settings, ratio=ratio, steps=steps, on_left_out=on_left_out)
        timed = {t.setting: t for t in found}
        for spec, setting in wanted.items():
            if setting not in timed:
                continue
            t = timed[setting]
            points.append(Point(spec, f"{t.executor}, {t.precision}", ratio, t.median, scores[spec]))
    return points


def scores_of(records: Sequence[Record]) -> dict[float, dict[Spec, dict[str, float]]]:
    """Scores by ratio and setting, without the warm-up and a border: means, or those of the only shot.

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
                m.name: known[m.name] for m in METRICS if not math.isnan(known.get(m.name, math.nan))
            }
    return dict(sorted(found.items()))


def _scores(record: Record) -> Iterator[tuple[float, Spec, Mapping[str, float | None]]]:
    """Yield ratio, setting and scores of all that a record has."""
    if record["bench"] == "pareto":
        yield from ((point.ratio, point.spec, point.scores) for point in points_of(record))
        return
    for row in record.get("means") or _of_only_shot(record):
        yield row["ratio"], parse_spec(row["method"]), row["summary"]["warm_cropped"]


def _of_only_shot(record: Record) -> Iterator[dict[str, Any]]:
    for shot in record.get("shots", ()):
        yield from ({"ratio": ratio_of(shot), **method} for method in shot["methods"])


def frontier(points: Sequence[Point], metric: Metric) -> list[Point]:
    """Those that none beats in time and error, the fastest first; of one ratio."""
    sign = 1.0 if metric.higher else -1.0
    known = [p for p in points if metric.name in p.scores]
    found: list[Point] = []
    for point in sorted(known, key=lambda p: (p.milliseconds, -sign * p.scores[metric.name])):
        if not found or sign * (point.scores[metric.name] - found[-1].scores[metric.name]) > 0.0:
            found.append(point)
    return found


def presets(points: Sequence[Point]) -> dict[str, Spec]:
    """Choose "fast", "balanced" and "high" from the frontier of time and PSNR, at one ratio.

    fast: the fastest that is `CLEARLY` better than images without a history. high: the fastest that is
    within `HARDLY` of the best; it computes every pixel. balanced: of those between, the one that gains most
    over fast for each millisecond more; high where there is none. What skips by default is looked at alone:
    what skipping saves, shots in motion do not show. Methods that read G-buffers are left out: not all frames
    have them.
    """
    psnr, with_default_gbuffers = METRICS[0], {name for name in model_names() if gbuffers_of([name])}
    for_all = [p for p in points if p.spec.model not in with_default_gbuffers]
    line = frontier([p for p in for_all if p.spec.skip == "auto"], psnr)
    floor = max(p.scores["psnr"] for p in points if p.spec.model in SPATIAL)
    good = [p for p in line if p.scores["psnr"] >= floor + CLEARLY] or line[-1:]
    best = max(p.scores["psnr"] for p in line)
    fast = good[0]
    high = next(p for p in line if p.scores["psnr"] >= best - HARDLY)
    between = [p for p in good if fast.milliseconds < p.milliseconds < high.milliseconds]
    balanced = max(between, key=lambda p: _gain(p, fast), default=high)
    exact = replace(high.spec, skip="exact")
    return {"fast": fast.spec, "balanced": exact if balanced is high else balanced.spec, "high": exact}


def _gain(point: Point, fast: Point) -> float:
    return (point.scores["psnr"] - fast.scores["psnr"]) / (point.milliseconds - fast.milliseconds)


def best_within(points: Sequence[Point], budget: float) -> list[Point]:
    """Return the settings of highest PSNR whose step takes at most `budget` milliseconds, at each ratio.

    Where the best one reads G-buffers, the best that reads none follows it.
    """
    found = []
    for group in by_ratio(points).values():
        fast_enough = sorted(
            (p for p in group if p.milliseconds <= budget), key=lambda p: p.scores["psnr"], reverse=True
        )
        for point in fast_enough:
            found.append(point)
            if not gbuffers_of([point.spec.model]):
                break
    return found


def by_ratio(points: Sequence[Point]) -> dict[float, list[Point]]:
    """Points of each ratio."""
    return {ratio: [p for p in points if p.ratio == ratio] for ratio in sorted({p.ratio for p in points})}


def pareto_record(
    points: Sequence[Point], shots: Sequence[str], display: Size, threads: int
) -> dict[str, Any]:
    """Return all values, ready for JSON.

    Args:
        points: by `measure_pareto`.
        shots: names of those that were scored.
        display: (width, height) of the images that were timed.
        threads: of the processor.
    """
    return {
        "bench": "pareto",
        "shots": list(shots),
        "display": list(display),
        "threads": threads,
        "points": [{**asdict(point), "spec": str(point.spec)} for point in points],
    }


def shots_of(record: Record) -> list[str]:
    """Names of the shots that a record is of."""
    if record.get("bench") == "pareto":
        return list(record["shots"])
    return list(dict.fromkeys(shot["name"] for shot in record.get("shots", ())))


def points_of(record: Record) -> list[Point]:
    """Points of a record by `pareto_record`."""
    return [Point(**{**row, "spec": parse_spec(row["spec"])}) for row in record["points"]]


def markdown_table(record: Record) -> str:
    """Return the table of a record as Markdown, with its caption; bold is what is on a metric's frontier."""
    points, (width, height), shots = points_of(record), record["display"], record["shots"]
    metrics = [m for m in METRICS if any(m.name in p.scores for p in points)]
    rows = [
        f"| ratio | setting | runs | ms | {' | '.join(m.heading for m in metrics)} |",
        f"| ---: | --- | --- | ---: | {' | '.join('---:' for _ in metrics)} |",
    ]
    for ratio, group in by_ratio(points).items():
        lines = {m.name: frontier(group, m) for m in metrics}
        for point in sorted(group, key=lambda p: p.milliseconds):
            cells = [_cell(point, m, point in lines[m.name]) for m in metrics]
            head = f"{ratio:g} | {point.spec} | {point.runs} | {point.milliseconds:.1f}"
            rows.append(f"| {head} | {' | '.join(cells)} |")
    scores = f"scores of {shots[0]}" if len(shots) == 1 else "mean scores of the test shots"
    caption = (
        f"Time of a step to {width}x{height} on {record['threads']} threads ({machine_name(record)}), and "
        f"{scores}. Bold: no other setting at that ratio is both faster and better."
    )
    return "\n".join([*rows, "", caption])


def _cell(point: Point, metric: Metric, leads: bool) -> str:
    if metric.name not in point.scores:
        return "–"
    text = f"{metric.scale * point.scores[metric.name]:.{metric.digits}f}"
    return f"**{text}**" if leads else text


def preset_table(record: Record) -> str:
    """Return the presets that follow from a record, as Markdown."""
    chosen = presets(at_ratio(points_of(record), PRESET_RATIO))
    return "\n".join(
        ["| preset | setting |", "| --- | --- |", *(f"| {n} | {s} |" for n, s in chosen.items())]
    )


def at_ratio(points: Sequence[Point], ratio: float) -> list[Point]:
    """Points of the ratio that is nearest."""
    groups = by_ratio(points)
    return groups[min(groups, key=lambda known: abs(known - ratio))]
