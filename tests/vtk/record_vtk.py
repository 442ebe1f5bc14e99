"""Record what VTK renders of a small scene, as small shots: python record_vtk.py FOLDER, in an
environment with PyVista and OpenGL.

right: as `enable_supersampling` renders. half, fixed: with half of the jitter that the frames state, and with
none. filtered: with multi-sampling.
"""

import sys
from dataclasses import replace
from typing import Any

import numpy as np
import pyvista as pv

from compact_frames import compact, cropped
from supersampler import Frame, halton_jitter
from supersampler.conventions.encodings import srgb_decoded
from supersampler.integrations import vtk_viewport
from supersampler.integrations.pyvista import enable_supersampling
from supersampler.io.shot import ShotWriter

SHOTS = {  # fraction of the jitter, samples of a pixel, number of frames
    "right": (1.0, 0, 4),
    "half": (0.5, 0, 3),
    "fixed": (0.0, 0, 3),
    "filtered": (1.0, 8, 1),
}


def scene(size: tuple[int, int]) -> tuple[Any, Any]:
    """Boxes and balls on a floor of checks, before a sky; the box that is returned is to be moved."""
    plotter = pv.Plotter(off_screen=True, window_size=size)
    plotter.set_background("lightblue")
    floor = pv.Plane(i_size=24, j_size=24, i_resolution=24, j_resolution=24)
    checks = (np.indices((24, 24)).sum(axis=0) % 2).ravel()
    plotter.add_mesh(floor, scalars=checks, cmap="gray", show_scalar_bar=False)
    chance = np.random.default_rng(5)
    for index in range(24):
        x, y = chance.uniform(-5, 5, 2)
        side, color = chance.uniform(0.2, 0.6), chance.uniform(0.1, 1.0, 3)
        box, ball = pv.Cube(x_length=side, y_length=side, z_length=3 * side), pv.Sphere(radius=side)
        actor = plotter.add_mesh(box if index % 3 else ball, color=color)
        actor.position = (x, y, 1.5 * side)
    return plotter, actor


def record(folder: str, name: str) -> None:
    part, samples, count = SHOTS[name]
    vars(vtk_viewport)["halton_jitter"] = lambda *of: tuple(part * x for x in halton_jitter(*of))
    plotter, mover = scene((480, 270) if samples else (192, 108))  # twice that of the frames
    window: Any = enable_supersampling(plotter, scale=2, model="bilinear", force=True)
    observed = plotter.render_window  # after the observer of supersampling
    observed.AddObserver("StartEvent", lambda *_: observed.SetMultiSamples(samples), -1.0)
    frames: list[Frame] = []
    plotter.show(auto_close=False)
    viewport = window.viewports[0]
    upscale = viewport.upscale

    def kept(frame: Frame) -> None:
        frames.append(frame)
        upscale(frame)

    viewport.upscale = kept
    for index in range(-1, count):
        plotter.camera.position = (6.0 - 0.5 * index, -8.0 + 0.25 * index, 3.2)
        plotter.camera.focal_point, plotter.camera.up = (0.1 * index, 0, 0.6), (0, 0, 1)
        plotter.renderer.ResetCameraClippingRange()
        mover.position = (1.0 + 0.24 * index, -3.0, 0.6)
        plotter.render()
        if index < 0:  # it has no history, and is of another size
            frames.clear()
            viewport._frames = 0
    writer = ShotWriter(f"{folder}/{name}", name=name, display_size=None, frame_rate=30, compression="zip:9")
    for index, frame in enumerate(frames):
        color = None if frame.color is None else srgb_decoded(frame.color)
        jitter = halton_jitter(index, 2.0)
        frame = replace(frame, color=color, jitter=jitter, reset=index == 0, exposure=None)
        writer.write(compact(cropped(frame, 120, 80)))
    plotter.close()


for name in SHOTS:
    record(sys.argv[1], name)
