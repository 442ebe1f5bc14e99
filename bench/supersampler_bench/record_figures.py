"""Figures of a record that is read back: what the page of all records shows beside its tables."""

from pathlib import Path

from supersampler_bench.figures import draw_curves
from supersampler_bench.pareto import METRICS, points_of
from supersampler_bench.pareto_figures import draw_pareto
from supersampler_bench.record import Record, method_scores
from supersampler_bench.speed import timed_of
from supersampler_bench.speed_figures import draw_speed
from supersampler_bench.table import sizes


def draw_record(record: Record, folder: Path) -> list[tuple[str, Path]]:
    """Draw what a record has figures of: time against each error, stages of steps, curves over frames.

    Args:
        record: of any bench.
        folder: of the PNG files.

    Returns:
        Title and file of each.
    """
    if record["bench"] == "pareto":
        return _pareto(record, folder)
    if record["bench"] == "speed":
        return _speed(record, folder)
    if record["bench"] == "quality":
        return _curves(record, folder)
    return []


def _pareto(record: Record, folder: Path) -> list[tuple[str, Path]]:
    width, height = record["display"]
    written = draw_pareto(points_of(record), f"{width}x{height}, {record['threads']} threads", folder)
    headings = {f"pareto-{m.name.replace('_', '-')}": m.heading for m in METRICS}
    return [(f"{headings[path.stem]} against time", path) for path in written]


def _speed(record: Record, folder: Path) -> list[tuple[str, Path]]:
    timed, path = timed_of(record), folder / "speed.png"
    if not any(r.stages for r in timed):
        return []
    draw_speed(timed, path)
    return [("Stages of a step on the host", path)]


def _curves(record: Record, folder: Path) -> list[tuple[str, Path]]:
    if len({shot.get("ratio") for shot in record["shots"]}) > 1:
        return []  # what is compared there is ratios; curves of each shot at each would bury it
    drawn = []
    for number, shot in enumerate(record["shots"]):
        path = folder / f"curves-{number}.png"
        draw_curves(sizes(shot), [method_scores(row) for row in shot["methods"]], path)
        drawn.append((f"{sizes(shot)}: over the frames", path))
    return drawn
