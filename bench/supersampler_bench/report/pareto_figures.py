"""Figures of run time against error, one for each metric."""

from collections.abc import Sequence
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

from supersampler.io.atomic import replacing
from supersampler_bench.timing.pareto import METRICS, Metric, Point, by_ratio, frontier

_GREY = "0.65"
_NEAR = 0.04  # of a time, and of the range of scores: within it points share a label


def draw_pareto(points: Sequence[Point], title: str, folder: Path) -> list[Path]:
    """Write `folder`/pareto-METRIC.png: a panel for each ratio, with its frontier; beaten settings are grey.

    Args:
        points: all settings.
        title: of each figure.
        folder: that is made where it lacks.
    """
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for metric in METRICS:
        known = [p for p in points if metric.name in p.scores]
        if known:
            path = folder / f"pareto-{metric.name.replace('_', '-')}.png"
            _draw(known, metric, title, path)
            written.append(path)
    return written


def _draw(points: Sequence[Point], metric: Metric, title: str, path: Path) -> None:
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
    figure.suptitle(f"{title}: {metric.heading} ({better} and left is better)")
    with replacing(path) as partial:
        figure.savefig(partial, format="png")


def _draw_ratio(axes: Axes, points: Sequence[Point], metric: Metric) -> None:
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
    axes.set(xlabel="milliseconds a step", ylabel=metric.heading)
    axes.margins(x=0.15, y=0.12)
    axes.grid(alpha=0.3, which="both")


def _near(points: Sequence[Point], metric: Metric) -> list[list[Point]]:
    """Points in groups that share a label, as theirs would lie on one another; the best first."""
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
