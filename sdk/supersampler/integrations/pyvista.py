"""Supersampling of a PyVista plotter: it renders small and with jitter, and shows the upscaled image.

>>> import pyvista
>>> from supersampler.integrations.pyvista import enable_supersampling
>>> plotter = pyvista.Plotter()
>>> plotter.add_mesh(pyvista.examples.load_airplane())
>>> enable_supersampling(plotter, scale=2)
>>> plotter.show()
"""

from pathlib import Path
from typing import Any

from supersampler.errors import ArgumentError, shown
from supersampler.integrations.vtk import SupersampledWindow
from supersampler.model import Model


def enable_supersampling(
    plotter: Any, *, scale: float = 2.0, model: Model | str | Path = "classifier", threads: int = 0
) -> SupersampledWindow:
    """Make a plotter render at window size / `scale` and show upscaled images.

    All output of the plotter is upscaled: `show`, `screenshot`, interaction, movies, and the server side of
    Trame and Jupyter. `SupersampledWindow` documents the motion it computes and what is rendered on top. The
    plotter's own anti-aliasing is turned off.

    Args:
        plotter: a `pyvista.Plotter` without subplots.
        scale: window size / render size, >= 1.
        model: see `Upscaler`.
        threads: see `Upscaler`.

    Raises:
        ArgumentError: `plotter` is not a plotter, has subplots or is closed; or `scale` is below 1.
        ModelError: see `Upscaler`.
    """
    window, renderers = getattr(plotter, "render_window", None), getattr(plotter, "renderers", None)
    if window is None or renderers is None:
        got = "closed" if renderers is not None else shown(plotter)
        raise ArgumentError("plotter", got=got, want="an open pyvista.Plotter")
    if len(renderers) != 1:
        raise ArgumentError("plotter", got=f"{len(renderers)} subplots", want="a plotter without subplots")
    plotter.disable_anti_aliasing()
    return SupersampledWindow(window, plotter.renderer, scale=scale, model=model, threads=threads)
