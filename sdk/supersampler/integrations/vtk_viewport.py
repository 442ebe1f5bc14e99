"""History of one renderer of a supersampled VTK window: what it renders, reads back and displays."""

from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray
from vtkmodules.vtkCommonCore import vtkTimeStamp

from supersampler.conventions import halton_jitter
from supersampler.frame import Float32, Frame
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
from supersampler.model import Model
from supersampler.upscaler import Upscaler

FIRST, LAST = 1.0, -1.0  # priorities of observers; those of others mostly have 0
Mode = Literal["changed", "first", "still", "moved"]
"""How a frame is rendered: as without supersampling; at full size, to begin the mean of a view at rest, or
with jitter, to continue it; small and upscaled."""
STILL_RENDERS = 16
"""Jittered full-size renders in the mean of a view at rest."""
_STILL_SCALE = 2.0  # their jitter is that of this scale: a longer sequence than that of scale 1


class _RenderSettings(NamedTuple):
    """Settings of a renderer for one render of the window.

    Attributes:
        includes: returns whether a prop is rendered.
        jitter: see `Frame`; of a render of `size`, (width, height).
        aspect: width / height that the camera projects to; None is that of the viewport.
    """

    includes: Callable[[Any], bool]
    jitter: tuple[float, float] = (0.0, 0.0)
    size: tuple[int, ...] = (1, 1)
    aspect: float | None = None


class ViewportHistory:
    """One renderer's history: the upscaler of its moving images, the mean of its renders at rest.

    Attributes:
        upscaler: the Upscaler for the viewport's size; None before the first frame that moves.
        renders: full-size renders in the mean of the view at rest, after the plain one.
        was_changed: whether an observer of the renderer has changed the scene since `mode` read it.
        is_nested: whether a `SupersampledWindow` starts the next renders: other observers do not see these.
    """

    def __init__(self, window: Any, renderer: Any, pixels: WindowPixels, model: Model) -> None:
        self._window, self._renderer, self._pixels, self._model = window, renderer, pixels, model
        self.upscaler: Upscaler | None = None
        self.renders = 0
        self.was_changed = self.is_nested = False
        self._frames = 0  # that were upscaled
        self._unit = 1.0  # view distance of depth 1, since the upscaler's first frame
        self._part = self._small_part = Rectangle(0, 0, 1, 1)
        self._view: SceneView | None = None  # of the last frame; None makes the next one plain
        self._looks: tuple[Any, ...] = ()  # `appearance` after the last frame
        self._upscaled_looks: tuple[Any, ...] = ()  # the same without props that are not upscaled
        self._upscaled_props: frozenset[Any] = frozenset()
        self._small: SceneView | None = None  # of this frame, if it moves
        self._upscaled: SceneView | None = None  # of the upscaler's last frame; None resets it
        self._sum: Float32 | None = None  # of renders at rest, RGBA in 0 to 255; None while the view moves
        self._weight = 0  # samples of a pixel in `_sum`
        self._color: Float32 | None = None  # of this frame at its size, in [0, 1]
        self._depth: Float32 | None = None  # of this frame, or of the plain one at rest
        self._image: Float32 | None = None
        self._alpha: NDArray[np.uint8] | None = None  # of the image
        self._settings: _RenderSettings | None = None  # of this render; None changes nothing
        self._stack = ExitStack()  # restores the renderer after a render
        self._began = vtkTimeStamp()  # of this render, before other observers
        self._observers = [  # settings apply while the renderer renders: others may have its camera and props
            self._observe("StartEvent", self._before_others, FIRST),
            self._observe("StartEvent", self._after_others, LAST),
            self._observe("EndEvent", lambda: self._stack.close(), FIRST),  # a render has its own stack
        ]

    def _observe(self, event: str, react: Callable[[], None], priority: float) -> int:
        tag: int = self._renderer.AddObserver(event, lambda *_: react(), priority)
        return tag

    @property
    def is_converged(self) -> bool:
        """Whether further frames of the same scene show the same image."""
        return self._sum is not None and self.renders >= STILL_RENDERS

    @property
    def has_pixels(self) -> bool:
        """Whether the renderer renders (VTK: `Draw`), and its viewport is not empty."""
        return bool(self._renderer.GetDraw() and min(self._renderer.GetSize()) > 0)

    @property
    def has_surfaces(self) -> bool:
        """Whether there is something to upscale."""
        return bool(self._upscaled_props)

    @property
    def has_layers(self) -> bool:
        """Whether lines, points or 3D text are rendered on top of images that move."""
        return not all(p in self._upscaled_props or is_on_top(p) for p in visible(self._renderer))

    def has_lines_on_top(self, mode: Mode) -> bool:
        """Whether what is rendered on top has edges that need multi-sampling."""
        return (mode == "moved" and self.has_layers) or any(map(has_oblique_lines, visible(self._renderer)))

    def reset(self) -> None:
        """Drop all history: the next frame is plain."""
        self._view = self._upscaled = self._sum = None

    def disable(self) -> None:
        """Stop changing what the renderer renders."""
        self.configure(None)
        while self._observers:
            self._renderer.RemoveObserver(self._observers.pop())

    def configure(self, settings: _RenderSettings | None) -> None:
        """Set the settings of the next renders; None changes nothing in the renderer."""
        self._stack.close()
        self._settings = settings

    def _before_others(self) -> None:
        """Begin a render; other observers see one a frame."""
        if self.is_nested:
            self._apply_settings()
        else:
            self._began.Modified()
        self._renderer.GetCommand(self._observers[0]).SetAbortFlag(self.is_nested)

    def _after_others(self) -> None:
        """Begin a render that other observers have seen, and note whether they have changed the scene."""
        now = vtkTimeStamp()
        now.Modified()
        if now.GetMTime() > self._began.GetMTime() + 1 and self._settings is not None:  # of all of VTK
            self._note_changes()
        self._apply_settings()

    def _note_changes(self) -> None:
        before = self._view
        if before is None:
            return
        view = replace(SceneView.of(self._renderer, self._upscaled_props, before.aspect), size=before.size)
        looks, upscaled_looks = self._read_looks()
        is_still = self._small is None
        self.was_changed = (
            not view.is_same(before)
            or upscaled_looks != self._upscaled_looks
            or (is_still and looks != self._looks)
        )
        if self.was_changed:
            self._view, self._upscaled, self._sum = view, None, None

    def _apply_settings(self) -> None:
        self._stack.close()
        if self._settings is None:
            return
        includes, jitter, size, aspect = self._settings
        camera = self._renderer.GetActiveCamera()
        with ExitStack() as stack:
            stack.enter_context(_hidden(prop for prop in visible(self._renderer) if not includes(prop)))
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
        looks, upscaled_looks = self._read_looks()
        view = SceneView.of(self._renderer, self._upscaled_props)
        left, bottom = self._renderer.GetOrigin()
        self._part = Rectangle(left, bottom, *view.size)
        before, self._view = self._view, view
        is_new = before is None or before.size != view.size or not view.knows_motion(before)
        is_still = before is not None and view.is_same(before)
        if is_new or upscaled_looks != self._upscaled_looks or (is_still and looks != self._looks):
            self._upscaled = self._sum = None
            return "changed"
        if not is_still:
            self._sum = None
            return "moved"
        return "first" if self._sum is None else "still"

    def _read_looks(self) -> tuple[tuple[Any, ...], tuple[Any, ...]]:
        """Return what the scene looks like now, and the same without props that are not upscaled."""
        looks = appearance(self._renderer)
        if looks != self._looks:
            self._upscaled_props = frozenset(filter(is_upscaled, visible(self._renderer)))
        *surroundings, props = looks
        return looks, (*surroundings, [one for one in props if one[0] in self._upscaled_props])

    def begin(self, mode: Mode, scale: float, stack: ExitStack) -> None:
        """Prepare the renderer for a frame; `stack` restores it."""
        stack.callback(self.configure, None)
        self.was_changed, self._small = False, None
        if mode == "moved" and self._view is not None:
            # without history, one sample of each pixel is better than one of four
            if self._upscaled is None or min(self._part[2:]) < 2.0 * scale:
                scale = 1.0
            left, bottom, right, top = self._renderer.GetViewport()
            small = left + (right - left) / scale, bottom + (top - bottom) / scale
            stack.enter_context(changed(self._renderer, "Viewport", left, bottom, *small))
            size, jitter = tuple(self._renderer.GetSize()), halton_jitter(self._frames, scale)
            self._small = replace(self._view, size=size, jitter=jitter)
            self.configure(
                _RenderSettings(self._upscaled_props.__contains__, jitter, size, self._view.aspect)
            )
        elif mode == "still":
            x, y = halton_jitter(self.renders // 2, _STILL_SCALE)
            jitter = (x, y) if self.renders % 2 else (-x, -y)  # pairs whose mean is the pixel's centre
            is_final = self.is_converged
            self.configure(
                _RenderSettings(lambda prop: not (is_final or is_on_top(prop)), jitter, self._part[2:])
            )
        else:
            self.configure(_RenderSettings(lambda prop: not is_on_top(prop)))

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
        """Add a full-size render to the mean of the view at rest; the first one has some samples."""
        if mode == "first":
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
        stack.callback(self.configure, None)
        self.configure(
            _RenderSettings(
                lambda prop: prop not in self._upscaled_props if mode == "moved" else is_on_top(prop)
            )
        )

    def finish(self) -> None:
        """Note what the scene looks like now: rendering modifies it, and tells what mappers draw."""
        before = self._upscaled_props
        self._looks, self._upscaled_looks = self._read_looks()
        if self._upscaled_props != before:
            self._upscaled = None

    def _motion(self, view: SceneView, buffer: Float32, placed: Float32, previous: SceneView) -> Float32:
        motion = view.motion(placed, previous)
        # copied whole: the two parts one by one take ten times as long
        vectors = _words(motion)
        background = buffer == 1.0
        for props, of_these in view.moved_props(placed, previous):
            self.configure(_RenderSettings(props.__contains__, view.jitter, view.size, view.aspect))
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
