"""The highest intersection over union that a prediction for squares of 2x2 pixels can have.

Classifiers predict for such squares, and true classes are of pixels. Here the prediction is made from true
classes: a square has a class if at least so many of its pixels have it. The best number gives the ceiling.

    python bench/studies/class_ceiling.py test-shots --json bench/results/studies/class-ceiling.json \
        --update docs/quality.md
"""

from typing import Any

import numpy as np
import typer
from numpy.typing import NDArray

from supersampler.io.shot import Shot
from supersampler_bench.cli.options import CACHE, JSON, RATIO, SHOT, UPDATE, check_page, opened_shots, publish
from supersampler_bench.markdown_table import figure, table
from supersampler_bench.quality.confusion import GROUPS
from supersampler_bench.quality.metrics import crop
from supersampler_bench.quality.summaries import BORDER, WARM_UP_FRAMES
from supersampler_bench.record import Record

LEAST = (1, 2, 3, 4)
"""Least number of pixels of a class in a square that is predicted to have it."""


def counts_of(truth: NDArray[np.uint8]) -> NDArray[np.int64]:
    """Count pixels in intersections and unions, (classes, LEAST, 2), of true classes (H, W)."""
    height, width = truth.shape
    counts = np.zeros((3, len(LEAST), 2), np.int64)
    for number in range(3):
        true = truth == number
        whole = np.pad(true, ((0, height % 2), (0, width % 2)))
        held = whole.reshape(whole.shape[0] // 2, 2, whole.shape[1] // 2, 2).sum(axis=(1, 3))
        for at, least in enumerate(LEAST):
            predicted = (held >= least).repeat(2, axis=0).repeat(2, axis=1)[:height, :width]
            both, either = (crop(mask, BORDER).sum() for mask in (predicted & true, predicted | true))
            counts[number, at] = both, either
    return counts


def measured(shot: Shot) -> dict[str, NDArray[np.int64]]:
    """Return the counts of each group of classes over a shot, without its warm-up."""
    found = {group: np.zeros((3, len(LEAST), 2), np.int64) for group in GROUPS}
    for index in shot.reference_indices:
        classes = shot.read_classes(index)
        if index >= WARM_UP_FRAMES and classes is not None:
            for group, truth in zip(GROUPS, (classes.ghost, classes.alias), strict=True):
                found[group] += counts_of(truth)
    return found


def markdown_table(record: Record) -> str:
    """Return the table of a record, with its caption."""
    rows = []
    for group, names in GROUPS.items():
        counts = np.sum([shot["counts"][group] for shot in record["shots"]], axis=0)
        for name, of_class in zip(names, counts, strict=True):
            overlaps = of_class[:, 0] / np.maximum(of_class[:, 1], 1)
            rows.append([f"{group}: {name}", *(figure(value, 3) for value in (overlaps.max(), *overlaps))])
    shots = ", ".join(shot["name"] for shot in record["shots"])
    caption = (
        f"Intersection over union in {shots}, without the first {WARM_UP_FRAMES} frames and a border of "
        f"{BORDER} pixels."
    )
    heads = ["class", "ceiling:", *(f"{least} of 4 pixels:" for least in LEAST)]
    return table(heads, rows, caption)


def main(
    shot: SHOT, ratio: RATIO = "2", cache: CACHE = None, json: JSON = None, update: UPDATE = None
) -> None:
    """Measure the ceiling; frames need true classes."""
    name, opened = opened_shots(shot, cache, ratio)
    tables = {f"study class-ceiling {name}": markdown_table}
    check_page(update, tables)
    shots: list[dict[str, Any]] = [
        {"name": one.name, "counts": {group: counts.tolist() for group, counts in measured(one).items()}}
        for one, _ in opened
    ]
    publish({"bench": "class-ceiling", "shots": shots}, tables, json, update)


if __name__ == "__main__":
    typer.run(main)
