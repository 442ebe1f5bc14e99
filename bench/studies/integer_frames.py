"""Measure what 8- and 16-bit PNG files and missing jitter cost: write, import and upscale the shipped shot.

Colour is what a screen shows, exposed and clipped, sRGB in 8 bits; motion is UV in 16 bits for x and y; depth
has 24 or 8 bits. All images are compared as a screen shows them. Frames without jitter are rendered here.

    python bench/studies/integer_frames.py --json bench/results/studies/integer-frames.json \
        --update docs/shots.md
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from statistics import fmean
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import typer
from numpy.typing import NDArray

from supersampler import Conventions, Frame, Upscaler
from supersampler.conventions.srgb import srgb_encoded
from supersampler.frame import Float32
from supersampler.io.images import write_png
from supersampler.io.shot import Shot, import_channels
from supersampler.io.shot.channels import ChannelMap
from supersampler_bench.cli.options import JSON, UPDATE, check_page, publish
from supersampler_bench.markdown_table import figure, table
from supersampler_bench.quality.metrics import crop, psnr, tpsnr
from supersampler_bench.record import Record
from supersampler_bench.shots.rendered_frame import rendered_frame
from supersampler_model.data.product_shot import DISPLAY_SIZE, Plaza
from supersampler_model.data.renderer.renderer import Renderer

SHOT, BORDER = "plaza", 8
METHODS = ("taau", "classifier")
NEAR, FAR = 0.1, 40.0  # of the scene; the 8-bit linear depth ends at FAR
UV_RANGE = (-1.0, 1.0)
LINEAR = "depth, 8 bits, linear"
DEPTHS: Mapping[str, tuple[int, str]] = {
    "depth, 24 bits": (3, "reversed"), "depth, 8 bits": (1, "reversed"), LINEAR: (1, "linear"),
}  # fmt: skip
"""Bytes and kind of each depth."""
ONE_FIELD = {"colour, 8 bits": "color", "motion, 16 bits": "motion", **dict.fromkeys(DEPTHS, "depth")}
"""Rows in which one field of the frame is of integers."""


def displayed(linear: NDArray[Any], exposure: float) -> Float32:
    """Return what a screen shows: exposed, clipped, sRGB-encoded."""
    return srgb_encoded(np.clip(np.asarray(linear, np.float32) * np.float32(exposure), 0.0, 1.0))


def split(fractions: NDArray[Any], count: int) -> list[NDArray[np.uint8]]:
    """Return the bytes of numbers in [0, 1], the most significant first."""
    codes = np.rint(np.clip(fractions.astype(np.float64), 0.0, 1.0) * (256**count - 1)).astype(np.int64)
    return [((codes >> (8 * place)) & 255).astype(np.uint8) for place in reversed(range(count))]


def write_frames(folder: Path, frames: Sequence[Frame], depth: str) -> Shot:
    """Write frames as such a capture has them, and open the folder.

    Args:
        folder: an empty one.
        frames: of one size, with exposures.
        depth: key of `DEPTHS`.
    """
    count, kind = DEPTHS[depth]
    width, height = frames[0].size
    for index, frame in enumerate(frames):
        color = np.rint(displayed(np.asarray(frame.color), frame.exposure or 1.0) * 255.0).astype(np.uint8)
        uv = -frame.motion / np.array([width, height])  # current minus previous
        along = (uv - UV_RANGE[0]) / (UV_RANGE[1] - UV_RANGE[0])
        motion = [*split(along[..., 0], 2), *split(along[..., 1], 2)]
        distance = np.divide(NEAR, frame.depth, out=np.full(frame.depth.shape, FAR), where=frame.depth > 0)
        device = (frame.depth - NEAR / FAR) / (1 - NEAR / FAR)
        depths = split(distance / FAR if kind == "linear" else device, count)
        for name, planes in {"motion": motion, "depth": depths * (3 // count)}.items():
            write_png(folder / name / f"{index:04d}.png", np.stack(planes, axis=-1))
        write_png(folder / "color" / f"{index:04d}.png", color)
    channels: ChannelMap = {
        "color": [f"color/*.png:{name}" for name in "RGB"],
        "motion": {
            "bytes": [["motion/*.png:R", "motion/*.png:G"], ["motion/*.png:B", "motion/*.png:A"]],
            "range": UV_RANGE,
        },
        "depth": {
            "bytes": [f"depth/*.png:{name}" for name in "RGB"[:count]],
            "range": [0.0, FAR if kind == "linear" else 1.0],
        },
    }
    conventions = Conventions.from_json({
        "srgb": True, "motion_unit": "uv", "motion_direction": "current_minus_previous",
        "depth": kind, "near": NEAR, "far": FAR,
    })  # fmt: skip
    return import_channels(folder, channels, conventions=conventions)


def imported(frames: Sequence[Frame], depth: str) -> list[Frame]:
    """Return frames as they come back from files of integers; their exposure is 1."""
    with TemporaryDirectory() as folder:
        read = [item.frame for item in write_frames(Path(folder), frames, depth)]
    return [replace(one, jitter=frame.jitter, exposure=1.0) for one, frame in zip(read, frames, strict=True)]


def without_jitter(frames: Sequence[Frame]) -> list[Frame]:
    """Render the frames again, sampled at the centres of their pixels."""
    renderer, sequence = Renderer(DISPLAY_SIZE, samples=1), Plaza()
    return [
        rendered_frame(renderer, sequence.scene(index), frame.size, (0.0, 0.0), reset=frame.reset)
        for index, frame in enumerate(frames)
    ]


def variants(frames: Sequence[Frame]) -> dict[str, Sequence[Frame]]:
    """Return the frames of each row, by its name."""
    found: dict[str, Sequence[Frame]] = {"as rendered": frames}
    read = {depth: imported(frames, depth) for depth in DEPTHS}
    for name, field in ONE_FIELD.items():
        coded = read.get(name, read[LINEAR])
        exposed = ("color", "exposure") if field == "color" else (field,)
        found[name] = [
            replace(frame, **{each: getattr(other, each) for each in exposed})
            for frame, other in zip(frames, coded, strict=True)
        ]
    still = without_jitter(frames)
    found["no jitter"] = still
    for depth in DEPTHS:
        found[f"all of these, {depth}"] = imported(still, depth)
    return found


def scores(method: str, frames: Sequence[Frame], references: Mapping[int, Float32]) -> dict[str, float]:
    """Return PSNR and tPSNR of a method, in dB, means over the frames with references.

    Args:
        method: a shipped one.
        frames: all of them.
        references: as a screen shows them, by index.
    """
    upscaler = Upscaler(method, display_size=DISPLAY_SIZE, validate="off")
    images: dict[int, Float32] = {}
    for index, frame in enumerate(frames):
        image = upscaler.step(frame)
        if index in references:
            images[index] = crop(displayed(image, frame.exposure or 1.0), BORDER)
    truth = {index: crop(reference, BORDER) for index, reference in references.items()}
    pairs = [index for index in images if index - 1 in images]
    return {
        "psnr": fmean(psnr(images[index], truth[index]) for index in images),
        "tpsnr": fmean(tpsnr(images[i], images[i - 1], truth[i], truth[i - 1]) for i in pairs),
    }


def rows() -> list[dict[str, Any]]:
    """Return all scores, a row for each of `variants`."""
    items = list(Shot.open(SHOT))
    references = {
        item.index: displayed(item.reference, item.frame.exposure or 1.0)
        for item in items
        if item.reference is not None
    }
    return [
        {"frames": name, "methods": {method: scores(method, frames, references) for method in METHODS}}
        for name, frames in variants([item.frame for item in items]).items()
    ]


def markdown_table(record: Record) -> str:
    """Return the table of a record, with its caption."""
    metrics = {"psnr": "PSNR", "tpsnr": "tPSNR"}
    heads = [f"{metric} dB, {method}:" for method in METHODS for metric in metrics.values()]
    cells = [
        [row["frames"], *(figure(row["methods"][method][name], 2) for method in METHODS for name in metrics)]
        for row in record["rows"]
    ]
    width, height = DISPLAY_SIZE
    caption = (
        f"The shot {SHOT} at a ratio of 2 to {width}x{height}: means over its frames with references, "
        f"without a border of {BORDER} pixels. Images and references are compared as a screen shows "
        f"them, clipped at white. Depth is reversed, from {NEAR:g} to {FAR:g} units, or linear up to {FAR:g}."
    )
    return table(["frames", *heads], cells, caption)


def main(json: JSON = None, update: UPDATE = None) -> None:
    """Measure each loss on its own, and all of them."""
    tables = {"study integer-frames": markdown_table}
    check_page(update, tables)
    publish({"bench": "integer-frames", "rows": rows()}, tables, json, update)


if __name__ == "__main__":
    typer.run(main)
