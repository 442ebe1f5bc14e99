"""Figures: time against error, and convergence in still scenes."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter

from supersampler.cli.arguments import size_text
from supersampler.conventions import jitter_phase_count
from supersampler.io.files import replacing
from supersampler_bench.quality.score_table import CLIP_COLUMNS, Column
from supersampler_bench.quality.still import StillRecord, StillScores
from supersampler_bench.timing.pareto import ParetoPoint, ParetoRecord, by_ratio, frontier

_DPI = 100


@contextmanager
def _panels(
    count: int,
    path: Path,
    size: tuple[float, float],
    *,
    title: str = "",
    legend: int = 0,
    sharex: bool = False,
) -> Iterator[Sequence[Axes]]:
    """Yield the panels of a figure, two in a row; then write the figure as PNG.

    `size` is the (width, height) of a panel in inches, `legend` the number of entries in a row of the legend,
    which is the first panel's; 0: no legend.
    """
    columns = min(count, 2)
    rows = -(-count // columns)
    figure = Figure(figsize=(size[0] * columns, size[1] * rows + 0.7), dpi=_DPI, layout="constrained")
    panels = figure.subplots(rows, columns, squeeze=False, sharex=sharex).ravel()
    for axes in panels[count:]:
        axes.remove()
    yield list(panels[:count])
    if legend:
        handles, labels = panels[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside lower center", ncols=min(len(labels), legend))
    if title:
        figure.suptitle(title)
    with replacing(path) as partial:
        figure.savefig(partial, format="png")


_NEAR = 0.04  # fraction of the time and of the range of scores within which points share a label


def draw_still(record: StillRecord, path: Path) -> None:
    """Draw a panel for each scene at one ratio, with the PSNR of each method over the frames."""
    scenes: dict[str, list[StillScores]] = {}
    for score in record.scores_at_one_ratio():
        scenes.setdefault(score.scene, []).append(score)
    with _panels(len(scenes), path, (7.0, 3.3), legend=4) as panels:
        for axes, (scene, scores) in zip(panels, scenes.items(), strict=True):
            _draw_scene(axes, scores)
            axes.set_title(f"{scene}, ratio {scores[0].ratio:g}", fontsize="medium")


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


def draw_pareto(record: ParetoRecord, folder: Path) -> list[Path]:
    """Write pareto-METRIC.png for each metric: a panel per ratio, with points off the frontier in grey."""
    written = []
    for metric in CLIP_COLUMNS:
        groups = by_ratio([p for p in record.points if metric.name in p.scores])
        if not groups:
            continue
        path = folder / f"pareto-{metric.name.replace('_', '-')}.png"
        better = "up" if metric.higher else "down"
        title = f"{size_text(record.display)}, {record.threads} threads: {metric.title} "
        title += f"({better} and left is better)"
        with _panels(len(groups), path, (7.2, 4.4), title=title, sharex=True) as panels:
            for axes, (ratio, group) in zip(panels, groups.items(), strict=True):
                _draw_ratio(axes, group, metric)
                axes.set_title(f"ratio {ratio:g}", fontsize="medium")
        written.append(path)
    return written


def _draw_ratio(axes: Axes, points: Sequence[ParetoPoint], metric: Column) -> None:
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
            axes.plot(*place, "o", color="tab:blue" if leading else "0.65", markersize=6)
        axes.annotate(
            ", ".join(point.spec for point in group),
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
    axes.set(xlabel="milliseconds per step", ylabel=metric.title)
    axes.margins(x=0.15, y=0.12)
    axes.grid(alpha=0.3, which="both")


def _near(points: Sequence[ParetoPoint], metric: Column) -> list[list[ParetoPoint]]:
    """Group points whose labels would overlap, so that they share one; the fastest comes first."""
    scores = [point.scores[metric.name] for point in points]
    room = _NEAR * (max(scores) - min(scores))
    groups: list[list[ParetoPoint]] = []
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
