"""Predicted against true classes of a shot's pixels: counts, overlaps, tables and records."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.table import Table

from supersampler.errors import ArgumentError
from supersampler.frame import Float32
from supersampler.io.shot import ClassMaps
from supersampler_bench.markdown_table import figure, table
from supersampler_bench.quality.metrics import crop
from supersampler_bench.record import Record

Counts = NDArray[np.int64]
"""(2, 3, 3): pixels by group, true class and predicted class."""

GROUPS: Mapping[str, tuple[str, str, str]] = {
    "ghosting": ("none", "visibility", "shading"),
    "aliasing": ("none", "geometry", "texture"),
}
"""The classes of each group, in the order of `StepResult.class_map` and by the numbers of `ClassMaps`."""


def count(class_map: Float32, truth: ClassMaps, border: int = 0) -> Counts:
    """Count display pixels by true and predicted class; the prediction is the likeliest class.

    A map of half the size predicts one class for 2x2 pixels, so that finer areas never match completely.

    Args:
        class_map: (H / 2, W / 2, 6), sizes rounded up, see `StepResult.class_map`; or (H, W, 6), as that of
            `classifier-paper`.
        truth: of (H, W) pixels.
        border: display pixels at each side that do not count.

    Raises:
        ArgumentError: the map has another size.
    """
    counts = np.zeros((2, 3, 3), np.int64)
    full = truth.ghost.shape
    half = (full[0] + 1) // 2, (full[1] + 1) // 2
    if class_map.shape[:2] not in (full, half):
        raise ArgumentError("class_map", got=f"of {class_map.shape[:2]} pixels", want=f"{half} or {full}")
    side = 1 if class_map.shape[:2] == full else 2
    for group, labels in enumerate((truth.ghost, truth.alias)):
        coarse = class_map[..., 3 * group : 3 * group + 3].argmax(axis=-1)
        predicted = coarse.repeat(side, axis=0).repeat(side, axis=1)[: full[0], : full[1]]
        true = crop(labels, border).astype(np.intp)
        cells = np.bincount((3 * true + crop(predicted, border)).ravel(), minlength=9)
        counts[group] = cells.reshape(3, 3)
    return counts


def overlap(matrix: Counts) -> NDArray[np.float64]:
    """Intersection over union of each class, (3, 3) to (3,); NaN if it is neither present nor predicted."""
    together = np.diagonal(matrix).astype(np.float64)
    either = matrix.sum(axis=0) + matrix.sum(axis=1) - together
    return np.asarray(np.divide(together, either, out=np.full(3, np.nan), where=either > 0))


def fractions(matrix: Counts) -> NDArray[np.float64]:
    """Fraction of each true class's pixels by predicted class, (3, 3); NaN for a class without pixels."""
    there = matrix.sum(axis=1, keepdims=True)
    return np.asarray(np.divide(matrix, there, out=np.full((3, 3), np.nan), where=there > 0))


def class_record(counts: Counts | None) -> dict[str, Any] | None:
    """Return counts ready for JSON: by group, its classes, pixels by true and predicted class, overlaps."""
    if counts is None:
        return None
    return {
        group: {
            "classes": list(names),
            "pixels_by_true_and_predicted_class": matrix.tolist(),
            "intersection_over_union": overlap(matrix).tolist(),
        }
        for (group, names), matrix in zip(GROUPS.items(), counts, strict=True)
    }


def counts_of(record: Mapping[str, Any] | None) -> Counts | None:
    """Return the counts of a record by `class_record`."""
    if record is None:
        return None
    return np.array([record[group]["pixels_by_true_and_predicted_class"] for group in GROUPS], np.int64)


def confusions_of(rows: Sequence[Record]) -> list[tuple[str, Counts]]:
    """Return the counts of each method that predicts classes, where true classes are known."""
    counted = [(row["method"], counts_of(row["classes"]["warm_cropped"])) for row in rows]
    return [(method, counts) for method, counts in counted if counts is not None]


def class_tables(rows: Sequence[Record]) -> str:
    """Return two Markdown tables for each method that predicts classes; "" where there are none."""
    return "\n\n".join(
        _markdown(method, group, matrix)
        for method, counts in confusions_of(rows)
        for group, matrix in zip(GROUPS, counts, strict=True)
    )


def _markdown(method: str, group: str, matrix: Counts) -> str:
    names = GROUPS[group]
    headings = [f"{group}, `{method}`", *(f"predicted {name}:" for name in names), "of all pixels:", "IoU:"]
    part = matrix.sum(axis=1) / max(matrix.sum(), 1)
    rows = [
        [name, *(figure(100.0 * f, 1, " %") for f in row), figure(100.0 * of_all, 2, " %"), figure(iou, 3)]
        for name, row, of_all, iou in zip(names, fractions(matrix), part, overlap(matrix), strict=True)
    ]
    return table(headings, rows)


def rich_class_table(title: str, rows: Sequence[Record]) -> Table | None:
    """Return the intersections over union for a terminal, a line a class; None where there are none."""
    confusions = confusions_of(rows)
    if not confusions:
        return None
    shown = Table("intersection over union", *(method for method, _ in confusions), caption=title)
    for index, (group, names) in enumerate(GROUPS.items()):
        found = [overlap(counts[index]) for _, counts in confusions]
        for number, name in enumerate(names):
            shown.add_row(f"{group}: {name}", *(figure(of[number], 3) for of in found))
    return shown
