"""Supersampling of a VTK render window: it renders small and with jitter, and shows the upscaled image."""

from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from vtkmodules.vtkRenderingCore import vtkActor2D

from supersampler.arguments import checked_scale, ieee_arithmetic
from supersampler.conventions import halton_jitter
from supersampler.frame import Float32, Frame
from supersampler.integrations.vtk_lines import LineWidths, changed
from supersampler.integrations.vtk_pixels import WindowPixels
from supersampler.integrations.vtk_view import View, move_background
from supersampler.model import Model
from supersampler.upscaler import Upscaler


class SupersampledWindow:
    """A render window that renders at its size / `scale`, and shows what an `Upscaler` makes of it.

    Each `Render` of the window, whoever calls it, is one frame. While nothing moves, each adds samples to
    the image. Motion comes from the camera and the matrices of the props; a mesh whose points change has
    none, and blurs for a few frames. The background moves with the closest surface of each 16x16 pixels, so
    that the history serves outlines, too; beside thin things, and without a surface, it rests. Lines and
    points stay as wide as they are. 2D props (text, scalar bars) and other renderers (axes, overlays) are
    rendered at full size on top.
    A view that jumps starts anew, as does one of another window size.

    Colour is taken as VTK blends and resolves it: display values, of which the image is a mean.

    Attributes:
        upscaler: of the window's present size; None before the first image.

    Args:
        window: a `vtkRenderWindow` with OpenGL; its multi-sampling is turned off.
        renderer: the one that shows the scene, on all of the window.
        scale: window size / render size, >= 1.
        model: see `Upscaler`.
        threads: see `Upscaler`.

    Raises:
        ArgumentError: `scale` is below 1.
        ModelError: see `Upscaler`.
    """

    def __init__(
        self,
        window: Any,
        renderer: Any,
        *,
        scale: float = 2.0,
        model: Model | str | Path = "classifier",
        threads: int = 0,
    ) -> None:
        self._window, self._renderer = window, renderer
        self._scale = checked_scale(scale)
        self._widths = LineWidths(self._scale)
        self._model = model if isinstance(model, Model) else Model.load(model, threads=threads)
        self.upscaler: Upscaler | None = None
        self._frames = 0
        self._unit = 1.0  # what `Frame.depth` is relative to, since the first frame
        self._view: View | None = None  # of the last frame; None makes the next one the first
        self._small: tuple[ExitStack, View] | None = None  # while the window renders small
        self._nested = False
        self._pixels = WindowPixels(window)
        self._samples = window.GetMultiSamples()
        window.SetMultiSamples(0)
        self._observers = [
            window.AddObserver("StartEvent", lambda *_: self._before_render()),
            window.AddObserver("EndEvent", lambda *_: self._after_render()),
        ]

    def reset(self) -> None:
        """Drop the history: the next image is made of one frame alone."""
        self._view = None

    def disable(self) -> None:
        """Let the window render as it did."""
        while self._observers:
            self._window.RemoveObserver(self._observers.pop())
        self._widths.restore()
        self._window.SetMultiSamples(self._samples)

    @ieee_arithmetic
    def _before_render(self) -> None:
        """Make the window render this frame small and jittered, without 2D props and other renderers."""
        if self._nested:
            return
        self._window.SetMultiSamples(0)  # whoever has turned it on again
        width, height = self._window.GetActualSize()
        if self.upscaler is None or self.upscaler.display_size != (width, height):
            self.upscaler = Upscaler(self._model, display_size=(width, height), validate="off")
            self._view = None
        size = max(1, round(width / self._scale)), max(1, round(height / self._scale))
        jitter = halton_jitter(self._frames, self._scale)
        camera = self._renderer.GetActiveCamera()
        with ExitStack() as stack:
            viewport = (0.0, 0.0, size[0] / width, size[1] / height)
            stack.enter_context(changed(self._renderer, "Viewport", *viewport))
            for renderer in self._window.GetRenderers():
                if renderer is not self._renderer:
                    stack.enter_context(changed(renderer, "Draw", 0))
            stack.enter_context(_hidden(prop for prop in self._props() if isinstance(prop, vtkActor2D)))
            stack.enter_context(self._widths.scaled(self._props(), size))
            view = View.of(self._renderer, size, jitter)
            x, y = camera.GetWindowCenter()
            center = x + 2.0 * jitter[0] / size[0], y - 2.0 * jitter[1] / size[1]  # jitter y points down
            stack.enter_context(changed(camera, "WindowCenter", *center))
            self._small = stack.pop_all(), view

    @ieee_arithmetic
    def _after_render(self) -> None:
        """Upscale what was rendered, and show it."""
        if self._nested or self._small is None or self.upscaler is None:
            return
        stack, view = self._small
        self._small, self._nested = None, True
        try:
            with stack:
                frame = self._frame(view)
            self._show(self.upscaler.step(frame))
            self._view, self._frames = view, self._frames + 1
        finally:
            self._nested = False

    def _frame(self, view: View) -> Frame:
        color, buffer = self._pixels.read_color(view.size), self._pixels.read_depth(view.size)
        if self._view is None:
            self._unit, reset = view.near, True
            motion = np.zeros((*buffer.shape, 2), np.float32)
        else:
            motion = self._motion(view, buffer, self._view)
            reset = view.is_jump(motion, self._view)
        depth = view.frame_depth(buffer, self._unit)
        return Frame(color=color, depth=depth, motion=motion, jitter=view.jitter, reset=reset, exposure=1.0)

    def _motion(self, view: View, buffer: Float32, previous: View) -> Float32:
        motion = view.motion(buffer, previous)
        # copied whole: the two parts one by one take ten times as long
        vectors = motion.view(np.uint64)[..., 0]
        for props, of_these in view.moved_props(buffer, previous):
            with _hidden(prop for prop in self._props() if prop not in props):
                self._window.Render()
                mine = self._pixels.read_depth(view.size) == buffer
            np.copyto(vectors, of_these.view(np.uint64)[..., 0], where=mine)
        move_background(vectors, buffer)
        return motion

    def _show(self, image: Float32) -> None:
        self._pixels.show(image)
        scene = (prop for prop in self._props() if not isinstance(prop, vtkActor2D))
        with changed(self._renderer, "PreserveColorBuffer", 1), _hidden(scene):
            self._window.Render()

    def _props(self) -> list[Any]:
        return list(self._renderer.GetViewProps())


@contextmanager
def _hidden(props: Iterable[Any]) -> Iterator[None]:
    visible = [prop for prop in props if prop.GetVisibility()]
    for prop in visible:
        prop.VisibilityOff()
    try:
        yield
    finally:
        for prop in visible:
            prop.VisibilityOn()
