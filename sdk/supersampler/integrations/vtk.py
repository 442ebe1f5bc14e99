"""Supersampling of a VTK render window: fast while it moves, converging while it rests.

A frame in which the camera or a prop moves is rendered small and jittered, and upscaled. Lines, points and
text are then rendered at full size on top, against the depth of the small render. Where nothing changes, the
window shows the mean of full-size renders. Every other frame is rendered as without supersampling.
"""

import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import AbstractContextManager, ExitStack, contextmanager
from pathlib import Path
from time import perf_counter
from typing import Any, Literal

import numpy as np
from vtkmodules.vtkRenderingCore import vtkActor2D, vtkProp3D

from supersampler.arguments import checked_scale, ieee_arithmetic
from supersampler.conventions import halton_jitter
from supersampler.frame import Float32, Frame
from supersampler.integrations.vtk_pace import Pace
from supersampler.integrations.vtk_pixels import Rectangle, WindowPixels, upsampled_depth
from supersampler.integrations.vtk_scene import (
    SceneView,
    appearance,
    is_upscaled,
    move_background,
    visible,
)
from supersampler.model import Model
from supersampler.upscaler import Upscaler

Mode = Literal["plain", "still", "moved"]
_STILL_RENDERS = 16  # jittered full-size renders in the mean of a view at rest
_STILL_SCALE = 2.0  # their jitter is that of this scale: a longer sequence than that of scale 1
_MIN_SAMPLES = 4  # multi-samples of plain renders
_DELAY = 10  # ms between renders at rest, for the events of the window
_PAUSE = 100  # ms after a frame that moved, as the next one may move, too


class ViewportHistory:
    """One renderer's history: the upscaler of its moving images, the mean of its renders at rest.

    Attributes:
        upscaler: the Upscaler for the viewport's size; None before the first frame that moves.
        renders: full-size renders in the mean of the view at rest, after the plain one.
    """

    def __init__(self, window: Any, renderer: Any, pixels: WindowPixels, model: Model) -> None:
        self._window, self._renderer, self._pixels, self._model = window, renderer, pixels, model
        self.upscaler: Upscaler | None = None
        self.renders = 0
        self._frames = 0  # that were upscaled
        self._unit = 1.0  # view distance of depth 1, since the upscaler's first frame
        self._part = self._small_part = Rectangle(0, 0, 1, 1)
        self._view: SceneView | None = None  # of the last frame; None makes the next one plain
        self._looks: tuple[Any, ...] = ()  # `appearance` after the last frame
        self._small: SceneView | None = None  # of this frame, if it moves
        self._upscaled: SceneView | None = None  # of the upscaler's last frame; None resets it
        self._sum: Float32 | None = None  # of renders at rest, in 0 to 255; None while the view moves
        self._weight = 0  # samples of a pixel in `_sum`
        self._depth: Float32 | None = None  # of this frame, at full size
        self._image: Float32 | None = None

    @property
    def is_converged(self) -> bool:
        """Whether further frames of the same scene show the same image."""
        return self._sum is not None and self.renders >= _STILL_RENDERS

    @property
    def has_surfaces(self) -> bool:
        """Whether there is something to upscale."""
        return any(is_upscaled(prop) for prop in visible(self._renderer))

    @property
    def has_layers(self) -> bool:
        """Whether lines, points or 3D text are rendered on top."""
        return any(isinstance(prop, vtkProp3D) and not is_upscaled(prop) for prop in visible(self._renderer))

    def reset(self) -> None:
        """Drop all history: the next frame is plain."""
        self._view = self._upscaled = self._sum = None

    def mode(self) -> Mode:
        """Return how this frame is to be rendered, from what has changed since the last one."""
        view = SceneView.of(self._renderer)
        left, bottom = self._renderer.GetOrigin()
        self._part = Rectangle(left, bottom, *view.size)
        before, self._view = self._view, view
        if before is None or before.size != view.size or self._looks != appearance(self._renderer):
            self._upscaled = self._sum = None
            return "plain"
        if not view.is_same(before):
            self._sum = None
            return "moved"
        return "plain" if self._sum is None else "still"

    def begin(self, mode: Mode, scale: float, stack: ExitStack) -> None:
        """Prepare the renderer for a frame; `stack` restores it."""
        props = visible(self._renderer)
        if mode == "moved":
            if self._upscaled is None:  # one sample of each pixel is better than one of four
                scale = 1.0
            left, bottom, right, top = self._renderer.GetViewport()
            small = left + (right - left) / scale, bottom + (top - bottom) / scale
            stack.enter_context(changed(self._renderer, "Viewport", left, bottom, *small))
            stack.enter_context(hidden(prop for prop in props if not is_upscaled(prop)))
            self._small = SceneView.of(self._renderer, halton_jitter(self._frames, scale))
            stack.enter_context(_jittered(self._renderer, self._small.jitter, self._small.size))
        elif mode == "still":
            is_final = self.is_converged
            stack.enter_context(hidden(p for p in props if is_final or isinstance(p, vtkActor2D)))
            x, y = halton_jitter(self.renders // 2, _STILL_SCALE)
            jitter = (x, y) if self.renders % 2 else (-x, -y)  # pairs whose mean is the pixel's centre
            stack.enter_context(_jittered(self._renderer, jitter, self._part[2:]))
        else:
            stack.enter_context(hidden(prop for prop in props if isinstance(prop, vtkActor2D)))

    def read(self) -> Frame | None:
        """Return the small frame that was rendered, or None if the camera has jumped."""
        if (view := self._small) is None:
            return None
        part = self._small_part = self._part._replace(width=view.size[0], height=view.size[1])
        color = self._pixels.read_color(part) * np.float32(1.0 / 255.0)
        buffer = self._depth = self._pixels.read_depth(part)
        placed = buffer.copy()
        reactive = view.place_translucent(placed)
        if self._upscaled is None:
            self._unit, motion = view.near, np.zeros((*buffer.shape, 2), np.float32)
        else:
            motion = self._motion(view, placed, self._upscaled)
            if view.is_jump(motion, self._upscaled):
                self._upscaled = None
                return None
        depth = view.frame_depth(placed, self._unit)
        return Frame(
            color=color, depth=depth, motion=motion, jitter=view.jitter, reset=self._upscaled is None,
            exposure=1.0, reactive=reactive if reactive.any() else None,
        )  # fmt: skip

    def upscale(self, frame: Frame) -> None:
        """Compute the image of a frame that moved."""
        if self.upscaler is None or self.upscaler.display_size != self._part[2:]:
            self.upscaler = Upscaler(self._model, display_size=self._part[2:], validate="off")
        self._image = self.upscaler.step(frame)
        self._frames += 1
        self._upscaled = self._small

    def average(self, mode: Mode, samples: int) -> None:
        """Add a full-size render to the mean of the view at rest; a plain one of some samples begins it."""
        if mode == "plain":
            self._sum = self._pixels.read_color(self._part) * np.float32(samples)
            self._weight, self.renders = samples, 0
            self._depth = self._pixels.read_depth(self._part)
        elif self._sum is not None and not self.is_converged:
            self._sum += self._pixels.read_color(self._part)
            self._weight, self.renders = self._weight + 1, self.renders + 1
            if self.renders % 2:
                return  # half of a pair of jitters: its mean is not at the pixel's centre
        if self._sum is not None:
            self._image = self._sum * np.float32(1.0 / (255.0 * self._weight))

    def paint(self, mode: Mode) -> None:
        """Write the image, and the depth for what is rendered on top."""
        if self._image is not None:
            self._pixels.write_color(self._image, self._part)
        if self._depth is not None and any(not is_upscaled(prop) for prop in visible(self._renderer)):
            depth = self._depth
            if mode == "moved" and self._small is not None:
                depth = upsampled_depth(depth, self._part[2:], self._small.jitter)
            self._pixels.write_depth(depth, self._part)

    def show(self, mode: Mode, stack: ExitStack) -> None:
        """Prepare the renderer for what is on top of the image."""
        for name in ("PreserveColorBuffer", "PreserveDepthBuffer"):
            stack.enter_context(changed(self._renderer, name, 1))
        covered = (p for p in visible(self._renderer) if isinstance(p, vtkProp3D))
        stack.enter_context(hidden(p for p in covered if mode != "moved" or is_upscaled(p)))

    def finish(self) -> None:
        """Note what the scene looks like now, as rendering may modify it."""
        self._looks = appearance(self._renderer)

    def _motion(self, view: SceneView, buffer: Float32, previous: SceneView) -> Float32:
        motion = view.motion(buffer, previous)
        # copied whole: the two parts one by one take ten times as long
        vectors = motion.view(np.uint64)[..., 0]
        for props, of_these in view.moved_props(buffer, previous):
            with hidden(prop for prop in visible(self._renderer) if prop not in props):
                self._window.Render()
                mine = self._pixels.read_depth(self._small_part) == self._depth
            np.copyto(vectors, of_these.view(np.uint64)[..., 0], where=mine)
        move_background(vectors, buffer)
        return motion


class SupersampledWindow:
    """A render window that is fast while it moves, and converges while it rests.

    Each `Render` of the window is one frame:

    - The camera or props have moved: surfaces and volumes are rendered at the window's size / scale and
      jittered, and an `Upscaler` computes the image. Lines, points and 3D text are rendered at full size on
      top, against the depth of the small render. Motion comes from the camera and the matrices of the props.
    - Nothing has changed: full-size jittered renders are averaged, of which the first is plain; 16 suffice.
    - Anything else (the first frame, data, colours, lights, the size, a jump of the camera): the frame is
      plain, as without supersampling, with multi-sampling.

    2D props (text, scalar bars) and other renderers (axes, overlays) are rendered at full size on top.
    Colours are display values, as VTK blends and resolves them.

    Frames are plain, too, where a renderer has a render pass or is not in layer 0, and for hardware
    selection, stereo and tiles. Where upscaling is measured not to pay, frames that move are plain; a warning
    says so.

    Attributes:
        viewports: the history of each renderer.
        pace: times of frames, and the scale that is chosen by them.

    Args:
        window: a `vtkRenderWindow` with OpenGL.
        renderers: the renderers of the scene; their viewports do not overlap.
        scale: window size / render size of frames that move, >= 1; None chooses it by times: see `Pace`.
        model: see `Upscaler`.
        threads: see `Upscaler`.
        force: whether to upscale where that does not pay.
        wake: function that renders the window after some milliseconds, called while an off-screen view at
            rest has not converged. On screen the window's interactor has a timer.

    Raises:
        ArgumentError: `scale` is below 1.
        ModelError: see `Upscaler`.
    """

    def __init__(
        self,
        window: Any,
        renderers: Iterable[Any],
        *,
        scale: float | None = None,
        model: Model | str | Path = "classifier",
        threads: int = 0,
        force: bool = False,
        wake: Callable[[int], None] | None = None,
    ) -> None:
        self._wake_up = wake
        self.pace = Pace(None if scale is None else checked_scale(scale), force=force)
        self._window, self._nested, self._out = window, False, False
        loaded = model if isinstance(model, Model) else Model.load(model, threads=threads)
        pixels = WindowPixels(window)
        self._renderers = tuple(renderers)
        self.viewports = tuple(ViewportHistory(window, r, pixels, loaded) for r in self._renderers)
        self._modes: tuple[Mode, ...] = ()  # of the viewports, while a frame is rendered
        self._stack = ExitStack()  # restores what was changed for the frame
        self._began = self._ended = 0.0  # times of the last frame
        self._timed: Any = None  # interactor whose timer renders on at rest
        self._timer: int | None = None  # the one that is running
        self._given_samples = window.GetMultiSamples()
        self._samples = max(_MIN_SAMPLES, self._given_samples)
        self._observers = [
            window.AddObserver("StartEvent", lambda *_: self._before_render()),
            window.AddObserver("EndEvent", lambda *_: self._after_render()),
        ]

    @property
    def is_out(self) -> bool:
        """Whether frames that move are plain because upscaling does not pay."""
        return self._out

    @property
    def is_converged(self) -> bool:
        """Whether further frames of the same scene show the same image."""
        return all(viewport.is_converged for viewport in self.viewports)

    def converge(self) -> None:
        """Render until the image has converged, as before a screenshot."""
        for _ in range(2 + _STILL_RENDERS):
            self._window.Render()
            if self.is_converged:
                break

    def reset(self) -> None:
        """Drop the history: the next frame is plain."""
        for viewport in self.viewports:
            viewport.reset()

    def disable(self) -> None:
        """Restore the window's own rendering."""
        while self._observers:
            self._window.RemoveObserver(self._observers.pop())
        self._window.SetMultiSamples(self._given_samples)

    @ieee_arithmetic
    def _before_render(self) -> None:
        if self._nested:
            return
        self._began = perf_counter()
        self._modes = ()
        self._window.SetMultiSamples(self._samples)
        if self._is_special():
            self.reset()
            return
        modes = [viewport.mode() for viewport in self.viewports]
        if "moved" in modes and (self._out or not any(v.has_surfaces for v in self.viewports)):
            return
        is_timed = self.pace.is_timed or "moved" not in modes
        if "plain" in modes or not is_timed:
            modes = ["plain" for _ in modes]
        self._begin(tuple(modes))

    def _begin(self, modes: tuple[Mode, ...]) -> None:
        """Prepare window and renderers for what is rendered below 2D props and other renderers."""
        self._modes = modes
        self._window.SetMultiSamples(self._samples if "plain" in modes else 0)
        with ExitStack() as stack:
            stack.enter_context(changed(self._window, "SwapBuffers", 0))
            for renderer in self._window.GetRenderers():
                if renderer not in self._renderers:
                    stack.enter_context(changed(renderer, "Draw", 0))
            for viewport, mode in zip(self.viewports, modes, strict=True):
                viewport.begin(mode, self.pace.scale, stack)
            self._stack = stack.pop_all()

    @ieee_arithmetic
    def _after_render(self) -> None:
        if self._nested:
            return
        if not self._modes:
            self._watch()
            self._wake()
            return
        self._nested = True
        try:
            with self._stack:
                frames = [
                    v.read() for v, mode in zip(self.viewports, self._modes, strict=True) if mode == "moved"
                ]
            if None in frames:
                self._begin(tuple("plain" for _ in self._modes))
                with self._stack:
                    self._window.Render()
            self._show(frames)
        finally:
            self._nested = False
        self._time()
        self._ended = perf_counter()
        self._wake()

    def _show(self, frames: list[Frame | None]) -> None:
        waiting = iter(frames)
        for viewport, mode in zip(self.viewports, self._modes, strict=True):
            frame = next(waiting) if mode == "moved" else None
            if frame is not None:
                viewport.upscale(frame)
            else:
                viewport.average(mode, self._samples)
        is_plain = "plain" in self._modes
        if not is_plain:
            layers = any(
                v.has_layers for v, mode in zip(self.viewports, self._modes, strict=True) if mode == "moved"
            )
            self._window.SetMultiSamples(self._samples if layers else 0)
            self._window.Start()  # makes the buffers of this number of samples
            for viewport, mode in zip(self.viewports, self._modes, strict=True):
                viewport.paint(mode)
            self._window.End()
        with ExitStack() as stack:
            for viewport, mode in zip(self.viewports, self._modes, strict=True):
                viewport.show(mode, stack)
            self._window.Render()
        for viewport in self.viewports:
            viewport.finish()

    def _is_special(self) -> bool:
        """Return whether this frame is none of a moving or resting view."""
        window = self._window
        return bool(
            window.GetStereoRender()
            or window.GetTileScale() != (1, 1)
            or any(r.GetSelector() or r.GetPass() or r.GetLayer() for r in self._renderers)
        )

    def _wake(self) -> None:
        """Have the event loop render the next frame of a view at rest, until it has converged."""
        interactor = self._window.GetInteractor()
        if self.is_converged:
            return
        if self._window.GetOffScreenRendering():
            if self._wake_up is not None:
                self._wake_up(self._pause)
        elif self._timer is None and interactor is not None and interactor.GetInitialized():
            if self._timed is not interactor:
                self._timed = interactor
                interactor.AddObserver("TimerEvent", lambda *_: self._on_timer())
            self._timer = interactor.CreateOneShotTimer(self._pause)

    @property
    def _pause(self) -> int:
        """Time in ms from the last frame to the next one at rest."""
        return _DELAY if self._modes and "moved" not in self._modes else _PAUSE

    def _on_timer(self) -> None:
        if self._timer is None or not self._observers:
            return
        self._timer = None
        if 1000.0 * (perf_counter() - self._ended) >= 0.9 * self._pause:
            self._window.Render()
        else:
            self._wake()  # a frame was rendered since the timer was started

    def _time(self) -> None:
        """Note how long the frame took; stay out if upscaling does not pay."""
        seconds = perf_counter() - self._began
        if set(self._modes) == {"moved"}:
            self.pace.add(self.pace.scale, seconds)
        elif "moved" not in self._modes and "plain" in self._modes:
            self.pace.add(None, seconds)
        if not self._out and not self.pace.pays:
            self._out = True
            plain, moved = 1000.0 * (self.pace.plain or 0.0), 1000.0 * self.pace.moved
            warnings.warn(
                f"upscaling does not pay here: a frame that moves takes {moved:.0f} ms with it, {plain:.0f} "
                "ms without. It is off until frames take longer; force=True keeps it on.",
                stacklevel=2,
            )  # fmt: skip

    def _watch(self) -> None:
        """Upscale again when plain frames take twice as long as upscaled ones did."""
        for viewport in self.viewports:
            viewport.finish()
        if self._out:
            self._window.WaitForCompletion()
            if perf_counter() - self._began > 2.0 * self.pace.moved:
                self._out = False
                self.pace.restart()
        self._ended = perf_counter()


def _jittered(
    renderer: Any, jitter: tuple[float, float], size: tuple[int, ...]
) -> AbstractContextManager[None]:
    """Move the samples of a renderer by a jitter, in pixels of a render of the size, within the block."""
    camera = renderer.GetActiveCamera()
    x, y = camera.GetWindowCenter()
    center = x + 2.0 * jitter[0] / size[0], y - 2.0 * jitter[1] / size[1]  # jitter y points down
    return changed(camera, "WindowCenter", *center)


@contextmanager
def changed(vtk_object: Any, name: str, *values: Any) -> Iterator[None]:
    """Set a property of a VTK object within the block."""
    before = getattr(vtk_object, f"Get{name}")()
    own = before if isinstance(before, tuple) else (before,)
    if own == values:
        yield
        return
    getattr(vtk_object, f"Set{name}")(*values)
    try:
        yield
    finally:
        getattr(vtk_object, f"Set{name}")(*own)


@contextmanager
def hidden(props: Iterable[Any]) -> Iterator[None]:
    """Hide props within the block."""
    found = [prop for prop in props if prop.GetVisibility()]
    for prop in found:
        prop.VisibilityOff()
    try:
        yield
    finally:
        for prop in found:
            prop.VisibilityOn()
