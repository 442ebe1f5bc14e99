"""A PyVista viewer, supersampled: time of a frame and error against MSAA and SSAA, side by side in one run.

    python bench/studies/pyvista_frames.py --json FILE --image FILE --update PAGE

The scene is that of examples/pyvista_viewer.py: the camera turns and a ring moves. Each frame is rendered in
every way, one after the other, so that all share what else the machine does. The error is that of display
values, against images of 64 samples a pixel. Needs `pip install . pyvista`.
"""

import runpy
from pathlib import Path
from time import perf_counter
from typing import Annotated, Any

import numpy as np
import pyvista as pv
import typer
from vtkmodules.vtkCommonCore import vtkUnsignedCharArray

from studies.pyvista_table import WAYS, markdown_table
from supersampler.cli.arguments import parse_size
from supersampler.frame import Float32, Size
from supersampler.integrations.pyvista import enable_supersampling
from supersampler.io.display import decibels, to_uint8
from supersampler.io.files import replacing
from supersampler.io.images import encode_jpeg
from supersampler_bench.cli.options import JSON, UPDATE, check_page, counted, listed, publish

EXAMPLE = runpy.run_path(str(Path(__file__).parents[2] / "examples" / "pyvista_viewer.py"))
TURN = 0.5  # degrees a frame
REST = 32  # frames of the last view, for the error at rest
FINER, SHIFTS = 4, (-0.25, 0.25)  # of references: larger windows, and shifts in their pixels
ZOOM, CROP, GAP = 2, (240, 200), 8  # of the figure: width and height of a crop, in image pixels


class Viewer:
    """A plotter that renders in one way; `seconds` and `glue` are of its frames.

    Glue is the time of a frame without VTK's renders (the small one; of what moved, for its motion; of text
    and other renderers on top) and without the step of the method: jitter, reading colour and depth, motion,
    showing the image.
    """

    def __init__(self, size: Size, way: str, scale: float) -> None:
        self.plotter = EXAMPLE["scene"](size, off_screen=True)
        self.plotter.disable_anti_aliasing()
        self.plotter.render_window.SetMultiSamples(0)
        self.seconds: list[float] = []
        self.glue: list[float] = []
        self.steps: list[float] = []
        self._pixel = vtkUnsignedCharArray()
        self._nested = 0
        self._nested_began = self._nested_seconds = 0.0
        self._window = None
        if way == "msaa":
            self.plotter.enable_anti_aliasing("msaa")
        elif way == "ssaa":
            self.plotter.enable_anti_aliasing("ssaa")
        elif way != "none":
            window = self.plotter.render_window
            window.AddObserver("StartEvent", lambda *_: self._stamp("before", 1), 1.0)
            self._window = enable_supersampling(self.plotter, scale=scale, model=way)
            window.AddObserver("StartEvent", lambda *_: self._stamp("render", 0), -1.0)
            window.AddObserver("EndEvent", lambda *_: self._stamp("after", 0), 1.0)
            window.AddObserver("EndEvent", lambda *_: self._stamp("end", -1), -1.0)
        self._stamps: dict[str, float] = {}

    def _stamp(self, name: str, depth: int) -> None:
        """Note the times of a frame's own render, and the sum of those nested in it."""
        if name == "before" and self._nested == 0:
            self._stamps, self._nested_seconds = {}, 0.0
        elif name == "before":
            self._nested_began = perf_counter()
        self._nested += depth
        if name == "end" and self._nested == 1:
            self.finish()
            self._nested_seconds += perf_counter() - self._nested_began
        if name == "after" and name not in self._stamps:
            self.finish()
        self._stamps.setdefault(name, perf_counter())

    def finish(self) -> None:
        """Wait until OpenGL is done."""
        self.plotter.render_window.GetPixelData(0, 0, 1, 1, 0, self._pixel, 0)

    def render(self, index: int) -> None:
        """Render a frame, and note its times."""
        EXAMPLE["pose"](self.plotter, index, angle=TURN * index)
        before = self._step_seconds()
        began = perf_counter()
        self.plotter.render()
        self.finish()
        self.seconds.append(perf_counter() - began)
        if self._window is not None:
            self.steps.append(self._step_seconds() - before)
            rendering = self._stamps["after"] - self._stamps["render"] + self._nested_seconds
            self.glue.append(self.seconds[-1] - rendering - self.steps[-1])

    def _step_seconds(self) -> float:
        upscaler = None if self._window is None else self._window.upscaler
        return 0.0 if upscaler is None else upscaler.stats.seconds

    def image(self) -> Float32:
        """Return what the window shows, (h, w, 3) display values."""
        pixels = np.asarray(self.plotter.screenshot(return_img=True))
        return pixels.astype(np.float32) / np.float32(255.0)


def reference(viewer: Viewer, size: Size, index: int) -> Float32:
    """Return a frame with 64 samples a pixel, of a viewer whose window is `FINER` times as large."""
    plotter, total = viewer.plotter, np.zeros((size[1], size[0], 3))
    for x in SHIFTS:
        for y in SHIFTS:
            plotter.camera.SetWindowCenter(2.0 * x / (FINER * size[0]), 2.0 * y / (FINER * size[1]))
            viewer.render(index)
            total += viewer.image().reshape(size[1], FINER, size[0], FINER, 3).mean(axis=(1, 3))
    plotter.camera.SetWindowCenter(0.0, 0.0)
    image: Float32 = (total / len(SHIFTS) ** 2).astype(np.float32)
    return image


def measure(
    size: Size, scale: float, models: list[str], frames: int, compared: int
) -> tuple[dict[str, Any], dict[str, Float32]]:
    """Return the record, and the last frame of each way and of the reference."""
    ways = [*WAYS, "bicubic", *models]
    viewers = {way: Viewer(size, way, scale) for way in ways}
    truth = Viewer((FINER * size[0], FINER * size[1]), "none", scale)
    errors: dict[str, list[float]] = {way: [] for way in ways}
    images: dict[str, Float32] = {}
    with counted("frames", frames) as on_frame:
        for index in range(frames):
            for viewer in viewers.values():
                viewer.render(index)
            if index >= frames - compared:
                images = {way: viewer.image() for way, viewer in viewers.items()}
                images["reference"] = reference(truth, size, index)
                for way in ways:
                    errors[way].append(
                        float(np.square(images[way] - images["reference"], dtype=np.float64).mean())
                    )
            on_frame()
    rest = {way: errors[way][-1] for way in ways}
    for way in ways:
        if way not in WAYS:  # the others would render the same image again
            for _ in range(REST):
                viewers[way].render(frames - 1)
            rest[way] = float(np.square(viewers[way].image() - images["reference"], dtype=np.float64).mean())
    warm = min(4, frames - 1)  # these compile and allocate
    rows = [
        {
            "way": way,
            "seconds": viewer.seconds[warm:frames],
            "glue": viewer.glue[warm:frames],
            "step": viewer.steps[warm:frames],
            "psnr": decibels(float(np.mean(errors[way]))),
            "psnr_at_rest": decibels(rest[way]),
        }
        for way, viewer in viewers.items()
    ]
    window = viewers["msaa"].plotter.render_window
    record = {
        "bench": "pyvista_frames",
        "display_size": list(size),
        "scale": scale,
        "frames": frames,
        "warm_up": warm,
        "compared": compared,
        "rest": REST,
        "turn": TURN,
        "cells": truth.plotter.meshes[0].n_cells,
        "msaa_samples": window.GetMultiSamples(),
        "opengl": opengl(window),
        "pyvista": pv.__version__,
        "vtk": ".".join(map(str, pv.vtk_version_info)),
        "rows": rows,
    }
    return record, images


def opengl(window: Any) -> str:
    """Return the name of the renderer of a window."""
    lines = window.ReportCapabilities().splitlines()
    return next((line.partition(":")[2].strip() for line in lines if "renderer string" in line), "unknown")


def side_by_side(images: dict[str, Float32], ways: list[str]) -> bytes:
    """Return a JPEG of one crop of each way, enlarged by nearest pixels: where they differ most."""
    width, height = CROP
    difference = np.abs(images["none"] - images["reference"]).sum(axis=2)
    rows, columns = difference.shape[0] // height, difference.shape[1] // width
    blocks = difference[: rows * height, : columns * width].reshape(rows, height, columns, width)
    row, column = np.unravel_index(blocks.mean(axis=(1, 3)).argmax(), (rows, columns))
    parts = []
    for way in ways:
        part = images[way][row * height : (row + 1) * height, column * width : (column + 1) * width]
        pixels = to_uint8(part).repeat(ZOOM, axis=0).repeat(ZOOM, axis=1)
        parts.append(np.pad(pixels, ((0, GAP), (0, GAP), (0, 0)), constant_values=255))
    return encode_jpeg(np.concatenate(parts, axis=1), quality=90)


def main(
    models: Annotated[str, typer.Option(help="Models, with commas between.")] = "classifier,taau",
    display_size: Annotated[str, typer.Option(help="Of the window.")] = "1280x720",
    scale: Annotated[float, typer.Option(min=1.0, help="Window over render size.")] = 2.0,
    frames: Annotated[int, typer.Option(min=2, help="Of the sequence.")] = 36,
    compared: Annotated[int, typer.Option(min=1, help="The last ones, with references.")] = 4,
    image: Annotated[Path | None, typer.Option(help="Write crops side by side here, as JPEG.")] = None,
    json: JSON = None,
    update: UPDATE = None,
) -> None:
    """Time a PyVista viewer with MSAA, SSAA and models."""
    tables = {"study pyvista": markdown_table}
    check_page(update, tables)
    record, images = measure(
        parse_size(display_size, "--display-size"), scale, listed(models), frames, compared
    )
    publish(record, tables, json, update)
    if image is not None:
        with replacing(image) as partial:
            partial.write_bytes(side_by_side(images, ["none", "msaa", listed(models)[0], "reference"]))


if __name__ == "__main__":
    typer.run(main)
