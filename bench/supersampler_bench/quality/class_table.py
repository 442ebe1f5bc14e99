"""Predicted against true classes, as tables for a terminal and for Markdown, and as a record."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from rich.table import Table

from supersampler_bench.quality.confusion import GROUPS, Counts, overlap, shares
from supersampler_bench.quality.summaries import Summarized


def confusions_of(results: Sequence[Summarized]) -> list[tuple[str, Counts]]:
    """Return the counts of each method that predicts classes, where true classes are known."""
    return [(result.method, counts) for result in results if (counts := result.classes()) is not None]


def class_tables(results: Sequence[Summarized]) -> str:
    """Return two Markdown tables for each method that predicts classes: predicted classes of each true class.

    Empty where no method predicts classes, or true classes are not known.
    """
    confusions = confusions_of(results)
    return "\n\n".join(_markdown(method, group, counts) for method, counts in confusions for group in GROUPS)


def rich_class_table(title: str, results: Sequence[Summarized]) -> Table | None:
    """Return the intersections over union for a terminal, a line a class; None where there are none."""
    confusions = confusions_of(results)
    if not confusions:
        return None
    table = Table("intersection over union", *(method for method, _ in confusions), caption=title)
    for index, (group, names) in enumerate(GROUPS.items()):
        found = [overlap(counts[index]) for _, counts in confusions]
        for number, name in enumerate(names):
            table.add_row(f"{group}: {name}", *(_figure(of[number], 3) for of in found))
    return table


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


def _markdown(method: str, group: str, counts: Counts) -> str:
    names, matrix = GROUPS[group], counts[list(GROUPS).index(group)]
    heading = [f"{group}, `{method}`", *(f"predicted {name}" for name in names), "of all pixels", "IoU"]
    rows = [heading, ["---", *["---:"] * 5]]
    part = matrix.sum(axis=1) / max(matrix.sum(), 1)
    for number, (name, row, iou) in enumerate(zip(names, shares(matrix), overlap(matrix), strict=True)):
        predicted = [_figure(100.0 * share, 1, " %") for share in row]
        rows.append([name, *predicted, _figure(100.0 * part[number], 2, " %"), _figure(iou, 3)])
    return "\n".join("| " + " | ".join(row) + " |" for row in rows)


def _figure(value: float, digits: int, unit: str = "") -> str:
    return "–" if math.isnan(value) else f"{value:.{digits}f}{unit}"
