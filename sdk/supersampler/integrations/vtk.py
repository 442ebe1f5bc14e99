"""Supersampling of a VTK render window: fast while it moves, converging while it rests.

A frame in which the camera or a prop moves is rendered small and jittered, and upscaled. Lines, points and
text are then rendered at full size on top, against the depth of the small render. Where nothing changes, the
window shows the mean of full-size renders. Every other frame is rendered as without supersampling.
"""

import math
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from contextlib import ExitStack
from pathlib import Path
from time import perf_counter
from typing import Any
from weakref import WeakKeyDictionary, ref

from vtkmodules.util.vtkConstants import VTK_INT
from vtkmodules.vtkRenderingOpenGL2 import vtkOpenGLRenderWindow

from supersampler.arguments import checked_scale, ieee_arithmetic
from supersampler.errors import ArgumentError, shown, warn
from supersampler.frame import Frame
from supersampler.integrations.vtk_pixels import Rectangle, WindowPixels
from supersampler.integrations.vtk_scene import is_composed, visible
from supersampler.integrations.vtk_viewport import FIRST, LAST, STILL_RENDERS, Mode, ViewportHistory, changed
from supersampler.methods.model_info import ModelInfo
from supersampler.model import Model

_SCALES = (1.0, 1.25, 1.5, 1.75, 2.0)  # window size / render size
_BUDGET = 0.4  # maximum time of a frame that moves, relative to a plain one
_MAX_SHARE = 0.9  # of that time; above it upscaling does not pay
_NEW = 0.3  # weight of the last time in the mean
_SETTLING = 3  # frames that move before one of them counts
_MIN_SAMPLES = 4  # multi-samples of plain renders
_DELAY = 10  # ms between renders at rest, for the events of the window
_PAUSE = 100  # ms after a frame that moved or changed, as the next one may, too
_CORNER = 1 / 16
"""Fraction of the window up to which FXAA smooths other renderers, such as axes in a corner, while the view
moves. Multi-sampling would slow down the whole window."""
_EARLY = 0.9e-3  # seconds after which a timer of 1 ms counts as ended: timers may be early
_enabled: "WeakKeyDictionary[Any, ref[SupersampledWindow]]" = WeakKeyDictionary()  # by window


class Pace:
    """Times of plain frames and of frames that moved.

    Args:
        scale: window size / render size of frames that move; None chooses the largest render size whose
            frames take at most 0.4 of the time of a plain one, at least half the window's.
        ratios: minimum and maximum scale of the model.
        force: whether to upscale where that takes more than 0.9 of the time of a plain frame.

    Attributes:
        plain: seconds of a plain frame; None until the second one, as the first compiles shaders.
    """

    def __init__(self, scale: float | None, ratios: tuple[float, float], *, force: bool) -> None:
        self.plain: float | None = None
        allowed = [one for one in _SCALES if ratios[0] <= one <= ratios[1]]
        self._scales = tuple(allowed) if scale is None else (scale,)
        self._force = force
        self._moved: dict[float, float] = {}
        self._seen = Counter[float | None]()

    @property
    def is_timed(self) -> bool:
        """Whether frames may move: whether plain ones were timed, where that matters."""
        return self.plain is not None or (self._force and len(self._scales) == 1)

    @property
    def pays(self) -> bool:
        """Whether upscaling takes less time than plain frames."""
        fastest = self._moved.get(self._scales[-1])
        return self._force or self.plain is None or fastest is None or fastest < _MAX_SHARE * self.plain

    @property
    def moved(self) -> float:
        """Seconds of a frame that moved, at the smallest render size."""
        return self._moved[self._scales[-1]]

    @property
    def scale(self) -> float:
        """Window size / render size of the next frame that moves."""
        chosen = self._scales[-1]
        for scale in reversed(self._scales):  # the first that was not timed is tried if the ones before fit
            chosen = scale if self._fits(scale) else chosen
            if scale not in self._moved or not self._fits(scale):
                break
        return chosen

    def add(self, scale: float | None, seconds: float) -> None:
        """Add a frame that moved, or a plain one if `scale` is None."""
        self._seen[scale] += 1
        if self._seen[scale] <= (1 if scale is None else _SETTLING):
            pass  # the first ones compile, allocate, or are of full size; volumes adjust their steps
        elif scale is None:
            self.plain = seconds if self.plain is None else self.plain + _NEW * (seconds - self.plain)
        else:
            before = self._moved.get(scale, seconds)
            self._moved[scale] = before + _NEW * (seconds - before)

    def restart(self) -> None:
        """Forget all times, as of another window size."""
        self.plain = None
        self._moved.clear()

    def _fits(self, scale: float) -> bool:
        seconds = self._moved.get(scale, 0.0)
        return self.plain is None or seconds <= _BUDGET * self.plain


class SupersampledWindow:
    """A render window that is fast while it moves, and converges while it rests.

    Each `Render` of the window is one frame:

    - The camera or props have moved: surfaces and volumes are rendered at the window's size / scale and
      jittered, and an `Upscaler` computes the image. Lines, points and 3D text are rendered at full size on
      top, against the depth of the small render. Motion comes from the camera and the matrices of the props.
    - Nothing has changed: the image is the mean of 16 full-size jittered renders; the first one is plain.
    - Anything else (the first frame, data, colours, lights, the size, a jump of the camera): the frame is
      plain, as without supersampling, with multi-sampling. While the view moves, lines, points and 3D text
      may change.

    2D props (text, scalar bars) and other renderers (axes, overlays) are rendered at full size on top.
    Colours are display values, as VTK blends and resolves them.

    Frames are plain, too, for stereo and tiles, and where a renderer

    - has a render pass, FXAA, SSAO, shadows, an off-axis projection or a projection matrix of the program;
    - preserves its colour or depth buffer, is not in layer 0, or is on top of another renderer.

    Where upscaling is measured not to pay, frames that move are plain; a warning says so. An exception while
    a frame is upscaled leaves a plain image, too.

    Attributes:
        viewports: the history of each renderer.
        pace: times of frames, and the scale that is chosen by them.
        is_bypassed: whether frames that move are plain, as upscaling does not pay.

    Args:
        window: a `vtkRenderWindow` with OpenGL. This object replaces another one that supersamples it.
        renderers: the renderers of the scene.
        scale: window size / render size of frames that move, >= 1; None chooses it by times: see `Pace`.
        model: see `Upscaler`.
        threads: see `Upscaler`.
        force: whether to upscale where that does not pay.
        wake: function that renders the window after some milliseconds, called while an off-screen view at
            rest has not converged. On screen the window's interactor has a timer.

    Raises:
        ArgumentError: `window` has no OpenGL; `renderers` are not the window's; `scale` is not a ratio of the
            model; or the model reads G-buffers.
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
        self._window, self._nested, self.is_bypassed = window, False, False
        pixels = WindowPixels(window)
        self.viewports = tuple(ViewportHistory(window, r, pixels, loaded) for r in self._renderers)
        self._modes: tuple[tuple[ViewportHistory, Mode], ...] = ()  # while a frame is rendered
        self._stack = ExitStack()  # restores what was changed for the frame
        self._began = self._ended = 0.0  # times of the last frame
        self._timed: tuple[Any, int] | None = None  # interactor whose timer renders on at rest, and observer
        self._timer = 0  # of the interactor, the last one that was started
        self._due: float | None = None  # time at which the timer that is running ends; None: none is
        self._given_samples = self._set_samples = int(window.GetMultiSamples())  # by the program; by us
        _enabled[window] = ref(self)
        self._observers = [
            self._observe("StartEvent", lambda: None, FIRST),
            self._observe("StartEvent", self._before_render, LAST),  # other observers may change the scene
            self._observe("EndEvent", self._after_render, FIRST),
        ]

    def _observe(self, event: str, react: Callable[[], None], priority: float) -> int:
        """Have a method called at an event of the window. Others then see one event a frame."""

        def observe(*_: Any) -> None:
            try:
                if not self._is_left_alone:
                    react()
            finally:
                command = self._window.GetCommand(tag)  # kept, it would be a cycle that Python cannot free
                if command is not None:  # else the method has removed it
                    command.SetAbortFlag(self._nested)  # of a render that this object started

        tag: int = self._window.AddObserver(event, observe, priority)
        return tag

    @property
    def is_converged(self) -> bool:
        """Whether further frames of the same scene show the same image."""
        return all(viewport.is_converged for viewport in self.viewports if viewport.has_pixels)

    def converge(self) -> None:
        """Render until the image has converged, as before a screenshot."""
        for _ in range(2 + STILL_RENDERS):
            self._window.Render()
            if self.is_converged or self._is_special():
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
        self._time_by(None)
        self._note_samples()
        self._multi_sample(self._given_samples)

    def _multi_sample(self, samples: int) -> None:
        """Set the number of multi-samples of the next renders."""
        self._window.SetMultiSamples(samples)
        self._set_samples = int(self._window.GetMultiSamples())

    def _note_samples(self) -> None:
        """Take over the number of multi-samples if the program has set it."""
        samples = int(self._window.GetMultiSamples())
        if samples != self._set_samples:
            self._given_samples = samples

    @property
    def _samples(self) -> int:
        """Multi-samples of plain renders; with them, VTK's depth peeling loses translucent surfaces."""
        peels = any(renderer.GetUseDepthPeeling() for renderer in self._renderers)
        return 0 if peels else max(_MIN_SAMPLES, self._given_samples)

    @property
    def _is_left_alone(self) -> bool:
        """Whether to ignore this render: this object started it, or it is for hardware selection."""
        return self._nested or any(renderer.GetSelector() for renderer in self._renderers)

    @ieee_arithmetic
    def _before_render(self) -> None:
        self._began = perf_counter()
        self._stack.close()
        self._modes = ()
        self._note_samples()
        self._multi_sample(self._samples)
        if self._is_special():
            self.reset()
            return
        viewports = [viewport for viewport in self.viewports if viewport.has_pixels]
        modes = [viewport.mode() for viewport in viewports]
        can_upscale = self.pace.is_timed and not self.is_bypassed and any(v.has_surfaces for v in viewports)
        if "changed" in modes or ("moved" in modes and not can_upscale):
            return
        if "first" in modes:
            modes = ["first" for _ in modes]
        if modes:
            self._begin(tuple(zip(viewports, modes, strict=True)))

    def _begin(self, modes: tuple[tuple[ViewportHistory, Mode], ...]) -> None:
        """Prepare window and renderers for all that lies below 2D props and other renderers."""
        self._modes = modes
        self._multi_sample(self._samples if self._shows("first") else 0)
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
        if not self._modes:
            self._watch()
            return
        self._set_nested(True)
        try:
            with self._stack:
                moved = [viewport for viewport, mode in self._modes if mode == "moved"]
                for viewport in moved:
                    viewport.read()
                frames = {viewport: viewport.frame() for viewport in moved}  # None: it jumped
            if None in frames.values() or any(viewport.was_changed for viewport, _ in self._modes):
                self._render_plain()
            else:
                self._show(frames)
        except Exception:
            self.reset()
            self._render_plain()
            raise
        finally:
            self._set_nested(False)
        self._time()
        self._end()

    def _set_nested(self, nested: bool) -> None:
        """Note whether this object starts the next renders."""
        self._nested = nested
        for viewport in self.viewports:
            viewport.is_nested = nested

    def _render_plain(self) -> None:
        """Render as without supersampling, in place of what was rendered for this frame."""
        self._modes = ()
        self._multi_sample(self._samples)
        self._window.Render()

    def _show(self, frames: Mapping[ViewportHistory, Frame | None]) -> None:
        for viewport, mode in self._modes:
            if (frame := frames.get(viewport)) is not None:
                viewport.upscale(frame)
            else:
                viewport.average(mode, max(1, self._samples))
        corners: list[Any] = []
        if not self._shows("first"):
            lines = any(viewport.has_lines_on_top(mode) for viewport, mode in self._modes)
            others = [renderer for renderer in self._others() if renderer.GetDraw() and visible(renderer)]
            if self._shows("moved") and not lines and self._fraction(others) <= _CORNER:
                corners = others
            self._multi_sample(self._samples if lines or len(others) > len(corners) else 0)
            self._window.Start()  # makes the buffers of this number of samples
            for viewport, mode in self._modes:
                viewport.paint(mode)
            self._window.End()
        with ExitStack() as stack:
            for viewport, mode in self._modes:
                viewport.show(mode, stack)
            for renderer in corners:
                stack.enter_context(changed(renderer, "UseFXAA", 1))
            self._window.Render()

    def _fraction(self, renderers: list[Any]) -> float:
        """Return the fraction of the window that renderers cover, where they do not overlap."""
        width, height = self._window.GetSize()
        covered = sum(math.prod(renderer.GetSize()) for renderer in renderers)
        return float(covered / max(width * height, 1))

    def _is_special(self) -> bool:
        """Return whether this frame has to be rendered as without supersampling."""
        window, renderers = self._window, self._renderers
        cameras = [r.GetActiveCamera() for r in renderers if r.IsActiveCameraCreated()]
        return bool(
            window.GetStereoRender()
            or window.GetTileScale() != (1, 1)
            or any(map(is_composed, renderers))
            or any(camera.GetUseExplicitProjectionTransformMatrix() for camera in cameras)
            or any(camera.GetUseOffAxisProjection() for camera in cameras)  # it ignores the jitter
            or self._is_over_others()
        )

    def _is_over_others(self) -> bool:
        """Return whether a renderer of the scene is on top of another renderer: their viewports overlap."""
        below: list[Rectangle] = []
        for renderer in self._window.GetRenderers():
            if renderer.GetDraw() and renderer.GetLayer() == 0:
                part = Rectangle(*renderer.GetOrigin(), *renderer.GetSize())
                if renderer in self._renderers and any(map(part.overlaps, below)):
                    return True
                below.append(part)
        return False

    def _wake(self) -> None:
        """Have the event loop render the next frame of a view at rest, until it has converged."""
        interactor = self._window.GetInteractor()
        if self.is_converged:
            return
        if self._window.GetOffScreenRendering():
            if self._wake_up is not None:
                self._wake_up(self._pause)
        elif interactor is not None and interactor.GetInitialized():
            if self._timed is None or self._timed[0] is not interactor:
                self._time_by(interactor)
            if self._due is None:
                self._timer = interactor.CreateOneShotTimer(self._pause)
                self._due = perf_counter() + _EARLY * self._pause

    def _time_by(self, interactor: Any) -> None:
        """Keep rendering by the timers of an interactor; None stops this."""
        if self._timed is not None:
            before, tag = self._timed
            before.RemoveObserver(tag)
        self._timed = self._due = None
        if interactor is None:
            return
        has_one_timer = interactor.IsA("vtkGenericRenderWindowInteractor")  # all its events have the last id

        def observe(source: Any, _event: str, timer: int | None = None) -> None:
            if has_one_timer:
                is_ours = self._due is not None and perf_counter() >= self._due
            else:
                is_ours = timer == self._timer
                source.GetCommand(tag).SetAbortFlag(is_ours)  # no animation of the program must step
            if is_ours:
                self._on_timer()

        observe.CallDataType = VTK_INT  # type: ignore[attr-defined]  # else VTK passes no `timer`
        tag = interactor.AddObserver("TimerEvent", observe, FIRST)
        self._timed = interactor, tag

    @property
    def _pause(self) -> int:
        """Time in ms from the last frame to the next one at rest."""
        return _DELAY if self._modes and not self._shows("moved") else _PAUSE

    def _on_timer(self) -> None:
        self._due = None
        if perf_counter() - self._ended >= _EARLY * self._pause:
            self._window.Render()
        else:
            self._wake()  # a frame was rendered since the timer was started

    def _time(self) -> None:
        """Record the time of the frame; switch upscaling off if it does not pay."""
        if self._shows("moved") and not self._shows("still"):
            self.pace.add(self.pace.scale, perf_counter() - self._began)
        if not self.is_bypassed and not self.pace.pays:
            self.is_bypassed = True
            plain, moved = 1000.0 * (self.pace.plain or 0.0), 1000.0 * self.pace.moved
            message = (
                f"upscaling does not pay here: a frame that moves takes {moved:.0f} ms with it, {plain:.0f} "
                "ms without. It is off until frames take longer; force=True keeps it on."
            )
            warn(UserWarning(message))

    def _watch(self) -> None:
        """Time a plain frame; upscale again when it takes twice as long as upscaled ones did."""
        if not self._is_special():
            self._window.WaitForCompletion()
            seconds = perf_counter() - self._began
            self.pace.add(None, seconds)
            if self.is_bypassed and seconds > 2.0 * self.pace.moved:
                self.is_bypassed = False
                self.pace.restart()
        self._end()

    def _end(self) -> None:
        for viewport in self.viewports:
            viewport.finish()
        self._ended = perf_counter()
        if not self._is_special():
            self._wake()


def _checked_renderers(window: Any, renderers: Iterable[Any]) -> tuple[Any, ...]:
    """Return the renderers of a window.

    Raises:
        ArgumentError: `window` has no OpenGL, or these are not its renderers.
    """
    if not isinstance(window, vtkOpenGLRenderWindow):
        raise ArgumentError("window", got=shown(window), want="a vtkRenderWindow with OpenGL")
    found = tuple(renderers) if isinstance(renderers, Iterable) else (renderers,)
    of_window = list(window.GetRenderers())
    strangers = [one for one in found if one not in of_window]
    if strangers or not found:
        got = shown(strangers[0]) if strangers else "empty"
        raise ArgumentError("renderers", got=got, want="renderers of the window")
    return found


def _checked_scale(scale: float | None, info: ModelInfo) -> float | None:
    """Return the scale.

    Raises:
        ArgumentError: it is below 1 or not a ratio of the model, or the model reads G-buffers.
    """
    if info.gbuffers:
        raise ArgumentError(
            "model", got=repr(info.method), want="one that reads no G-buffers, which VTK lacks"
        )
    low, high = info.ratios
    if scale is not None and not low <= checked_scale(scale) <= high:
        raise ArgumentError("scale", got=shown(scale), want=f"{low} to {high} for {info.method!r}")
    return scale
