"""Figures: time against error, still scenes over the frames, error heat maps."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter, StrMethodFormatter
from numpy.typing import NDArray

from supersampler.cli.arguments import size_text
from supersampler.conventions import jitter_phase_count
from supersampler.frame import Float32
from supersampler.io.compare import false_color
from supersampler.io.files import replacing
from supersampler_bench.quality.measure import ScoredImage
from supersampler_bench.quality.score_table import CLIP_COLUMNS, Column, sizes
from supersampler_bench.quality.scores import WARM_UP_FRAMES, ShotRow
from supersampler_bench.quality.still import StillRecord, StillScores
from supersampler_bench.timing.pareto import ParetoPoint, ParetoRecord, by_ratio, frontier
from supersampler_model.data.shots import variant_name


@dataclass(frozen=True)
class FrameErrors:
    """Images and errors of one frame, in the order of the methods.

    Attributes:
        frame: its number.
        images: (H, W, 3) each, after the display transform.
        errors: (H, W) each, LDR-FLIP.
    """

    frame: int
    images: list[Float32] = field(default_factory=list)
    errors: list[Float32] = field(default_factory=list)


class ErrorMaps:
    """Callback `watch` of `measure_quality`, which keeps the mean errors and the frame of largest error.

    Warm-up frames count only in shots that have no later ones.

    Args:
        methods: names of the methods.
    """

    def __init__(self, methods: list[str]) -> None:
        self.methods = methods
        self.worst = self._now = FrameErrors(-1)
        self._sums: list[NDArray[np.float64]] = []
        self._count, self._largest, self._warm = 0, -1.0, False

    def __call__(self, seen: ScoredImage) -> None:
        """Take one image; those of a frame follow one another in the order of the methods."""
        if seen.method == 0:
            self._now = FrameErrors(seen.frame)
        self._now.images.append(seen.shown)
        self._now.errors.append(seen.flip)
        if len(self._now.errors) == len(self.methods):
            self._take(self._now)

    @property
    def means(self) -> list[Float32]:
        """(H, W) each, the mean over the frames, by method."""
        return [np.asarray(total / self._count, np.float32) for total in self._sums]

    def _take(self, now: FrameErrors) -> None:
        if now.frame >= WARM_UP_FRAMES and not self._warm:
            self._sums, self._count, self._largest, self._warm = [], 0, -1.0, True
        sums = self._sums or [np.zeros(error.shape) for error in now.errors]
        self._sums = [total + error for total, error in zip(sums, now.errors, strict=True)]
        self._count += 1
        size = float(np.mean([error.mean() for error in now.errors]))
        if size > self._largest:
            self._largest, self.worst = size, now


_FALSE_COLORS = ListedColormap(false_color(np.linspace(0.0, 1.0, 256)[None])[0] / 255.0)
_DPI = 100
_PANEL = 6.4  # inches, 640 pixels: larger images are averaged down


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
    """Yield panels of a figure, two in a row; then write the figure.

    Args:
        count: number of panels.
        path: PNG to write.
        size: inches of a panel, (width, height).
        title: title of the figure.
        legend: entries in a row of the legend, which is the first panel's; 0: there is no legend.
        sharex: whether panels share their horizontal axis.
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
    _save(figure, path)


def _save(figure: Figure, path: Path) -> None:
    with replacing(path) as partial:
        figure.savefig(partial, format="png")


def draw_shot(shot: ShotRow, maps: ErrorMaps, folder: Path) -> None:
    """Write a folder with the errors of one shot.

    Args:
        shot: scores of the shot.
        maps: errors of its measurement.
        folder: the new folder is written here.
    """
    name = shot.name + (f"-{variant_name(shot.ratio)}" if shot.ratio is not None else "")
    draw_errors(sizes(shot), maps, folder / name / "errors.png")


def draw_errors(title: str, maps: ErrorMaps, path: Path) -> None:
    """Draw each method's image of the worst frame, its error there and its mean error, on one scale.

    Args:
        title: title of the figure.
        maps: errors of at least one frame.
        path: PNG to write.
    """
    means, worst = maps.means, maps.worst
    height, width = means[0].shape
    figure = Figure(figsize=(3.0 * _PANEL, len(means) * _PANEL * height / width + 1.0), dpi=_DPI)
    figure.set_layout_engine("constrained", w_pad=0.02, h_pad=0.02)
    panels = figure.subplots(len(means), 3, squeeze=False)
    limits = [_limit(errors) for errors in (worst.errors, means)]
    for row, method, image, error, mean in zip(
        panels, maps.methods, worst.images, worst.errors, means, strict=True
    ):
        row[0].imshow(image)
        shown = [
            axes.imshow(values, cmap=_FALSE_COLORS, vmin=0.0, vmax=limit)
            for axes, values, limit in zip(row[1:], (error, mean), limits, strict=True)
        ]
        headings = (f"frame {worst.frame}", f"error of frame {worst.frame}", "mean error")
        for axes, heading in zip(row, headings, strict=True):
            axes.set_axis_off()
            axes.set_title(f"{method}: {heading}", fontsize="medium")
    for column, image in zip((1, 2), shown, strict=True):
        figure.colorbar(image, ax=panels[:, column], location="bottom", fraction=0.02, pad=0.01, extend="max")
    figure.suptitle(f"{title}: LDR-FLIP, in the frame of largest error, and on average")
    _save(figure, path)


def _limit(errors: Sequence[Float32]) -> float:
    """Upper end of the colour scale: the 99.8th percentile, since outliers would darken all else."""
    return max(float(np.percentile(error, 99.8)) for error in errors) or 1.0


_GREY = "0.65"
_NEAR = 0.04  # fraction of the time and of the range of scores within which points share a label


def draw_still(record: StillRecord, path: Path) -> None:
    """Draw a panel for each scene at one ratio: PSNR of each method over the frames.

    Args:
        record: record of `bench still`.
        path: PNG to write.
    """
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
    """Write `folder`/pareto-METRIC.png: a panel for each ratio, with its frontier; others are grey."""
    title = f"{size_text(record.display)}, {record.threads} threads"
    folder.mkdir(parents=True, exist_ok=True)
    written = []
    for metric in CLIP_COLUMNS:
        known = [p for p in record.points if metric.name in p.scores]
        if known:
            path = folder / f"pareto-{metric.name.replace('_', '-')}.png"
            _draw(known, metric, title, path)
            written.append(path)
    return written


def _draw(points: Sequence[ParetoPoint], metric: Column, title: str, path: Path) -> None:
    groups = by_ratio(points)
    better = "up" if metric.higher else "down"
    title = f"{title}: {metric.title} ({better} and left is better)"
    with _panels(len(groups), path, (7.2, 4.4), title=title, sharex=True) as panels:
        for axes, (ratio, group) in zip(panels, groups.items(), strict=True):
            _draw_ratio(axes, group, metric)
            axes.set_title(f"ratio {ratio:g}", fontsize="medium")


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
            axes.plot(*place, "o", color="tab:blue" if leading else _GREY, markersize=6)
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
    axes.set(xlabel="milliseconds a step", ylabel=metric.title)
    axes.margins(x=0.15, y=0.12)
    axes.grid(alpha=0.3, which="both")


def _near(points: Sequence[ParetoPoint], metric: Column) -> list[list[ParetoPoint]]:
    """Group points whose labels would overlap, so that they share one; the fastest first."""
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
