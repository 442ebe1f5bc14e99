"""Figures of records for the HTML page: time against error, stages of a step, curves over frames."""

from collections.abc import Sequence
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from supersampler.io.atomic import replacing
from supersampler_bench.quality.figures import draw_curves
from supersampler_bench.quality.score_record import method_scores
from supersampler_bench.quality.score_table import sizes
from supersampler_bench.record import Record
from supersampler_bench.report.pareto_figures import draw_pareto
from supersampler_bench.timing.pareto import METRICS, points_of
from supersampler_bench.timing.speed import Timed, timed_of


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
    return [("Stages of a step on the CPU backend", path)]


def _curves(record: Record, folder: Path) -> list[tuple[str, Path]]:
    if len({shot.get("ratio") for shot in record["shots"]}) > 1:
        return []  # what is compared there is ratios; curves of each shot at each would bury it
    curves = []
    for number, shot in enumerate(record["shots"]):
        path = folder / f"curves-{number}.png"
        draw_curves(sizes(shot), [method_scores(row) for row in shot["methods"]], path)
        curves.append((f"{sizes(shot)}: over the frames", path))
    return curves


def draw_speed(results: Sequence[Timed], path: Path) -> None:
    """Draw a panel for each size and number of threads: a bar for each method, split by stage.

    Args:
        results: at least one with stages; graphs have none, and are left out.
        path: of the PNG.
    """
    groups: dict[str, list[Timed]] = {}
    for r in (r for r in results if r.stages):
        (width, height), threads = r.setting.display, r.setting.threads
        groups.setdefault(f"{width}x{height}, threads: {threads}", []).append(r)
    stages = list(dict.fromkeys(name for group in groups.values() for r in group for name in r.stages))
    columns = min(len(groups), 2)
    rows = -(-len(groups) // columns)
    bars = max(map(len, groups.values()))
    figure = Figure(figsize=(7.0 * columns, (0.36 * bars + 0.9) * rows + 0.5), dpi=100, layout="constrained")
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes, (title, group) in zip(panels, groups.items(), strict=False):
        _draw_group(axes, group, stages)
        axes.set_title(title, fontsize="medium")
    for axes in panels[len(groups) :]:
        axes.remove()
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=len(labels))
    with replacing(path) as partial:
        figure.savefig(partial, format="png")


def _draw_group(axes: Axes, results: Sequence[Timed], stages: Sequence[str]) -> None:
    places = range(len(results))
    ends = [0.0] * len(results)
    for number, stage in enumerate(stages):
        spent = [r.stages.get(stage, 0.0) for r in results]
        axes.barh(places, spent, left=ends, color=f"C{number}", label=stage)
        ends = [end + each for end, each in zip(ends, spent, strict=True)]
    for place, end, r in zip(places, ends, results, strict=True):
        axes.annotate(f"{r.median:.1f}", (end, place), xytext=(5, 0), textcoords="offset points", va="center")
    axes.set_yticks(places, [r.setting.method for r in results])
    axes.invert_yaxis()
    axes.margins(x=0.12)
    axes.set_xlabel("milliseconds, means by stage; the number is the median of whole steps")
    axes.grid(alpha=0.3, axis="x")
