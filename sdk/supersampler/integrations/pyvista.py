"""Supersampling of a PyVista plotter: it renders small and with jitter, and shows the upscaled image.

>>> import pyvista
>>> from supersampler.integrations.pyvista import enable_supersampling
>>> plotter = pyvista.Plotter()
>>> plotter.add_mesh(pyvista.examples.load_airplane())
>>> enable_supersampling(plotter, scale=2)
>>> plotter.show()
"""

import asyncio
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
    anti-aliasing is replaced until `disable`: plain frames have multi-sampling. Show the plotter before you
    call `converge`: PyVista places the camera then.

    Args:
        plotter: a `pyvista.Plotter`, with subplots or without.
        scale: see `SupersampledWindow`.
        model: see `Upscaler`.
        threads: see `Upscaler`.
        force: see `SupersampledWindow`.

    Raises:
        ArgumentError: `plotter` is not a plotter or is closed; for others see `SupersampledWindow`.
        ModelError: see `Upscaler`.
    """
    window, renderers = getattr(plotter, "render_window", None), getattr(plotter, "renderers", None)
    if window is None or renderers is None:
        got = "closed" if renderers is not None else shown(plotter)
        raise ArgumentError("plotter", got=got, want="an open pyvista.Plotter")
    return _SupersampledPlotter(plotter, scale=scale, model=model, threads=threads, force=force)


class _SupersampledPlotter(SupersampledWindow):
    """The window of a plotter, whose own anti-aliasing is off until this is disabled."""

    def __init__(self, plotter: Any, **options: Any) -> None:
        served = _ServedPlotter(plotter)
        super().__init__(plotter.render_window, plotter.renderers, wake=served.render_later, **options)
        samples = plotter.render_window.GetMultiSamples()
        self._plotter = plotter
        self._anti_aliasing = {renderer: _anti_aliasing(renderer) for renderer in plotter.renderers}
        plotter.disable_anti_aliasing(all_renderers=True)  # it also sets the number of samples
        plotter.render_window.SetMultiSamples(samples)

    def disable(self) -> None:
        """Restore the plotter's own rendering."""
        super().disable()
        while self._anti_aliasing and self._plotter.render_window is not None:  # else it was closed
            renderer, kind = self._anti_aliasing.popitem()
            if kind is not None:
                renderer.enable_anti_aliasing(kind)


def _anti_aliasing(renderer: Any) -> str | None:
    """Return the anti-aliasing of a renderer, as `Renderer.enable_anti_aliasing` takes it."""
    if renderer.GetUseFXAA():
        return "fxaa"
    one = renderer.GetPass()
    while one is not None and not one.IsA("vtkSSAAPass"):
        one = one.GetDelegatePass() if hasattr(one, "GetDelegatePass") else None
    return None if one is None else "ssaa"


class _ServedPlotter:
    """Renders a plotter in the event loop of a server that shows it, such as Trame's, or a notebook's."""

    def __init__(self, plotter: Any) -> None:
        self._plotter = plotter
        self._waits = False

    def render_later(self, milliseconds: int) -> None:
        """Render once after some time, if something shows what is rendered."""
        if self._waits or not getattr(self._plotter, "_on_render_callbacks", None):
            return
        try:
            loop = asyncio.get_running_loop()
        except RuntimeError:  # a script: nothing would run the call
            return
        self._waits = True
        loop.call_later(milliseconds / 1000.0, self._render)

    def _render(self) -> None:
        self._waits = False
        if self._plotter.render_window is not None:  # else it was closed
            self._plotter.render()
