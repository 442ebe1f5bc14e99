"""Scenes of PyVista's gallery with the one line added: a frog, a grid, a volume, glyphs, labels, streamlines.

    pip install . pyvista sympy
    python examples/pyvista_gallery.py glyphs                      # in a window
    python examples/pyvista_gallery.py glyphs -o out/glyphs.png    # one converged image

The data comes with PyVista, or is computed. Software OpenGL is sufficient.
"""

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pyvista as pv

from supersampler.cli.arguments import parse_size
from supersampler.integrations.pyvista import enable_supersampling


def frog(plotter: Any) -> None:
    """Show the organs of a frog, 1.5 million triangles, and a ring: "Frog"."""
    plotter.set_background("white")
    mesh = pv.examples.load_frog_tissues().contour_labels()
    plotter.add_mesh(mesh, cmap="tab20", show_scalar_bar=False)
    radius = 0.2 * mesh.length
    ring = pv.Disc(center=mesh.center, inner=radius, outer=1.05 * radius, normal=(0, 1, 0), c_res=90)
    plotter.add_mesh(ring.translate((0.0, -0.18 * mesh.length, 0.0)), color="black", lighting=False)
    toward = 0.95 * mesh.length * np.array([np.sqrt(0.5), np.sqrt(0.5), 0.7])
    plotter.camera_position = [mesh.center + toward, mesh.center, (0.0, 0.0, 1.0)]


def grid(plotter: Any) -> None:
    """Show hills in a grid with numbers: "Control Global and Local Bounds"."""
    plotter.add_mesh(pv.examples.load_random_hills(), show_scalar_bar=False)
    plotter.show_bounds(grid="front", location="outer", all_edges=True)


def volume(plotter: Any) -> None:
    """Show the wave function of an orbital as a volume: "Plotting Atomic Orbitals"."""
    orbital = pv.examples.load_hydrogen_orbital(3, 2, -2)
    plotter.add_volume(orbital, scalars="real_wf", cmap="magma", opacity=[1, 0, 1], show_scalar_bar=False)
    plotter.add_axes()


def glyphs(plotter: Any) -> None:
    """Show arrows on a translucent sphere: "Plotting Glyphs (Vectors or PolyData)"."""
    sphere = pv.Sphere(radius=3.14)
    x, y, z = sphere.points.T
    sphere["vectors"] = 0.3 * np.column_stack([np.sin(x), np.cos(y), np.cos(z)])
    sphere.set_active_vectors("vectors")
    plotter.add_mesh(sphere.arrows, lighting=False, scalar_bar_args={"title": "Vector Magnitude"})
    plotter.add_mesh(sphere, color="grey", ambient=0.6, opacity=0.5)


def labels(plotter: Any) -> None:
    """Show a beam with the positions of its end's nodes: "Label Points"."""
    beam = pv.examples.load_hexbeam()
    plotter.add_mesh(beam, show_edges=True, color="tan")
    end = beam.points[beam.points[:, 0] == 0]
    plotter.add_point_labels(end, end.tolist(), point_size=20, font_size=36)
    plotter.camera_position = [(-1.5, 1.5, 3.0), (0.05, 0.6, 1.2), (0.2, 0.9, -0.25)]


def streamlines(plotter: Any) -> None:
    """Show tubes along streamlines of vortices: "Streamlines", its custom vector field."""
    mesh = pv.ImageData(dimensions=(20, 15, 5), spacing=(0.1, 0.1, 0.1), origin=(-0.95, -0.7, -0.2))
    x, y, z = np.pi * mesh.points.T
    mesh["vectors"] = np.column_stack(
        [
            np.sin(x) * np.cos(y) * np.cos(z),
            -np.cos(x) * np.sin(y) * np.cos(z),
            np.cos(x) * np.cos(y) * np.sin(z),
        ]
    )
    seeds = pv.PolyData(np.random.default_rng(0).uniform(-0.06, 0.06, (200, 3)))
    stream = mesh.streamlines_from_source(seeds, "vectors", terminal_speed=0.0)
    plotter.add_mesh(stream.tube(radius=0.0015), show_scalar_bar=False)
    plotter.add_mesh(mesh.outline(), color="black")
    plotter.camera_position = [(1.2, 1.2, 1.2), (0.0, 0.0, 0.0), (0.0, 0.0, 1.0)]


SCENES: dict[str, Callable[[Any], None]] = {
    scene.__name__: scene for scene in (frog, grid, volume, glyphs, labels, streamlines)
}


def main() -> None:
    """Show a scene."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("scene", choices=SCENES)
    parser.add_argument("--size", type=parse_size, default=(1280, 720), help="size of the window")
    parser.add_argument("-o", "--output", type=Path, help="file of one converged image; else a window")
    options = parser.parse_args()
    plotter = pv.Plotter(off_screen=options.output is not None, window_size=list(options.size))
    SCENES[options.scene](plotter)
    window = enable_supersampling(plotter)  # the line added
    if options.output is None:
        plotter.show()
    else:
        plotter.show(auto_close=False)
        window.converge()
        options.output.parent.mkdir(parents=True, exist_ok=True)
        plotter.screenshot(options.output)


if __name__ == "__main__":
    main()
