"""Supersampling of a VTK render window: fast while it moves, converging while it rests.

A frame in which the camera or a prop moves is rendered small and jittered, and upscaled. Lines, points and
text are then rendered at full size on top, against the depth of the small render. Where nothing changes, the
window shows the mean of full-size renders. Every other frame is rendered as without supersampling.
"""

import warnings
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from pathlib import Path
from time import perf_counter
from typing import Any, Literal, NamedTuple
from weakref import WeakKeyDictionary, ref

import numpy as np
from numpy.typing import NDArray
from vtkmodules.vtkRenderingCore import vtkRenderer
from vtkmodules.vtkRenderingOpenGL2 import vtkOpenGLRenderWindow

from supersampler.arguments import checked_scale, ieee_arithmetic
from supersampler.conventions import halton_jitter
from supersampler.errors import ArgumentError, shown
from supersampler.frame import Float32, Frame
from supersampler.integrations.vtk_pace import Pace
from supersampler.integrations.vtk_pixels import Rectangle, WindowPixels, nearest_samples, upsampled_depth
from supersampler.integrations.vtk_scene import (
    SceneView,
    appearance,
    has_oblique_lines,
    is_on_top,
    is_upscaled,
    move_background,
    visible,
)
from supersampler.methods.model_info import ModelInfo
from supersampler.model import Model
from supersampler.upscaler import Upscaler

Mode = Literal["plain", "still", "moved"]
_STILL_RENDERS = 16  # jittered full-size renders in the mean of a view at rest
_STILL_SCALE = 2.0  # their jitter is that of this scale: a longer sequence than that of scale 1
_MIN_SAMPLES = 4  # multi-samples of plain renders
_DELAY = 10  # ms between renders at rest, for the events of the window
_PAUSE = 100  # ms after a frame that moved, as the next one may move, too
_enabled: "WeakKeyDictionary[Any, ref[SupersampledWindow]]" = WeakKeyDictionary()  # by window


class _Drawing(NamedTuple):
    """Which props a renderer draws, and how, in one render of the window.

    Attributes:
        shows: whether a prop is drawn.
        jitter: see `Frame`; of a render of `size`, (width, height).
        aspect: width / height that the camera projects to; None is that of the viewport.
    """

    shows: Callable[[Any], bool]
    jitter: tuple[float, float] = (0.0, 0.0)
    size: tuple[int, ...] = (1, 1)
    aspect: float | None = None


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
        self._sum: Float32 | None = None  # of renders at rest, RGBA in 0 to 255; None while the view moves
        self._weight = 0  # samples of a pixel in `_sum`
        self._color: Float32 | None = None  # of this frame at its size, in [0, 1]
        self._depth: Float32 | None = None  # of this frame, or of the plain one at rest
        self._image: Float32 | None = None
        self._alpha: NDArray[np.uint8] | None = None  # of the image
        self._drawing: _Drawing | None = None  # of this render; None draws everything
        self._stack = ExitStack()  # restores what was changed for the drawing
        self._observers = [  # renderers may share a camera and props: each is changed only while it is drawn
            renderer.AddObserver("StartEvent", lambda *_: self._start_drawing()),
            renderer.AddObserver("EndEvent", lambda *_: self._stack.close()),
        ]

    @property
    def is_converged(self) -> bool:
        """Whether further frames of the same scene show the same image."""
        return self._sum is not None and self.renders >= _STILL_RENDERS

    @property
    def has_pixels(self) -> bool:
        """Whether the viewport is not empty."""
        return bool(min(self._renderer.GetSize()) > 0)

    @property
    def has_surfaces(self) -> bool:
        """Whether there is something to upscale."""
        return any(is_upscaled(prop) for prop in visible(self._renderer))

    @property
    def has_layers(self) -> bool:
        """Whether lines, points or 3D text are rendered on top of images that move."""
        return any(not is_upscaled(prop) and not is_on_top(prop) for prop in visible(self._renderer))

    def has_lines_on_top(self, mode: Mode) -> bool:
        """Whether what is rendered on top has edges that need multi-sampling."""
        return (mode == "moved" and self.has_layers) or any(map(has_oblique_lines, visible(self._renderer)))

    def reset(self) -> None:
        """Drop all history: the next frame is plain."""
        self._view = self._upscaled = self._sum = None

    def disable(self) -> None:
        """Stop changing what the renderer draws."""
        self.draw(None)
        while self._observers:
            self._renderer.RemoveObserver(self._observers.pop())

    def draw(self, drawing: _Drawing | None) -> None:
        """Set what the renderer draws from now on; None is everything."""
        self._stack.close()
        self._drawing = drawing

    def _start_drawing(self) -> None:
        self._stack.close()
        if self._drawing is None:
            return
        shows, jitter, size, aspect = self._drawing
        camera = self._renderer.GetActiveCamera()
        with ExitStack() as stack:
            stack.enter_context(_hidden(prop for prop in visible(self._renderer) if not shows(prop)))
            if aspect is not None and not camera.GetUseExplicitAspectRatio():
                stack.enter_context(changed(camera, "ExplicitAspectRatio", aspect))
                stack.enter_context(changed(camera, "UseExplicitAspectRatio", 1))
            x, y = camera.GetWindowCenter()
            center = x + 2.0 * jitter[0] / size[0], y - 2.0 * jitter[1] / size[1]  # jitter y points down
            stack.enter_context(changed(camera, "WindowCenter", *center))
            self._stack = stack.pop_all()

    def mode(self) -> Mode:
        """Return how this frame is to be rendered, from what has changed since the last one."""
        if not self._renderer.IsActiveCameraCreated():
            self._renderer.ResetCamera()  # as VTK does before it renders without a camera
        view = SceneView.of(self._renderer)
        left, bottom = self._renderer.GetOrigin()
        self._part = Rectangle(left, bottom, *view.size)
        before, self._view = self._view, view
        is_other = before is None or before.size != view.size or self._looks != appearance(self._renderer)
        if before is None or is_other or not view.knows_motion(before):
            self._upscaled = self._sum = None
            return "plain"
        if not view.is_same(before):
            self._sum = None
            return "moved"
        return "plain" if self._sum is None else "still"

    def begin(self, mode: Mode, scale: float, stack: ExitStack) -> None:
        """Prepare the renderer for a frame; `stack` restores it."""
        stack.callback(self.draw, None)
        if mode == "moved" and self._view is not None:
            if self._upscaled is None:  # one sample of each pixel is better than one of four
                scale = 1.0
            left, bottom, right, top = self._renderer.GetViewport()
            small = left + (right - left) / scale, bottom + (top - bottom) / scale
            stack.enter_context(changed(self._renderer, "Viewport", left, bottom, *small))
            size, jitter = tuple(self._renderer.GetSize()), halton_jitter(self._frames, scale)
            self._small = replace(self._view, size=size, jitter=jitter)
            self.draw(_Drawing(is_upscaled, jitter, size, self._view.aspect))
        elif mode == "still":
            x, y = halton_jitter(self.renders // 2, _STILL_SCALE)
            jitter = (x, y) if self.renders % 2 else (-x, -y)  # pairs whose mean is the pixel's centre
            is_final = self.is_converged
            self.draw(_Drawing(lambda prop: not (is_final or is_on_top(prop)), jitter, self._part[2:]))
        else:
            self.draw(_Drawing(lambda prop: not is_on_top(prop)))

    def read(self) -> None:
        """Read the small frame that was rendered."""
        if self._small is None:
            return
        part = self._small_part = self._part._replace(width=self._small.size[0], height=self._small.size[1])
        pixels = self._pixels.read_color(part)
        self._color = pixels[..., :3] * np.float32(1.0 / 255.0)
        self._alpha = nearest_samples(pixels[..., 3], self._part[2:], self._small.jitter)
        self._depth = self._pixels.read_depth(part)

    def frame(self) -> Frame | None:
        """Return the frame that was read, or None if the camera has jumped."""
        view, color, buffer = self._small, self._color, self._depth
        if view is None or color is None or buffer is None:
            return None
        placed = buffer.copy()
        reactive = view.place_translucent(placed)
        if self._upscaled is None:
            self._unit, motion = view.near, np.zeros((*buffer.shape, 2), np.float32)
        else:
            motion = self._motion(view, buffer, placed, self._upscaled)
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
            mean = self._sum * np.float32(1.0 / self._weight)
            self._alpha = np.rint(mean[..., 3]).astype(np.uint8)
            self._image = mean[..., :3] * np.float32(1.0 / 255.0)

    def paint(self, mode: Mode) -> None:
        """Write image and depth, for what is rendered on top and for programs that read them."""
        if self._image is not None and self._alpha is not None:
            self._pixels.write_color(self._image, self._alpha, self._part)
        depth = self._depth
        if depth is not None and mode == "moved" and self._small is not None:
            size = self._part[2:]
            enlarged = upsampled_depth if self.has_layers else nearest_samples
            depth = enlarged(depth, size, self._small.jitter)
        if depth is not None:
            self._pixels.write_depth(depth, self._part)

    def show(self, mode: Mode, stack: ExitStack) -> None:
        """Prepare the renderer for what is on top of the image."""
        for name in ("PreserveColorBuffer", "PreserveDepthBuffer"):
            stack.enter_context(changed(self._renderer, name, 1))
        stack.callback(self.draw, None)
        self.draw(_Drawing(lambda prop: not is_upscaled(prop) if mode == "moved" else is_on_top(prop)))

    def finish(self) -> None:
        """Note what the scene looks like now, as rendering may modify it."""
        self._looks = appearance(self._renderer)

    def _motion(self, view: SceneView, buffer: Float32, placed: Float32, previous: SceneView) -> Float32:
        motion = view.motion(placed, previous)
        # copied whole: the two parts one by one take ten times as long
        vectors = _words(motion)
        background = buffer == 1.0
        for props, of_these in view.moved_props(placed, previous):
            self.draw(_Drawing(props.__contains__, view.jitter, view.size, view.aspect))
            self._window.Render()
            mine = self._pixels.read_depth(self._small_part) == buffer
            mine &= ~background | view.translucent_pixels(props)
            np.copyto(vectors, _words(of_these), where=mine)
        sky = view.sky_motion(buffer, previous)
        if sky is None:
            move_background(vectors, placed)
        else:
            np.copyto(vectors, _words(sky), where=placed == 1.0)
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

    Frames are plain, too, where a renderer has a render pass, a projection matrix of the program, or is not
    in layer 0, and for stereo and tiles. Where upscaling is measured not to pay, frames that move are plain;
    a warning says so. An exception while a frame is upscaled leaves a plain image, too.

    Attributes:
        viewports: the history of each renderer.
        pace: times of frames, and the scale that is chosen by them.

    Args:
        window: a `vtkRenderWindow` with OpenGL. One that is supersampled already is from now on supersampled
            by this.
        renderers: the renderers of the scene; their viewports do not overlap.
        scale: window size / render size of frames that move, >= 1; None chooses it by times: see `Pace`.
        model: see `Upscaler`.
        threads: see `Upscaler`.
        force: whether to upscale where that does not pay.
        wake: function that renders the window after some milliseconds, called while an off-screen view at
            rest has not converged. On screen the window's interactor has a timer.

    Raises:
        ArgumentError: `window` or `renderers` are none; `scale` is no ratio of the model; or the model reads
            G-buffers.
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
        self._renderers = _checked_renderers(window, renderers)
        loaded = model if isinstance(model, Model) else Model.load(model, threads=threads)
        self.pace = Pace(_checked_scale(scale, loaded.info), loaded.info.ratios, force=force)
        earlier = _enabled[window]() if window in _enabled else None
        if earlier is not None:
            earlier.disable()
        self._wake_up = wake
        self._window, self._nested, self._out = window, False, False
        pixels = WindowPixels(window)
        self.viewports = tuple(ViewportHistory(window, r, pixels, loaded) for r in self._renderers)
        self._modes: tuple[tuple[ViewportHistory, Mode], ...] = ()  # while a frame is rendered
        self._stack = ExitStack()  # restores what was changed for the frame
        self._began = self._ended = 0.0  # times of the last frame
        self._timed: Any = None  # interactor whose timer renders on at rest
        self._timer: int | None = None  # the one that is running
        self._given_samples = window.GetMultiSamples()
        _enabled[window] = ref(self)
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
        return all(viewport.is_converged for viewport in self.viewports if viewport.has_pixels)

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
        self._stack.close()
        self._modes = ()
        while self._observers:
            self._window.RemoveObserver(self._observers.pop())
        for viewport in self.viewports:
            viewport.disable()
        self._window.SetMultiSamples(self._given_samples)

    @property
    def _samples(self) -> int:
        """Multi-samples of plain renders; depth peeling works with the program's own number only."""
        peels = any(renderer.GetUseDepthPeeling() for renderer in self._renderers)
        return int(self._given_samples if peels else max(_MIN_SAMPLES, self._given_samples))

    @property
    def _is_left_alone(self) -> bool:
        """Whether this render shows no image: one of this class, or of ids for hardware selection."""
        return self._nested or any(renderer.GetSelector() for renderer in self._renderers)

    @ieee_arithmetic
    def _before_render(self) -> None:
        if self._is_left_alone:
            return
        self._began = perf_counter()
        self._stack.close()
        self._modes = ()
        self._window.SetMultiSamples(self._samples)
        if self._is_special():
            self.reset()
            return
        viewports = [viewport for viewport in self.viewports if viewport.has_pixels]
        modes = [viewport.mode() for viewport in viewports]
        if "moved" in modes and (self._out or not any(v.has_surfaces for v in viewports)):
            return
        is_timed = self.pace.is_timed or "moved" not in modes
        if "plain" in modes or not is_timed:
            modes = ["plain" for _ in modes]
        if modes:
            self._begin(tuple(zip(viewports, modes, strict=True)))

    def _begin(self, modes: tuple[tuple[ViewportHistory, Mode], ...]) -> None:
        """Prepare window and renderers for what is rendered below 2D props and other renderers."""
        self._modes = modes
        self._window.SetMultiSamples(self._samples if self._shows("plain") else 0)
        with ExitStack() as stack:
            stack.enter_context(changed(self._window, "SwapBuffers", 0))
            for renderer in self._others():
                stack.enter_context(changed(renderer, "Draw", 0))
            for viewport, mode in modes:
                viewport.begin(mode, self.pace.scale, stack)
            self._stack = stack.pop_all()

    def _shows(self, mode: Mode) -> bool:
        return any(mode == of_viewport for _, of_viewport in self._modes)

    def _others(self) -> list[Any]:
        """Return the renderers that are not supersampled: axes, overlays."""
        return [renderer for renderer in self._window.GetRenderers() if renderer not in self._renderers]

    @ieee_arithmetic
    def _after_render(self) -> None:
        if self._is_left_alone:
            return
        if not self._modes:
            self._watch()
            return
        self._nested = True
        try:
            with self._stack:
                frames = self._read()
            if None in frames.values():
                self._render_plain()
                frames = {}
            self._show(frames)
        except Exception:
            self.reset()
            self._render_plain()
            self._show({})
            raise
        finally:
            self._nested = False
        self._time()
        self._ended = perf_counter()
        self._wake()

    def _read(self) -> dict[ViewportHistory, Frame | None]:
        """Return the frames of viewports that have moved; None where the camera has jumped."""
        moved = [viewport for viewport, mode in self._modes if mode == "moved"]
        for viewport in moved:
            viewport.read()
        return {viewport: viewport.frame() for viewport in moved}

    def _render_plain(self) -> None:
        self._begin(tuple((viewport, "plain") for viewport, _ in self._modes))
        with self._stack:
            self._window.Render()

    def _show(self, frames: Mapping[ViewportHistory, Frame | None]) -> None:
        for viewport, mode in self._modes:
            if (frame := frames.get(viewport)) is not None:
                viewport.upscale(frame)
            else:
                viewport.average(mode, max(1, self._samples))
        if not self._shows("plain"):
            lines = any(viewport.has_lines_on_top(mode) for viewport, mode in self._modes)
            lines = lines or any(renderer.GetDraw() and visible(renderer) for renderer in self._others())
            self._window.SetMultiSamples(self._samples if lines else 0)
            self._window.Start()  # makes the buffers of this number of samples
            for viewport, mode in self._modes:
                viewport.paint(mode)
            self._window.End()
        with ExitStack() as stack:
            for viewport, mode in self._modes:
                viewport.show(mode, stack)
            self._window.Render()
        for viewport, _ in self._modes:
            viewport.finish()

    def _is_special(self) -> bool:
        """Return whether this frame is none of a moving or resting view."""
        window, renderers = self._window, self._renderers
        cameras = [r.GetActiveCamera() for r in renderers if r.IsActiveCameraCreated()]
        return bool(
            window.GetStereoRender()
            or window.GetTileScale() != (1, 1)
            or any(renderer.GetPass() or renderer.GetLayer() for renderer in renderers)
            or any(camera.GetUseExplicitProjectionTransformMatrix() for camera in cameras)
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
        return _PAUSE if self._shows("moved") else _DELAY

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
        if not self._shows("plain") and not self._shows("still"):
            self.pace.add(self.pace.scale, seconds)
        elif not self._shows("moved") and self._shows("plain"):
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
        if not self._is_special():
            self._wake()


def _checked_renderers(window: Any, renderers: Iterable[Any]) -> tuple[Any, ...]:
    """Return the renderers of a window.

    Raises:
        ArgumentError: `window` is no window with OpenGL, or these are not its renderers.
    """
    if not isinstance(window, vtkOpenGLRenderWindow):
        raise ArgumentError("window", got=shown(window), want="a vtkRenderWindow with OpenGL")
    found = [renderers] if isinstance(renderers, vtkRenderer) else renderers
    found = tuple(found) if isinstance(found, Iterable) else (found,)
    of_window = list(window.GetRenderers())
    strangers = [one for one in found if one not in of_window]
    if strangers or not found:
        got = shown(strangers[0]) if strangers else "empty"
        raise ArgumentError("renderers", got=got, want="renderers of the window")
    return found


def _checked_scale(scale: float | None, info: ModelInfo) -> float | None:
    """Return the scale.

    Raises:
        ArgumentError: it is below 1, or the model has not this ratio or reads G-buffers.
    """
    if info.gbuffers:
        raise ArgumentError(
            "model", got=repr(info.method), want="one that reads no G-buffers, which VTK lacks"
        )
    low, high = info.ratios
    if scale is not None and not low <= checked_scale(scale) <= high:
        raise ArgumentError("scale", got=shown(scale), want=f"{low} to {high} for {info.method!r}")
    return scale


def _words(motion: Float32) -> NDArray[np.uint64]:
    """Return motion (h, w, 2) as one word a pixel."""
    words: NDArray[np.uint64] = motion.view(np.uint64)[..., 0]
    return words


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
def _hidden(props: Iterable[Any]) -> Iterator[None]:
    """Hide props within the block."""
    found = [prop for prop in props if prop.GetVisibility()]
    for prop in found:
        prop.VisibilityOff()
    try:
        yield
    finally:
        for prop in found:
            prop.VisibilityOn()
