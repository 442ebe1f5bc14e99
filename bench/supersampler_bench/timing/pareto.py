"""Run time against error: settings that no other beats in both, and presets.

Errors come from records of `bench quality`, which do not depend on the machine, or from an earlier Pareto
record; times are measured here. Settings are compared at one ratio, because a larger ratio saves time in the
renderer, not in the upscaler.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

from supersampler.cli.arguments import size_text
from supersampler.errors import ArgumentError, ModelError
from supersampler.frame import Size
from supersampler.methods.model_file import find_model, model_names, read_model_info
from supersampler_bench.quality.score_table import CLIP_COLUMNS, Column, QualityRecord
from supersampler_bench.record import BenchRecord, table
from supersampler_bench.specs import Spec, gbuffers_of, parse_spec
from supersampler_bench.timing.latency import Setting, measure_settings

SPATIAL = ("bilinear", "bicubic")
PRESET_RATIO = 2.0
PRESET_RATIOS = 1.0, 3.0
"""Smallest and largest ratio that a method of a preset must support."""
MIN_GAIN = 1.0
"""Minimum PSNR gain of a preset over spatial methods, dB."""
NEGLIGIBLE_GAIN = 0.05
"""PSNR gain, dB, that is not worth any time."""


@dataclass(frozen=True)
class ParetoPoint:
    """One setting at one ratio."""

    spec: str  # see `parse_spec`
    runs: str  # executor and precision
    ratio: float
    milliseconds: float  # median wall time of a step
    scores: Mapping[str, float]  # by the name of a column, means over the test shots

    @property
    def run(self) -> Spec:
        """The spec, parsed."""
        return parse_spec(self.spec)


def measure_pareto(
    records: Sequence[BenchRecord],
    display: Size,
    *,
    threads: int,
    steps: int = 20,
    on_left_out: Callable[[str], None] = lambda _: None,
    on_round: Callable[[], None] = lambda: None,
) -> list[ParetoPoint]:
    """Time `steps` steps of each setting that records of the same shots score.

    `on_round` is called 2 x `steps` times for each ratio of `scores_of`.
    """
    points, scored = [], scores_of(records)
    missing = set()
    for model in dict.fromkeys(spec.model for scores in scored.values() for spec in scores):
        try:
            find_model(model)
        except ModelError as error:  # a record may name a model folder
            missing.add(model)
            on_left_out(f"{model} is left out: {error}")
    for ratio, scores in scored.items():
        setting_of = {
            spec: Setting(spec.model, display, spec.executor, threads, spec.precision, spec.at_rest)
            for spec in scores
            if spec.model not in missing
        }
        settings = list(dict.fromkeys(setting_of.values()))
        latencies = measure_settings(
            settings, ratio=ratio, steps=steps, on_left_out=on_left_out, on_round=on_round
        )
        timed = {t.setting: t for t in latencies}
        for spec, setting in setting_of.items():
            if (t := timed.get(setting)) is not None:
                runs = f"{t.executor}, {t.precision}"
                points.append(ParetoPoint(str(spec), runs, ratio, t.median, scores[spec]))
    return points


def scores_of(records: Sequence[BenchRecord]) -> dict[float, dict[Spec, dict[str, float]]]:
    """Return scores by ratio and setting, without warm-up and border: means, or the scores of the only shot.

    Raises:
        ArgumentError: a record has no PSNR of shots after the warm-up, or is of other shots than the first.
    """
    found: dict[float, dict[Spec, dict[str, float]]] = {}
    for record in records:
        scores = [each for each in _scores(record) if "psnr" in each[2]]
        if not scores or shot_names(record) != shot_names(records[0]):
            got = f"of bench {record.BENCH!r}, shots {', '.join(shot_names(record)) or 'none'}"
            got += "" if scores else ", without PSNR of frames after the warm-up"
            want = "of `bench quality test-shots --json` or `bench pareto --json`, all of the same shots"
            raise ArgumentError("record", got=got, want=want)
        for ratio, spec, known in scores:
            if spec.passes > 1:  # two passes over a shot are not a real-time step
                continue
            names = (c.name for c in CLIP_COLUMNS if c.name in known)
            found.setdefault(ratio, {})[spec] = {name: known[name] for name in names}
    return dict(sorted(found.items()))


def _scores(record: BenchRecord) -> Iterator[tuple[float, Spec, Mapping[str, float]]]:
    """Yield ratio, setting and known scores of each row of a record; nothing for another bench."""
    if isinstance(record, ParetoRecord):
        yield from ((point.ratio, point.run, point.scores) for point in record.points)
    elif isinstance(record, QualityRecord):
        for ratio, row in record.rows():
            yield ratio, parse_spec(row.method, two_passes=True), row.known()


def frontier(points: Sequence[ParetoPoint], metric: Column) -> list[ParetoPoint]:
    """Return the points of one ratio that no other beats in both time and error, the fastest first."""
    sign = 1.0 if metric.higher else -1.0
    known = [p for p in points if metric.name in p.scores]
    found: list[ParetoPoint] = []
    for point in sorted(known, key=lambda p: (p.milliseconds, -sign * p.scores[metric.name])):
        if not found or sign * (point.scores[metric.name] - found[-1].scores[metric.name]) > 0.0:
            found.append(point)
    return found


def presets(points: Sequence[ParetoPoint]) -> dict[str, str]:
    """Choose "fast", "balanced" and "high" from the frontier of time and PSNR, at one ratio; {}: none fits.

    fast: the fastest that beats spatial methods by `MIN_GAIN`.
    high: the fastest within `NEGLIGIBLE_GAIN` of the best.
    balanced: between those two, the one with the largest gain over fast per extra millisecond; else high.

    Only settings with the default `at_rest` compete, because moving shots do not show its gain. Methods that
    read G-buffers do not compete, because not all frames have them, nor methods that do not support
    PRESET_RATIOS, because a preset is for any ratio.
    """
    special = {name for name in model_names() if gbuffers_of([name]) or not _serves_presets(name)}
    live = [p for p in points if p.run.model not in special]
    line = frontier([p for p in live if p.run.at_rest == "converge"], CLIP_COLUMNS[0])
    spatial = [p.scores["psnr"] for p in points if p.run.model in SPATIAL]
    if not spatial or not line:
        return {}
    floor = max(spatial)
    good = [p for p in line if p.scores["psnr"] >= floor + MIN_GAIN] or line[-1:]
    best = max(p.scores["psnr"] for p in line)
    fast = good[0]
    high = next(p for p in line if p.scores["psnr"] >= best - NEGLIGIBLE_GAIN)
    between = [p for p in good if fast.milliseconds < p.milliseconds < high.milliseconds]

    def gain_rate(point: ParetoPoint) -> float:
        return (point.scores["psnr"] - fast.scores["psnr"]) / (point.milliseconds - fast.milliseconds)

    balanced = max(between, key=gain_rate, default=high)
    return {"fast": fast.spec, "balanced": balanced.spec, "high": high.spec}


def _serves_presets(model: str) -> bool:
    low, high = read_model_info(find_model(model)).ratios
    return low <= PRESET_RATIOS[0] and high >= PRESET_RATIOS[1]


def best_within(points: Sequence[ParetoPoint], budget: float) -> list[ParetoPoint]:
    """Return the settings of highest PSNR whose step takes at most `budget` milliseconds, at each ratio.

    If the best one reads G-buffers, the best that reads none follows it.
    """
    found = []
    for group in by_ratio(points).values():
        steps = (p for p in group if p.milliseconds <= budget)
        fast_enough = sorted(steps, key=lambda p: p.scores["psnr"], reverse=True)
        for point in fast_enough:
            found.append(point)
            if not gbuffers_of([point.run.model]):
                break
    return found


def by_ratio(points: Sequence[ParetoPoint]) -> dict[float, list[ParetoPoint]]:
    """Return the points of each ratio."""
    return {ratio: [p for p in points if p.ratio == ratio] for ratio in sorted({p.ratio for p in points})}


def at_ratio(points: Sequence[ParetoPoint], ratio: float) -> list[ParetoPoint]:
    """Return the points of the nearest ratio."""
    nearest = min((p.ratio for p in points), key=lambda known: abs(known - ratio), default=ratio)
    return [p for p in points if p.ratio == nearest]


def shot_names(record: BenchRecord) -> list[str]:
    """Return the names of the shots that a record scores."""
    if isinstance(record, ParetoRecord):
        return record.shots
    shots = record.shots if isinstance(record, QualityRecord) else []
    return list(dict.fromkeys(shot.name for shot in shots))


@dataclass(frozen=True)
class ParetoRecord(BenchRecord):
    """Times and scores of settings."""

    shots: list[str]  # names of the scored shots
    display: Size  # of the timed images
    threads: int
    points: list[ParetoPoint]
    BENCH = "pareto"
    TABLES = ("", "presets")

    def table(self) -> str:
        """Return the table of settings; bold figures are on their frontier."""
        columns = [c for c in CLIP_COLUMNS if any(c.name in p.scores for p in self.points)]
        rows = []
        for ratio, group in by_ratio(self.points).items():
            lines = {c.name: frontier(group, c) for c in columns}
            for point in sorted(group, key=lambda p: p.milliseconds):
                figures = [(c.figure(point.scores), point in lines[c.name]) for c in columns]
                cells = [f"**{text}**" if leads else text for text, leads in figures]
                rows.append([f"{ratio:g}", point.spec, point.runs, f"{point.milliseconds:.1f}", *cells])
        scores = f"scores of {self.shots[0]}" if len(self.shots) == 1 else "mean scores of the test shots"
        caption = (
            f"Time of a step to {size_text(self.display)} on {self.threads} threads ({self.machine_name}), "
            f"and {scores}. Bold: no other setting at that ratio is both faster and better."
        )
        headings = ["ratio:", "setting", "runs", "ms:", *(f"{c.title}:" for c in columns)]
        return table(headings, rows, caption)

    def presets_table(self) -> str:
        """Return the table of the presets that follow from the points; "" if none do."""
        chosen = presets(at_ratio(self.points, PRESET_RATIO))
        return table(["preset", "setting"], chosen.items()) if chosen else ""
