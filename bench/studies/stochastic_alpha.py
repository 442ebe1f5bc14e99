"""Stochastic alpha test (Salvi 2016): leaves that three of four samples miss, averaged by `taa`.

Each sample hits a leaf of opacity 0.25, or what is behind it, by chance. The reference blends the two.

    python bench/studies/stochastic_alpha.py --json bench/results/studies/stochastic-alpha.json \
        --update docs/results/methods.md --image docs/images/stochastic-alpha.png
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from statistics import fmean
from typing import Annotated, Any

import numpy as np
import typer

from studies.salvi_options import TaaSteps
from supersampler import Frame, halton_jitter
from supersampler.frame import Float32, Size
from supersampler.io.display import display_transform, to_uint8
from supersampler.io.images import write_png
from supersampler.methods.taa.spec import TaaConfig
from supersampler_bench.cli.options import JSON, UPDATE, check_page, publish
from supersampler_bench.markdown_table import figure, table
from supersampler_bench.quality.metrics import crop, psnr, tpsnr
from supersampler_bench.record import Record
from supersampler_model.data.scenes.analytic import (
    EXTENT,
    FAR,
    NEAR,
    Scene,
    Surface,
    Values,
    Vector,
    checker,
    facing,
    places,
)

SIZE = (256, 144)  # of frames and images: Salvi works at one size
OPACITY = 0.25
FRAMES, SCORED, BORDER = 64, 32, 8
PANEL, GAP = 96, 4  # side of the image's parts and what is between, pixels; they are shown at twice the size
SCENES: Mapping[str, Vector] = {"at rest": (0.0, 0.0), "in motion": (0.31, -0.12)}
"""Velocity of the leaves, scene units a frame; the background is static."""
OPTIONS: Mapping[str, TaaConfig | None] = {
    "one frame": None,
    "3x3 window": TaaConfig(),
    "7x7 window": TaaConfig(window=7),
    "7x7 window, no minimum and maximum": TaaConfig(window=7, intersect_extent=False),
}


@dataclass(frozen=True)
class Foliage(Scene):
    """Leaves of `OPACITY` in front of a pattern; they pan by `velocity`, units a frame."""

    velocity: Vector = (0.0, 0.0)

    def surface(self, index: int, x: Values, y: Values) -> Surface:
        """Return the two layers blended, with depth and motion of what is behind."""
        behind, leaves, inside = self.layers(index, x, y)
        blended = behind.color + OPACITY * inside[..., None] * (leaves.color - behind.color)
        return behind._replace(color=blended)

    def layers(self, index: int, x: Values, y: Values) -> tuple[Surface, Surface, Values]:
        """Return what is behind, the leaves, and 1 where there is one, else 0."""
        there = x - index * self.velocity[0], y - index * self.velocity[1]
        color, inside = leaf_at(*there)
        normal, zero = facing(x, y), np.zeros((*x.shape, 2))
        far, near = np.full(x.shape, FAR), np.full(x.shape, NEAR)
        motion = zero - np.array(self.velocity)
        return (
            Surface(0.4 * checker(x, y), far, zero, far, normal, normal),
            Surface(color, near, motion, near, normal, normal),
            inside,
        )

    def frame(self, index: int, size: Size, jitter: Vector = (0.0, 0.0)) -> Frame:
        """Sample the scene once a pixel; by chance a sample passes through a leaf."""
        behind, leaves, inside = self.layers(index, *places(size, jitter))
        hit = np.random.default_rng([7, index]).random(inside.shape) < OPACITY * inside
        color, depth, motion = (
            np.where(hit if one.ndim == 2 else hit[..., None], other, one)
            for one, other in zip(behind[:3], leaves[:3], strict=True)
        )
        frame = super().frame(index, size, jitter)
        return replace(
            frame,
            color=color.astype(np.float32),
            depth=depth.astype(np.float32),
            motion=(motion * np.array(size) / EXTENT).astype(np.float32),
        )


def leaf_at(x: Values, y: Values) -> tuple[Values, Values]:
    """Return the colour (..., 3) of the leaf at (x, y) units, and 1 where there is one: one in most cells."""
    side = 4.0
    column, row = np.floor(x / side), np.floor(y / side)
    chance = [np.modf(np.abs(np.sin(column * 12.9898 + row * 78.233 + k) * 43758.5453))[0] for k in range(4)]
    angle = np.pi * chance[0]
    dx, dy = x - (column + 0.35 + 0.3 * chance[1]) * side, y - (row + 0.35 + 0.3 * chance[2]) * side
    along, across = np.cos(angle) * dx + np.sin(angle) * dy, np.cos(angle) * dy - np.sin(angle) * dx
    inside = ((along / 1.9) ** 2 + (across / 0.9) ** 2 < 1.0) & (chance[3] < 0.85)
    light = 0.5 + 0.5 * chance[3]
    color = np.stack([0.75 * light, 0.95 * light, 0.2 * light], axis=-1)
    return color, inside.astype(np.float64)


def images_of(scene: Foliage, config: TaaConfig | None) -> list[Float32]:
    """Return the last SCORED + 1 of FRAMES images; those of the frames alone where `config` is None."""
    steps, images = None if config is None else TaaSteps(config, SIZE), []
    for index in range(FRAMES):
        frame = scene.frame(index, SIZE, halton_jitter(index, 1.0))
        image = np.asarray(frame.color) if steps is None else steps.step(frame)
        images.append(display_transform(image, 1.0))
    return images[-SCORED - 1 :]


def scores(images: list[Float32], truth: list[Float32]) -> dict[str, float]:
    """Return PSNR and tPSNR in dB, means over the last SCORED images."""
    shown, true = ([crop(image, BORDER) for image in sequence] for sequence in (images, truth))
    return {
        "psnr": fmean(psnr(shown[i], true[i]) for i in range(1, len(shown))),
        "tpsnr": fmean(tpsnr(shown[i], shown[i - 1], true[i], true[i - 1]) for i in range(1, len(shown))),
    }


def measure() -> tuple[list[dict[str, Any]], list[list[Float32]]]:
    """Return all scores, and for each scene the last images of all options and of the reference."""
    found: dict[str, dict[str, dict[str, float]]] = {option: {} for option in OPTIONS}
    last = []
    for name, velocity in SCENES.items():
        scene = Foliage(velocity)
        truth = [display_transform(scene.truth(i, SIZE, 8), 1.0) for i in range(FRAMES - SCORED - 1, FRAMES)]
        shown = []
        for option, config in OPTIONS.items():
            images = images_of(scene, config)
            found[option][name] = scores(images, truth)
            shown.append(images[-1])
        last.append([*shown, truth[-1]])
    return [{"method": option, "scenes": scenes} for option, scenes in found.items()], last


def write_image(path: Path, last: list[list[Float32]]) -> None:
    """Write parts of the images side by side, a row for each scene, at twice the size."""
    top, left = (SIZE[1] - PANEL) // 2, (SIZE[0] - PANEL) // 2
    pixels = np.full((len(last) * (PANEL + GAP) - GAP, len(last[0]) * (PANEL + GAP) - GAP, 3), 255, np.uint8)
    for row, shown in enumerate(last):
        for column, one in enumerate(shown):
            part = to_uint8(one[top : top + PANEL, left : left + PANEL])
            y, x = row * (PANEL + GAP), column * (PANEL + GAP)
            pixels[y : y + PANEL, x : x + PANEL] = part
    write_png(path, pixels.repeat(2, axis=0).repeat(2, axis=1))


def markdown_table(record: Record) -> str:
    """Return the table of a record, with its caption."""
    metrics = {"psnr": "PSNR", "tpsnr": "tPSNR"}
    heads = [f"{metric} dB, {scene}:" for scene in SCENES for metric in metrics.values()]
    cells = [
        [row["method"], *(figure(row["scenes"][scene][name], 2) for scene in SCENES for name in metrics)]
        for row in record["rows"]
    ]
    caption = (
        f"Leaves of opacity {OPACITY:g} in front of a checkerboard, {SIZE[0]}x{SIZE[1]} at a ratio of 1, one "
        f"sample a pixel; means over the last {SCORED} of {FRAMES} frames, without a border of {BORDER} "
        "pixels. The reference blends leaves and background."
    )
    return table(["taa", *heads], cells, caption)


def main(
    json: JSON = None,
    update: UPDATE = None,
    image: Annotated[Path | None, typer.Option(help="Write parts of the last images here.")] = None,
) -> None:
    """Measure windows of 3x3 and 7x7 samples."""
    tables = {"study stochastic-alpha": markdown_table}
    check_page(update, tables)
    rows, last = measure()
    if image is not None:
        write_image(image, last)
    publish({"bench": "stochastic-alpha", "rows": rows}, tables, json, update)


if __name__ == "__main__":
    typer.run(main)
