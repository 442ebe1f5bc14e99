"""Figures of a measurement: curves over the frames, error heat maps, confusion of classes."""

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure

from supersampler.frame import Float32
from supersampler.io.compare import false_color
from supersampler.io.files import replacing
from supersampler_bench.markdown_table import figure as figure_text
from supersampler_bench.quality.confusion import GROUPS, Counts, confusions_of, fractions, overlap
from supersampler_bench.quality.error_maps import ErrorMaps
from supersampler_bench.quality.score_table import CLIP_COLUMNS, COLUMNS, Column, caption, mean_tables, sizes
from supersampler_bench.quality.summaries import BORDER, WARM_UP_FRAMES
from supersampler_bench.record import Record
from supersampler_model.data.shots import variant_name

_FALSE_COLORS = ListedColormap(false_color(np.linspace(0.0, 1.0, 256)[None])[0] / 255.0)
_DPI = 100
_PANEL = 6.4  # inches, 640 pixels: larger images are averaged down


def draw_shot(shot: Record, maps: ErrorMaps, folder: Path) -> None:
    """Write a folder with curves, errors and, where a method predicts them, classes of one shot.

    Args:
        shot: by `shot_scores`.
        maps: that have watched the measurement.
        folder: of the folder.
    """
    name = shot["name"] + (f"-{variant_name(shot['ratio'])}" if "ratio" in shot else "")
    draw_curves(shot, folder / name / "curves.png")
    draw_errors(sizes(shot), maps, folder / name / "errors.png")
    if confusions := confusions_of(shot["methods"]):
        draw_classes(caption(shot), confusions, folder / name / "classes.png")


def draw_means(record: Record, folder: Path) -> None:
    """Draw the classes of all shots at each ratio, where there are several shots."""
    for ratio, (title, rows) in mean_tables(record).items():
        if confusions := confusions_of(rows):
            draw_classes(title, confusions, folder / f"classes-{variant_name(ratio)}.png")


def draw_curves(shot: Record, path: Path) -> None:
    """Draw each metric of each method over the frames, without the border; the warm-up is shaded.

    Args:
        shot: by `shot_scores`.
        path: of the PNG.
    """
    rows = shot["methods"]
    columns = [c for c in dict.fromkeys((*COLUMNS, *CLIP_COLUMNS)) if any(_curve(c, row) for row in rows)]
    height = -(-len(columns) // 2)
    figure = Figure(figsize=(14.0, 2.6 * height + 0.6), dpi=_DPI, layout="constrained")
    panels = figure.subplots(height, 2, squeeze=False).ravel()
    for axes, column in zip(panels, columns, strict=False):
        for row in rows:
            values = _curve(column, row)
            numbers = list(range(min(values), max(values) + 1)) if values else []
            if column.name == "strred":  # pairs of frames: the frames between them have no value
                numbers = list(values)
            curve = [values.get(number, math.nan) for number in numbers]
            axes.plot(numbers, curve, label=row["method"], marker=".", markersize=4, linewidth=1.0)
        axes.axvspan(-0.5, WARM_UP_FRAMES - 0.5, color="0.92", zorder=0)
        axes.set_title(column.heading, fontsize="medium")
        axes.grid(alpha=0.3)
    for axes in panels[len(columns) :]:
        axes.remove()
    handles, labels = panels[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=min(len(labels), 7))
    about = f"without a border of {BORDER} pixels; the first {WARM_UP_FRAMES} frames shaded"
    figure.suptitle(f"{sizes(shot)}: {about}")
    with replacing(path) as partial:
        figure.savefig(partial, format="png")


def _curve(column: Column, row: Record) -> dict[int, float]:
    """Return the known values of a metric by frame."""
    values = {frame["frame"]: frame["cropped"].get(column.name) for frame in row["frames"]}
    return {
        frame: value * column.scale
        for frame, value in values.items()
        if value is not None and not math.isnan(value)
    }


def draw_errors(title: str, maps: ErrorMaps, path: Path) -> None:
    """Draw, by method, its image of the worst frame, the error there and the mean error, on one scale.

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
    predicted_as = fractions(matrix)
    part = matrix.sum(axis=1) / max(matrix.sum(), 1)
    axes.imshow(np.nan_to_num(predicted_as), cmap="Blues", vmin=0.0, vmax=1.0)
    axes.set_xticks(range(len(names)), names)
    labels = [
        f"{name}\n{of_all:.2%} of pixels\nIoU {figure_text(iou, 3)}"
        for name, of_all, iou in zip(names, part, overlap(matrix), strict=True)
    ]
    axes.set_yticks(range(len(names)), labels)
    axes.set(xlabel="predicted", ylabel="true")
    for (true, predicted), value in np.ndenumerate(predicted_as):
        ink = "white" if value > 0.5 else "black"
        axes.text(predicted, true, figure_text(100.0 * value, 1, "%"), ha="center", va="center", color=ink)


def _limit(errors: Sequence[Float32]) -> float:
    """Upper end of the colour scale: the 99.8th percentile, since outliers would darken all else."""
    return max(float(np.percentile(error, 99.8)) for error in errors) or 1.0
