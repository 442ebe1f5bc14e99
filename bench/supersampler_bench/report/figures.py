"""Figures of records for the HTML page: time against error, stages of a step, curves over frames."""

from collections.abc import Sequence
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

from supersampler.conventions import jitter_phase_count
from supersampler.io.files import replacing
from supersampler_bench.quality.figures import draw_curves
from supersampler_bench.quality.score_table import CLIP_COLUMNS, Column, sizes
from supersampler_bench.quality.still import StillScores
from supersampler_bench.quality.still_table import scores_at_one_ratio
from supersampler_bench.record import Record
from supersampler_bench.timing.latency import Timed, timed_of
from supersampler_bench.timing.pareto import Point, by_ratio, frontier, points_of

_GREY = "0.65"
_NEAR = 0.04  # fraction of the time and of the range of scores within which points share a label


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
    if record["bench"] == "latency":
        return _latency(record, folder)
    if record["bench"] == "quality":
        return _curves(record, folder)
    if record["bench"] == "still":
        draw_still(record, folder / "still.png")
        return [("PSNR in front of a fixed camera, over the frames", folder / "still.png")]
    return []


def _pareto(record: Record, folder: Path) -> list[tuple[str, Path]]:
    width, height = record["display"]
    written = draw_pareto(points_of(record), f"{width}x{height}, {record['threads']} threads", folder)
    headings = {f"pareto-{c.name.replace('_', '-')}": c.title for c in CLIP_COLUMNS}
    return [(f"{headings[path.stem]} against time", path) for path in written]


def _latency(record: Record, folder: Path) -> list[tuple[str, Path]]:
    timed, path = timed_of(record), folder / "latency.png"
    if not any(r.stages for r in timed):
        return []
    draw_latency(timed, path)
    return [("Stages of a step on the CPU backend", path)]


def _curves(record: Record, folder: Path) -> list[tuple[str, Path]]:
    if len({shot.get("ratio") for shot in record["shots"]}) > 1:
        return []  # too many: curves of each shot at each ratio
    curves = []
    for number, shot in enumerate(record["shots"]):
        if not all("frames" in row for row in shot["methods"]):
            continue  # a record of this repository: summaries alone
        path = folder / f"curves-{number}.png"
        draw_curves(shot, path)
        curves.append((f"{sizes(shot)}: over the frames", path))
    return curves


def draw_latency(results: Sequence[Timed], path: Path) -> None:
    """Draw a panel for each size and number of threads: a bar for each method, split by stage.

    Args:
        results: at least one with stages; those without, as of the ONNX backend, are left out.
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


def draw_still(record: Record, path: Path) -> None:
    """Draw a panel for each scene at one ratio: PSNR of each method over the frames.

    Args:
        record: of `bench still`.
        path: of the PNG.
    """
    scenes: dict[str, list[StillScores]] = {}
    for score in scores_at_one_ratio(record):
        scenes.setdefault(score.scene, []).append(score)
    columns = min(len(scenes), 2)
    rows = -(-len(scenes) // columns)
    figure = Figure(figsize=(7.0 * columns, 3.3 * rows + 0.7), dpi=100, layout="constrained")
    panels = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes, (scene, scores) in zip(panels, scenes.items(), strict=False):
        _draw_scene(axes, scores)
        axes.set_title(f"{scene}, ratio {scores[0].ratio:g}", fontsize="medium")
    for axes in panels[len(scenes) :]:
        axes.remove()
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=4)
    with replacing(path) as partial:
        figure.savefig(partial, format="png")


def _draw_scene(axes: Axes, scores: Sequence[StillScores]) -> None:
    colors = {method: f"C{number}" for number, method in enumerate(dict.fromkeys(s.method for s in scores))}
    period = jitter_phase_count(scores[0].ratio)
    for score in scores:
        axes.plot(
            [frame / period for frame in range(1, len(score.psnr) + 1)],
            score.psnr,
            color=colors[score.method],
            linestyle="-" if score.executor == "cpu" else ":",
            linewidth=1.4,
            label=f"{score.method}, {score.executor}",
        )
    axes.set(xlabel="jitter periods", ylabel="PSNR, dB")
    axes.grid(alpha=0.3)


def draw_pareto(points: Sequence[Point], title: str, folder: Path) -> list[Path]:
    """Write `folder`/pareto-METRIC.png: a panel for each ratio, with its frontier; other settings are grey.

    Args:
        points: all settings.
        title: of each figure.
        folder: made if it does not exist.
    """
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for metric in CLIP_COLUMNS:
        known = [p for p in points if metric.name in p.scores]
        if known:
            path = folder / f"pareto-{metric.name.replace('_', '-')}.png"
            _draw(known, metric, title, path)
            written.append(path)
    return written


def _draw(points: Sequence[Point], metric: Column, title: str, path: Path) -> None:
    groups = by_ratio(points)
    columns = min(len(groups), 2)
    rows = -(-len(groups) // columns)
    figure = Figure(figsize=(7.2 * columns, 4.4 * rows + 0.6), dpi=100, layout="constrained")
    panels = figure.subplots(rows, columns, squeeze=False, sharex=True).ravel()
    for axes, (ratio, group) in zip(panels, groups.items(), strict=False):
        _draw_ratio(axes, group, metric)
        axes.set_title(f"ratio {ratio:g}", fontsize="medium")
    for axes in panels[len(groups) :]:
        axes.remove()
    better = "up" if metric.higher else "down"
    figure.suptitle(f"{title}: {metric.title} ({better} and left is better)")
    with replacing(path) as partial:
        figure.savefig(partial, format="png")


def _draw_ratio(axes: Axes, points: Sequence[Point], metric: Column) -> None:
    line = frontier(points, metric)
    axes.plot(
        [p.milliseconds for p in line],
        [metric.scale * p.scores[metric.name] for p in line],
        drawstyle="steps-post",
        color="tab:blue",
        linewidth=1.2,
    )
    for group in _near(points, metric):
        leads = [point in line for point in group]
        for point, leading in zip(group, leads, strict=True):
            place = point.milliseconds, metric.scale * point.scores[metric.name]
            axes.plot(*place, "o", color="tab:blue" if leading else _GREY, markersize=6)
        axes.annotate(
            ", ".join(str(point.spec) for point in group),
            (group[-1].milliseconds, metric.scale * group[-1].scores[metric.name]),
            xytext=(6, 4),
            textcoords="offset points",
            fontsize="small",
            color="black" if any(leads) else "0.5",
        )
    axes.set_xscale("log")
    axes.xaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.set(xlabel="milliseconds a step", ylabel=metric.title)
    axes.margins(x=0.15, y=0.12)
    axes.grid(alpha=0.3, which="both")


def _near(points: Sequence[Point], metric: Column) -> list[list[Point]]:
    """Group points whose labels would overlap, so that they share one; the fastest first."""
    scores = [point.scores[metric.name] for point in points]
    room = _NEAR * (max(scores) - min(scores))
    groups: list[list[Point]] = []
    for point in sorted(points, key=lambda p: (p.milliseconds, p.scores[metric.name])):
        for group in groups:
            last = group[-1]
            beside = point.milliseconds <= (1.0 + _NEAR) * last.milliseconds
            if beside and abs(point.scores[metric.name] - last.scores[metric.name]) <= room:
                group.append(point)
                break
        else:
            groups.append([point])
    return groups
