"""Gain by a reactive mask on particles and on a screen, which have no motion vectors of their own.

The mask of the rendered shots is what FSR2's helper makes of the colour before and after transparency:
SCALE times the largest difference of a toned channel, at most MOST. That of the screen is MOST on it.

    python bench/studies/reactive_mask.py --json bench/results/studies/reactive-mask.json \
        --update docs/quality.md
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
import typer
from numpy.typing import NDArray

from supersampler import Frame, Upscaler, halton_jitter
from supersampler.frame import Float32, Size
from supersampler.io.display import display_transform
from supersampler_bench.cli.options import JSON, UPDATE, check_page, publish
from supersampler_bench.markdown_table import figure, table
from supersampler_bench.quality.metrics import crop, psnr
from supersampler_bench.record import Record
from supersampler_bench.shots.public_shots import TEST_SHOTS
from supersampler_bench.shots.rendered_frame import rendered_frame
from supersampler_bench.stress.scenes import truth
from supersampler_model.data.renderer.renderer import Renderer
from supersampler_model.data.scenes.analytic import EXTENT, FAR, Scene, Surface, Values, checker, zone_plate
from supersampler_model.data.sequences import SequenceSpec, make_sequence

RENDER, DISPLAY, RATIO = (160, 90), (320, 180), 2.0
FRAMES, SCORED, BORDER, SAMPLES = 24, 12, 8, 16
SCALE, MOST = 5.0, 0.9
METHODS = ("taa", "taau", "classifier")
SHOTS = {"machine_hall": "sparks and steam", "night_garden": "fireflies", "market": "dust and smoke"}
SCREEN = "a screen"


class Shown(NamedTuple):
    """A frame with its mask, and what it should look like; None where it is not scored."""

    frame: Frame
    reference: Float32 | None
    exposure: float


@dataclass(frozen=True)
class Screen(Scene):
    """A static wall, with a screen on it that shows moving images without motion vectors."""

    def surface(self, index: int, x: Values, y: Values) -> Surface:
        """See `Scene`."""
        inside = on_screen(x, y)[..., None]
        moved = x - 1.3 * index, y + 0.7 * index
        color = np.where(inside, zone_plate(*moved), checker(x, y))
        still, depth = np.zeros((*x.shape, 2)), np.full(x.shape, FAR)
        normal = np.broadcast_to([0.0, 0.0, 1.0], (*x.shape, 3))
        return Surface(color, depth, still, depth, normal, normal)


def on_screen(x: Values, y: Values) -> NDArray[np.bool_]:
    """Return where the screen is."""
    across, down = np.abs(x / EXTENT[0] - 0.5), np.abs(y / EXTENT[1] - 0.5)
    return np.asarray((across < 0.25) & (down < 0.25))


def frames_of_screen() -> Iterator[Shown]:
    """Yield the frames of `Screen`."""
    scene, (w, h) = Screen(), RENDER
    for index in range(FRAMES):
        jitter = halton_jitter(index, RATIO)
        frame = scene.frame(index, RENDER, jitter)
        x, y = (np.arange(w) + 0.5 + jitter[0]) / w, (np.arange(h)[:, None] + 0.5 + jitter[1]) / h
        there = on_screen(x * EXTENT[0] + 0.0 * y, y * EXTENT[1] + 0.0 * x)
        mask = np.where(there, np.float32(MOST), np.float32(0.0))
        reference = truth(scene, index, DISPLAY) if index >= FRAMES - SCORED else None
        yield Shown(replace(frame, reactive=mask), reference, 1.0)


def frames_of_shot(family: str) -> Iterator[Shown]:
    """Render the frames of a test shot, with a mask of its particles."""
    renderer = Renderer(DISPLAY, samples=SAMPLES)
    sequence = make_sequence(SequenceSpec(family=family, seed=TEST_SHOTS.seeds[family], frames=FRAMES))
    for index in range(FRAMES):
        scene, jitter = sequence.scene(index), halton_jitter(index, RATIO)
        frame = rendered_frame(renderer, scene, RENDER, jitter, reset=sequence.cut(index))
        opaque, _ = renderer.frame(replace(scene, particles=()), RENDER, jitter=jitter)
        exposure = scene.camera.exposure
        mask = difference_mask(np.asarray(frame.color), opaque, exposure)
        reference = renderer.reference(scene).color if index >= FRAMES - SCORED else None
        yield Shown(replace(frame, reactive=mask), reference, exposure)


def difference_mask(color: NDArray[Any], opaque: NDArray[Any], exposure: float) -> Float32:
    """Return the mask (h, w) of the pixels that transparent objects cover."""
    after, before = (display_transform(each.astype(np.float32), exposure) for each in (color, opaque))
    mask: Float32 = np.minimum(SCALE * np.abs(after - before).max(axis=2), np.float32(MOST))
    return mask.astype(np.float32)


def masked_pixels(mask: Float32, jitter: tuple[float, float], display: Size) -> NDArray[np.bool_]:
    """Return the display pixels whose nearest sample has a mask."""
    columns, rows = (
        np.clip(np.floor((np.arange(big) + 0.5) * small / big - offset), 0, small - 1).astype(int)
        for big, small, offset in zip(display, mask.shape[::-1], jitter, strict=True)
    )
    return np.asarray(mask[rows[:, None], columns] > 0.05)


def scores(content: str, shown: list[Shown]) -> list[dict[str, Any]]:
    """Return the rows of a scene: errors with and without its masks."""
    rows = []
    for method in METHODS:
        row: dict[str, Any] = {"scene": content, "method": method, "masked": 0.0}
        for name in ("without", "with"):
            upscaler = Upscaler(method, display_size=DISPLAY, validate="off")
            whole, inside = list[float](), list[float]()
            for frame, reference, exposure in shown:
                image = upscaler.step(frame if name == "with" else replace(frame, reactive=None))
                if reference is None or frame.reactive is None:
                    continue
                there = masked_pixels(np.asarray(frame.reactive), frame.jitter, DISPLAY)
                pair = [crop(display_transform(one, exposure), BORDER) for one in (image, reference)]
                row["masked"] += float(there.mean()) / SCORED / 2
                whole.append(psnr(pair[0], pair[1]))
                inside.append(psnr(pair[0], pair[1], crop(there, BORDER)))
            row[name] = {"whole": float(np.nanmean(whole)), "inside": float(np.nanmean(inside))}
        rows.append(row)
    return rows


def rows() -> list[dict[str, Any]]:
    """Return all scores."""
    found = scores(SCREEN, list(frames_of_screen()))
    for family, content in SHOTS.items():
        found += scores(f"{content} ({family})", list(frames_of_shot(family)))
    return found


def markdown_table(record: Record) -> str:
    """Return the table of a record, with its caption."""
    cells = [
        [
            row["scene"],
            row["method"],
            f"{100.0 * row['masked']:.1f} %",
            *(figure(row[name][part], 2) for part in ("inside", "whole") for name in ("without", "with")),
        ]
        for row in record["rows"]
    ]
    heads = [
        "scene", "method", "masked pixels:", "PSNR dB there, no mask:", "PSNR dB there, mask:",
        "PSNR dB, no mask:", "PSNR dB, mask:",
    ]  # fmt: skip
    caption = (
        f"Ratio {RATIO:g} to {DISPLAY[0]}x{DISPLAY[1]}; the last {SCORED} of {FRAMES} frames, without a "
        f"border of {BORDER} pixels. Masks are {SCALE:g} times the largest difference of a toned channel "
        f"that particles make, at most {MOST:g}; on the screen, {MOST:g}."
    )
    return table(heads, cells, caption)


def main(json: JSON = None, update: UPDATE = None) -> None:
    """Measure with and without masks."""
    tables = {"study reactive-mask": markdown_table}
    check_page(update, tables)
    publish({"bench": "reactive-mask", "rows": rows()}, tables, json, update)


if __name__ == "__main__":
    typer.run(main)
