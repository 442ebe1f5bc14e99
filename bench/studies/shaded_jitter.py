"""Jitter where every second frame is not shaded: counted by frames, and by shaded frames.

An even number of phases, counted by frames, shades only every second one of them: with Halton's base 2,
samples on one side of the pixel's centre.

    python bench/studies/shaded_jitter.py --json bench/results/studies/shaded-jitter.json \
        --update docs/contract.md
"""

from collections.abc import Callable, Mapping
from dataclasses import replace
from statistics import fmean
from typing import Any

import numpy as np
import typer

from supersampler import Upscaler, halton_jitter
from supersampler.io.display import display_transform
from supersampler_bench.cli.options import JSON, UPDATE, check_page, publish
from supersampler_bench.compatibility import with_default_gbuffers
from supersampler_bench.markdown_table import figure, table
from supersampler_bench.quality.metrics import crop, psnr
from supersampler_bench.record import Record
from supersampler_bench.stress.scenes import STILL, Orbit, truth
from supersampler_model.data.scenes.analytic import Scene

RENDER, DISPLAY, RATIO = (48, 32), (96, 64), 2.0
FRAMES, SCORED, BORDER = 160, 64, 4
SCENES: Mapping[str, Scene] = {"at rest": STILL, "in motion": Orbit()}
METHODS = ("taau", "classifier")
COUNTED: Mapping[str, Callable[[int], int]] = {"frames": lambda i: i, "shaded frames": lambda i: i // 2}


def scores(scene: Scene, method: str, counted: Callable[[int], int]) -> list[float]:
    """Return the mean PSNR of shaded and of unshaded frames, over the last SCORED of FRAMES."""
    upscaler = Upscaler(method, display_size=DISPLAY, extrapolation="guided-warp", validate="off")
    found: list[list[float]] = [[], []]
    for index in range(FRAMES):
        frame = scene.frame(index, RENDER, halton_jitter(counted(index), RATIO))
        frame = with_default_gbuffers(replace(frame, reset=index == 0), upscaler.gbuffers, DISPLAY)
        unshaded = index % 2 == 1
        image = upscaler.extrapolate(replace(frame, color=None)) if unshaded else upscaler.step(frame)
        if index >= FRAMES - SCORED:
            pair = (display_transform(np.asarray(one), 1.0) for one in (image, truth(scene, index, DISPLAY)))
            found[unshaded].append(psnr(*(crop(one, BORDER) for one in pair)))
    return [fmean(each) for each in found]


def rows() -> list[dict[str, Any]]:
    """Return all scores."""
    return [
        {"scene": name, "method": method, "counts": counts, "psnr": scores(scene, method, counted)}
        for name, scene in SCENES.items()
        for method in METHODS
        for counts, counted in COUNTED.items()
    ]


def markdown_table(record: Record) -> str:
    """Return the table of a record, with its caption."""
    cells = [
        [row["scene"], row["method"], row["counts"], *(figure(value, 1) for value in row["psnr"])]
        for row in record["rows"]
    ]
    heads = ["scene", "method", "jitter counts", "PSNR dB, shaded:", "PSNR dB, unshaded:"]
    caption = (
        f"Analytic scenes, every second frame extrapolated by guided-warp; the last {SCORED} of {FRAMES} "
        "frames, every pixel computed."
    )
    return table(heads, cells, caption)


def main(json: JSON = None, update: UPDATE = None) -> None:
    """Measure both ways."""
    tables = {"study shaded-jitter": markdown_table}
    check_page(update, tables)
    publish({"bench": "shaded-jitter", "rows": rows()}, tables, json, update)


if __name__ == "__main__":
    typer.run(main)
