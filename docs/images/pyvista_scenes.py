"""Measure PyVista scenes with its anti-aliasing and with ours; write the section of the page, and its image.

    pip install . pyvista sympy
    python docs/images/pyvista_scenes.py [name of a scene ...]

The scenes are those of examples/pyvista_gallery.py. The camera turns by half a degree a frame. All modes
render each frame in turn, so that other load on the machine affects them alike. Errors are those of display
values, against 64 samples a pixel. With names, only out/pyvista.jpg is written.
"""

import runpy
import sys
import time
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
import pyvista as pv
from vtkmodules.vtkRenderingCore import vtkActor2D

from supersampler.frame import Float32
from supersampler.integrations.pyvista import enable_supersampling
from supersampler.integrations.vtk_pixels import Rectangle, WindowPixels
from supersampler.io.display import decibels, to_uint8
from supersampler.io.images import encode_jpeg
from supersampler_bench.record import Provenance
from supersampler_bench.record import table as markdown_table

ROOT = Path(__file__).parents[2]
PAGE, HEADING = ROOT / "docs" / "tutorials" / "pyvista.md", "## Cost and quality"
FIGURE = """![Crops of the scenes: MSAA, while the view turns, at rest, reference](../images/pyvista.jpg)

One row per scene, in the order of the table: MSAA, ours while the camera turns, ours at rest, the reference.
"""
SCENES = runpy.run_path(str(ROOT / "examples" / "pyvista_gallery.py"))["SCENES"]
WAYS = {"none": "none", "msaa": "MSAA", "ssaa": "SSAA", "ours": "supersampled"}
SIZE, FRAMES, WARM, TURN = (1280, 720), 26, 14, 0.5
GRID = 8  # samples of a pixel in each direction, of references
CROP, ZOOM, GAP = (160, 120), 2, 6


class Viewer:
    """A plotter that shows a scene in one way; `seconds` of its frames."""

    def __init__(self, scene: str, way: str) -> None:
        self.plotter = pv.Plotter(off_screen=True, window_size=list(SIZE))
        self.plotter.set_background("white")
        SCENES[scene](self.plotter)
        self.window = None
        if way in ("none", "ssaa"):
            self.plotter.disable_anti_aliasing(all_renderers=True)
            self.plotter.render_window.SetMultiSamples(0)
        if way == "ssaa":
            self.plotter.enable_anti_aliasing("ssaa")
        if way == "ours":
            self.window = enable_supersampling(self.plotter)
        self.plotter.show(auto_close=False)
        self._pixels = WindowPixels(self.plotter.render_window)
        self.seconds: list[float] = []  # of frames, by the clock
        self.cpu: list[float] = []  # and of all threads

    def turn(self) -> None:
        """Turn the camera, and render a frame."""
        self.plotter.camera.Azimuth(TURN)
        self.plotter.renderer.ResetCameraClippingRange()
        began, cpu = time.perf_counter(), time.process_time()
        self.plotter.render()
        self._pixels.read_color(Rectangle(0, 0, 1, 1))  # waits for OpenGL
        self.seconds.append(time.perf_counter() - began)
        self.cpu.append(time.process_time() - cpu)

    def image(self) -> Float32:
        """Return what the window shows, (h, w, 3) display values."""
        return self._pixels.read_color(Rectangle(0, 0, *SIZE))[..., :3] * np.float32(1.0 / 255.0)

    def reference(self) -> Float32:
        """Return the view with 64 samples a pixel; text, which has its own anti-aliasing, as it is."""
        plotter, total = self.plotter, np.zeros((SIZE[1], SIZE[0], 3), np.float32)
        plotter.render()
        with_text = self.image()
        texts = [
            p for p in plotter.renderer.GetViewProps() if isinstance(p, vtkActor2D) and p.GetVisibility()
        ]
        for text in texts:
            text.VisibilityOff()
        plotter.render()
        is_text = np.any(with_text != self.image(), axis=-1)
        for index in range(GRID * GRID):
            x, y = ((index % GRID + 0.5) / GRID - 0.5, (index // GRID + 0.5) / GRID - 0.5)
            plotter.camera.SetWindowCenter(2.0 * x / SIZE[0], 2.0 * y / SIZE[1])
            plotter.render()
            total += self.image()
        plotter.camera.SetWindowCenter(0.0, 0.0)
        for text in texts:
            text.VisibilityOn()
        total /= GRID * GRID
        total[is_text] = with_text[is_text]
        return total


def measure(scene: str) -> tuple[dict[str, Any], list[np.ndarray[Any, Any]]]:
    """Return the times and errors of a scene by way, and a row of crops: MSAA, moving, at rest, reference."""
    viewers = {way: Viewer(scene, way) for way in WAYS}
    truth = Viewer(scene, "none")
    for _ in range(FRAMES):
        for viewer in viewers.values():
            viewer.turn()
        truth.plotter.camera.Azimuth(TURN)
        truth.plotter.renderer.ResetCameraClippingRange()
    reference = truth.reference()
    moving = {way: decibels(error(viewer.image(), reference)) for way, viewer in viewers.items()}
    shown = {"MSAA": viewers["msaa"].image(), "moving": viewers["ours"].image()}
    ours = viewers["ours"].window
    row: dict[str, Any] = {"bypassed": ours.is_bypassed, "scale": ours.pace.scale}
    ours.converge()
    shown |= {"at rest": viewers["ours"].image(), "reference": reference}
    for way, viewer in viewers.items():
        rest = error(viewer.image(), reference)
        row[way] = (*spread(viewer.seconds[WARM:]), spread(viewer.cpu[WARM:])[0], moving[way], decibels(rest))
    for viewer in (*viewers.values(), truth):
        viewer.plotter.close()
    return row, crops(shown)


def spread(seconds: list[float]) -> tuple[float, float, float]:
    """Return median, minimum and maximum in ms."""
    return 1000 * median(seconds), 1000 * min(seconds), 1000 * max(seconds)


def error(image: Float32, reference: Float32) -> float:
    """Return the mean square error."""
    return float(np.square(image - reference, dtype=np.float64).mean())


def crops(images: dict[str, Float32]) -> list[np.ndarray[Any, Any]]:
    """Return one crop of each image, enlarged by nearest pixels: where the reference has most detail."""
    (width, height), reference = CROP, images["reference"]
    detail = np.abs(np.diff(reference.mean(axis=-1), axis=1, append=1.0))
    rows, columns = detail.shape[0] // height, detail.shape[1] // width
    blocks = detail[: rows * height, : columns * width].reshape(rows, height, columns, width)
    row, column = np.unravel_index(blocks.mean(axis=(1, 3)).argmax(), (rows, columns))
    part = slice(row * height, (row + 1) * height), slice(column * width, (column + 1) * width)
    return [to_uint8(image[part]).repeat(ZOOM, axis=0).repeat(ZOOM, axis=1) for image in images.values()]


def table(rows: dict[str, dict[str, Any]]) -> str:
    """Return the table of the page, with its caption."""
    heads = ["scene", "MSAA ms", "SSAA ms", "ours ms", "ours / MSAA, wall time", "CPU time", "scale"]
    heads += ["no AA dB", "MSAA dB", "SSAA dB", "ours dB", "ours at rest dB"]
    lines = []
    for scene, row in rows.items():
        none, msaa, ssaa, ours = (row[way] for way in WAYS)
        scale = "off" if row["bypassed"] else f"{row['scale']:g}"
        times = [f"{way[0]:.0f} ({way[1]:.0f} to {way[2]:.0f})" for way in (msaa, ours)]
        shares = [f"{ours[0] / msaa[0]:.2f}", f"{ours[3] / msaa[3]:.2f}"]
        errors = [f"{value:.1f}" for value in (none[4], msaa[4], ssaa[4], ours[4], ours[5])]
        lines.append([scene, times[0], f"{ssaa[0]:.0f}", times[1], *shares, scale, *errors])
    now = Provenance.now()
    where = f"{now.machine['cpu']}, {now.machine['cores']} cores"
    commit = (now.commit or "unknown")[:8]
    caption = (
        f"The camera turns by {TURN:g} degrees a frame; {SIZE[0]}x{SIZE[1]}. Medians of {FRAMES - WARM} "
        f"frames after {WARM}, with minimum and maximum; the modes alternate. Scale: window size / render "
        "size, chosen by times; off: upscaling does not pay, and frames are PyVista's own. PSNR of display "
        f"values of the last frame against {GRID * GRID} samples a pixel; at rest: after `converge()`. VTK "
        f"{'.'.join(map(str, pv.vtk_version_info))}, {opengl()}; {where}. Measured on "
        f"{now.date[:10]} at commit {commit} by `python docs/images/pyvista_scenes.py`."
    )
    return markdown_table([heads[0], *(f"{head}:" for head in heads[1:])], lines, caption)


def opengl() -> str:
    """Return the name of the OpenGL renderer."""
    plotter = pv.Plotter(off_screen=True)
    plotter.show(auto_close=False)
    lines = plotter.render_window.ReportCapabilities().splitlines()
    plotter.close()
    return next((line.partition(":")[2].strip() for line in lines if "renderer string" in line), "unknown")


def main(names: list[str]) -> None:
    """Measure the scenes."""
    rows, figure = {}, []
    for scene in names or SCENES:
        rows[scene], parts = measure(scene)
        print(table({scene: rows[scene]}), flush=True)
        padded = [np.pad(part, ((0, GAP), (0, GAP), (0, 0)), constant_values=255) for part in parts]
        figure.append(np.concatenate(padded, axis=1))
    out = ROOT / "out" / "pyvista.jpg" if names else ROOT / "docs" / "images" / "pyvista.jpg"
    out.parent.mkdir(exist_ok=True)
    out.write_bytes(encode_jpeg(np.concatenate(figure), quality=90))
    if not names:
        before = PAGE.read_text().partition(HEADING)[0].rstrip()
        PAGE.write_text(f"{before}\n\n{HEADING}\n\n{table(rows)}\n\n{FIGURE}")


if __name__ == "__main__":
    main(sys.argv[1:])
