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
    plotter: Any,
    *,
    scale: float | None = None,
    model: Model | str | Path = "classifier",
    threads: int = 0,
    force: bool = False,
) -> SupersampledWindow:
    """Make a plotter fast while its view moves, and let its image converge while it rests.

    This holds for all output of the plotter: `show`, `screenshot`, interaction, movies, and the server side
    of Trame and Jupyter. `SupersampledWindow` documents what is rendered how. The plotter's own
    anti-aliasing is replaced: plain frames have multi-sampling.

    Args:
        plotter: a `pyvista.Plotter`, with subplots or without.
        scale: see `SupersampledWindow`.
        model: see `Upscaler`.
        threads: see `Upscaler`.
        force: see `SupersampledWindow`.

    Raises:
        ArgumentError: `plotter` is not a plotter or is closed; or `scale` is below 1.
        ModelError: see `Upscaler`.
    """
    window, renderers = getattr(plotter, "render_window", None), getattr(plotter, "renderers", None)
    if window is None or renderers is None:
        got = "closed" if renderers is not None else shown(plotter)
        raise ArgumentError("plotter", got=got, want="an open pyvista.Plotter")
    samples = window.GetMultiSamples()
    plotter.disable_anti_aliasing(all_renderers=True)
    window.SetMultiSamples(samples)
    return SupersampledWindow(window, renderers, scale=scale, model=model, threads=threads, force=force)
