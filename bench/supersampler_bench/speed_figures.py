"""A figure of how long steps take on the host, and what the time goes into."""

from collections.abc import Sequence
from pathlib import Path

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from supersampler_bench.png import save_png
from supersampler_bench.speed import Timed


def draw_speed(results: Sequence[Timed], path: Path) -> None:
    """Draw a panel for each size and number of threads: a bar for each method, parted by stage.

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
    save_png(figure, path)


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
