"""View a frog, segmented into its organs, in a PyVista viewer that upscales while the view moves.

    pip install . pyvista
    python examples/pyvista_viewer.py --frames 48 -o out/viewer

The camera turns, a ring scans the frog, and in the middle of the sequence the camera jumps. The data set
comes with PyVista. Images are written; without -o they are shown in a window. Software OpenGL suffices.
"""

import argparse
from pathlib import Path
from statistics import median
from time import perf_counter
from typing import Any

import numpy as np
import pyvista as pv

from supersampler.cli.arguments import parse_size
from supersampler.integrations.pyvista import enable_supersampling


def main() -> None:
    """Render the sequence."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--frames", type=int, default=48)
    parser.add_argument(
        "--size", type=parse_size, default=(1280, 720), help="size of the window, such as 1280x720"
    )
    parser.add_argument("--scale", type=float, help="window size / render size; else chosen by times")
    parser.add_argument("--model", default="classifier", help="name of a model, or its folder")
    parser.add_argument("-o", "--output", type=Path, help="folder for the images; else a window shows them")
    options = parser.parse_args()

    plotter = scene(options.size, off_screen=options.output is not None)
    window = enable_supersampling(plotter, scale=options.scale, model=options.model)  # all that is needed
    if options.output is None:
        plotter.show(interactive_update=True)
    else:
        options.output.mkdir(parents=True, exist_ok=True)
    seconds = []
    for index in range(options.frames):
        pose(plotter, index, angle=1.0 * index + (120.0 if index >= options.frames // 2 else 0.0))
        began = perf_counter()
        plotter.render()
        seconds.append(perf_counter() - began)
        if options.output is None:
            plotter.update()
        else:
            plotter.screenshot(options.output / f"{index:04d}.png")
    upscaler = window.viewports[0].upscaler
    if upscaler is not None:
        step = upscaler.stats.seconds / upscaler.stats.frames
        print(f"{1000 * median(seconds):.0f} ms a frame (median), {1000 * step:.0f} ms of it for upscaling")
    plotter.close()


def scene(size: tuple[int, int], *, off_screen: bool) -> Any:
    """Return a plotter that shows the organs, 1.5 million triangles, and a ring."""
    plotter = pv.Plotter(off_screen=off_screen, window_size=list(size))
    frog(plotter)
    plotter.show(auto_close=False, interactive_update=True)
    return plotter


def frog(plotter: Any) -> None:
    """Add the organs and the ring."""
    plotter.set_background("white")
    mesh = pv.examples.load_frog_tissues().contour_labels()
    plotter.add_mesh(mesh, cmap="tab20", show_scalar_bar=False)
    radius = 0.2 * mesh.length
    ring = pv.Disc(center=mesh.center, inner=radius, outer=1.05 * radius, normal=(0, 1, 0), c_res=90)
    plotter.add_mesh(ring, color="black", lighting=False, name="ring")
    pose(plotter, 0, angle=0.0)


def pose(plotter: Any, index: int, *, angle: float) -> None:
    """Place camera and ring for a frame; the angle of the camera around the frog is in degrees."""
    mesh, turned = plotter.meshes[0], np.radians(45.0 + angle)
    toward = np.array([np.cos(turned), np.sin(turned), 0.7])
    plotter.camera.position = tuple(mesh.center + 0.95 * mesh.length * toward)
    plotter.camera.focal_point, plotter.camera.up = mesh.center, (0.0, 0.0, 1.0)
    plotter.renderer.ResetCameraClippingRange()
    plotter.actors["ring"].SetPosition(0.0, mesh.length * (0.006 * (index % 60) - 0.18), 0.0)


if __name__ == "__main__":
    main()
