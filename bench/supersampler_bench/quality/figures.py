"""Figures of a measurement: curves over the frames, error heat maps, confusion of classes."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from numpy.typing import NDArray

from supersampler.frame import Array, Float32
from supersampler.io.atomic import replacing
from supersampler.io.compare import false_color
from supersampler_bench.quality.confusion import GROUPS, Counts, overlap, shares
from supersampler_bench.quality.error_maps import ErrorMaps
from supersampler_bench.quality.score_table import CLIP_COLUMNS, COLUMNS, Column
from supersampler_bench.quality.summaries import BORDER, FRAME_METRICS, WARM_UP_FRAMES, MethodScores

_FALSE_COLORS = ListedColormap(false_color(np.linspace(0.0, 1.0, 256)[None])[0] / 255.0)
_DPI = 100
_PANEL = 6.4  # inches, 640 pixels: larger images are averaged down


def draw_curves(title: str, results: Sequence[MethodScores], path: Path) -> None:
    """Draw each metric of each method over the frames, without the border; the warm-up is shaded.

    Args:
        title: of the figure.
        results: of one shot.
        path: of the PNG.
    """
    columns = [c for c in dict.fromkeys((*COLUMNS, *CLIP_COLUMNS)) if _has(c, results)]
    rows = -(-len(columns) // 2)
    figure = Figure(figsize=(14.0, 2.6 * rows + 0.6), dpi=_DPI, layout="constrained")
    panels = figure.subplots(rows, 2, squeeze=False).ravel()
    for axes, column in zip(panels, columns, strict=False):
        for result in results:
            axes.plot(*_curve(column, result), label=result.method, marker=".", markersize=4, linewidth=1.0)
        axes.axvspan(-0.5, WARM_UP_FRAMES - 0.5, color="0.92", zorder=0)
        axes.set_title(column.heading, fontsize="medium")
        axes.grid(alpha=0.3)
    for axes in panels[len(columns) :]:
        axes.remove()
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=min(len(labels), 7))
    figure.suptitle(f"{title}: without a border of {BORDER} pixels; the first {WARM_UP_FRAMES} frames shaded")
    with replacing(path) as partial:
        figure.savefig(partial, format="png")


def draw_errors(title: str, maps: ErrorMaps, path: Path) -> None:
    """Draw, by method, its image of the worst frame, the error there and the mean error, to one scale.

    Args:
        title: of the figure.
        maps: that have watched at least one frame.
        path: of the PNG.
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
    figure.suptitle(f"{title}: LDR-FLIP, in the frame in which all err the most, and on average")
    with replacing(path) as partial:
        figure.savefig(partial, format="png")


def draw_classes(title: str, confusions: Sequence[tuple[str, Counts]], path: Path) -> None:
    """Draw, by method, the predicted classes of each true class.

    Args:
        title: of the figure.
        confusions: methods and their class counts.
        path: of the PNG.
    """
    figure = Figure(figsize=(10.0, 4.2 * len(confusions) + 0.5), dpi=_DPI, layout="constrained")
    panels = figure.subplots(len(confusions), len(GROUPS), squeeze=False)
    for row, (method, counts) in zip(panels, confusions, strict=True):
        for axes, (group, names), matrix in zip(row, GROUPS.items(), counts, strict=True):
            _draw_matrix(axes, names, matrix)
            axes.set_title(f"{method}: {group}", fontsize="medium")
    figure.suptitle(title)
    with replacing(path) as partial:
        figure.savefig(partial, format="png")


def _draw_matrix(axes: Axes, names: Sequence[str], matrix: Counts) -> None:
    share = shares(matrix)
    part = matrix.sum(axis=1) / max(matrix.sum(), 1)
    iou = ["–" if np.isnan(value) else f"{value:.3f}" for value in overlap(matrix)]
    axes.imshow(np.nan_to_num(share), cmap="Blues", vmin=0.0, vmax=1.0)
    axes.set_xticks(range(len(names)), names)
    labels = zip(names, part, iou, strict=True)
    axes.set_yticks(range(len(names)), [f"{n}\n{p:.2%} of pixels\nIoU {i}" for n, p, i in labels])
    axes.set(xlabel="predicted", ylabel="true")
    for (true, predicted), value in np.ndenumerate(share):
        ink = "white" if value > 0.5 else "black"
        text = "–" if np.isnan(value) else f"{value:.1%}"
        axes.text(predicted, true, text, ha="center", va="center", color=ink)


def _limit(errors: Sequence[Float32]) -> float:
    """Where the scale of all methods ends: few pixels are beyond, so that the rest is not all dark."""
    return max(float(np.percentile(error, 99.8)) for error in errors) or 1.0


def _has(column: Column, results: Sequence[MethodScores]) -> bool:
    if column.metric not in FRAME_METRICS:
        return False
    return any(not np.isnan(frame.cropped[column.metric]) for result in results for frame in result.frames)


def _curve(column: Column, result: MethodScores) -> tuple[NDArray[np.intp], Array]:
    """Numbers of frames and values; a frame without one parts the curve, but for STRRED's pairs."""
    values = {frame.frame: frame.cropped[column.metric] * column.scale for frame in result.frames}
    if column.metric == "strred":
        values = {frame: value for frame, value in values.items() if not np.isnan(value)}
        return np.array(list(values), np.intp), np.array(list(values.values()))
    numbers = np.arange(min(values), max(values) + 1)
    return numbers, np.array([values.get(int(n), np.nan) for n in numbers])
