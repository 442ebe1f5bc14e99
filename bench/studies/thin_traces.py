"""Traces that a moving wire leaves on the wall behind it, and the contrast of a wire that moves along itself.

python bench/studies/thin_traces.py --json bench/results/studies/thin-traces.json --update docs/quality.md
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import typer

from supersampler import Upscaler, halton_jitter
from supersampler.frame import Float32
from supersampler_bench.cli.options import JSON, UPDATE, check_page, publish
from supersampler_bench.markdown_table import figure, table
from supersampler_bench.record import Record
from supersampler_model.data.scenes.analytic import EXTENT, FAR, NEAR, Scene, Surface, Values, grey

RENDER, DISPLAY, RATIO = (96, 54), (192, 108), 2.0
FRAMES, BORDER = 20, 16
METHODS = ("taa", "taau", "classifier-small", "classifier", "classifier-large")
SPEEDS = (0.5, 1.0, 2.0, 4.0)
ALONG = 4.0


@dataclass(frozen=True)
class Wire(Scene):
    """A dark wire, 0.6 render pixels wide, before a light wall that stands still.

    Attributes:
        speed: to the right, render pixels a frame.
        level: whether it goes across, and so moves along itself, or down.
    """

    speed: float
    level: bool = False

    WALL, DARK, START, LEAN = 0.9, 0.02, 8.3, 0.05
    WIDTH = 0.6 * EXTENT[0] / RENDER[0]

    @property
    def step(self) -> float:
        """Units a frame."""
        return self.speed * EXTENT[0] / RENDER[0]

    def middle(self, index: int, y: Values) -> Values:
        """Return where a wire that goes down is at these heights, units."""
        return self.START + self.step * index + self.LEAN * y

    def surface(self, index: int, x: Values, y: Values) -> Surface:
        """Return the wire where it is, else the wall."""
        off = y - 0.51 * EXTENT[1] if self.level else x - self.middle(index, y)
        is_wire = np.abs(off) < 0.5 * self.WIDTH
        depth = np.where(is_wire, NEAR, FAR)
        motion = np.where(is_wire[..., None], (-self.step, 0.0), 0.0)
        toward = np.broadcast_to((0.0, 0.0, 1.0), (*x.shape, 3))
        color = grey(np.where(is_wire, self.DARK, self.WALL))
        return Surface(color, depth, motion, depth, toward, toward)


def last_image(upscaler: Upscaler, scene: Scene) -> Float32:
    """Return the image of the last of FRAMES frames."""
    for index in range(FRAMES):
        image = upscaler.step(scene.frame(index, RENDER, halton_jitter(index, RATIO)))
    return image


def trace(upscaler: Upscaler, speed: float) -> float:
    """Return the sum of the wall's errors where an upright wire was before, as a fraction of a whole wire."""
    scene, scale = Wire(speed), DISPLAY[0] / EXTENT[0]
    left = int((scene.middle(FRAMES - 1, np.zeros(1))[0] - 2.0) * scale)
    error = np.abs(last_image(upscaler, scene)[:, :left].mean(axis=2) - scene.WALL).sum()
    whole = (scene.WALL - scene.DARK) * scene.WIDTH * scale * DISPLAY[1]
    return float(error / whole)


def contrast(upscaler: Upscaler, speed: float) -> float:
    """Return the contrast of a level wire that moves along itself: of its darkest row, 1 for a black one."""
    scene = Wire(speed, level=True)
    rows = last_image(upscaler, scene)[:, BORDER:-BORDER].mean(axis=(1, 2))
    return float((scene.WALL - rows.min()) / (scene.WALL - scene.DARK))


def upscaler_of(method: str, **options: Any) -> Upscaler:
    """Return an Upscaler at the sizes of the study."""
    return Upscaler(method, display_size=DISPLAY, validate="off", **options)


def rows() -> list[dict[str, Any]]:
    """Return the figures of each method."""
    return [
        {
            "method": method,
            "traces": [trace(upscaler_of(method), speed) for speed in SPEEDS],
            "along": contrast(upscaler_of(method), ALONG),
        }
        for method in METHODS
    ]


def markdown_table(record: Record) -> str:
    """Return the table of a record, with its caption."""
    cells = [
        [row["method"], *(figure(value, 2) for value in row["traces"]), figure(row["along"], 2)]
        for row in record["rows"]
    ]
    heads = ["method", *(f"trace at {speed:g}:" for speed in SPEEDS), f"contrast along itself at {ALONG:g}:"]
    sizes = " to ".join("x".join(map(str, size)) for size in (RENDER, DISPLAY))
    caption = (
        f"A wire of 0.6 render pixels before a wall at rest, {sizes}; frame {FRAMES}. "
        "Speeds in render pixels a frame."
    )
    return table(heads, cells, caption)


def main(json: JSON = None, update: UPDATE = None) -> None:
    """Measure all methods."""
    tables = {"study thin-traces": markdown_table}
    check_page(update, tables)
    publish({"bench": "thin-traces", "rows": rows()}, tables, json, update)


if __name__ == "__main__":
    typer.run(main)
