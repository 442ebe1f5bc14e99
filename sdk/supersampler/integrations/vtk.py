"""Supersampling of a VTK render window: it renders small and with jitter, and shows the upscaled image.

OpenGL renders no line narrower than one pixel. For a narrower line, the shader discards the pixels whose
centres are beside it. Averaged over the jitter of several frames, the line then has its width.
"""

from collections.abc import Collection, Iterable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkCommonCore import VTK_UNSIGNED_CHAR, vtkFloatArray, vtkUnsignedCharArray
from vtkmodules.vtkRenderingCore import vtkActor, vtkActor2D, vtkProp3D
from vtkmodules.vtkRenderingOpenGL2 import vtkOpenGLFramebufferObject, vtkTextureObject

from supersampler.arguments import checked_scale, ieee_arithmetic
from supersampler.conventions import camera_motion, halton_jitter
from supersampler.conventions.encodings import to_reversed_infinite
from supersampler.frame import Float32, Frame, Size
from supersampler.integrations.rgba import encode_rgba
from supersampler.model import Model
from supersampler.upscaler import Upscaler

Matrix = NDArray[np.float64]
_MAX_MEDIAN_MOTION = 0.5  # of the image; beyond it the camera has jumped
_MIN_TURN_COSINE = np.cos(np.radians(30.0))  # of the angle between view directions; below it, too
_TILE = 16  # side in pixels of the tiles in which the background moves with a surface
_MAX_THIN_SAMPLES = 32  # samples in a tile of a surface that is two samples wide
_PROBE_STEP = 16  # pixels between those whose motion is probed
_POINTS, _WIREFRAME = 0, 1  # `vtkProperty.GetRepresentation`
_DECLARED, _DONE = "//VTK::PositionVC::Dec", "//VTK::PositionVC::Impl"
_VERTEX = {_DECLARED: "out vec4 onLine;", _DONE: "onLine = gl_Position;"}
_FRAGMENT = {
    _DECLARED: "in vec4 onLine;",
    # The interpolated position is the foot of the perpendicular from the pixel's centre to the line.
    _DONE: """
        vec2 offLine = abs((onLine.xy / onLine.w * 0.5 + 0.5) * viewSize - gl_FragCoord.xy);
        if (dot(offLine, offLine) > 0.5 * lineShare * max(offLine.x, offLine.y)) discard;
    """,
}
_EDGE = "clamp(0.5 + 0.5*lineWidth - min( min( edist[0], edist[1]), edist[2]), 0.0, 1.0)"  # of VTK 9.7
_SHARP_EDGE = "step(min(min(edist[0], edist[1]), edist[2]), 0.5 * lineShare * lineWidth)"
_READ_FRAMEBUFFER, _DRAW_FRAMEBUFFER = 0x8CA8, 0x8CA9  # OpenGL's constants
_COLOR_BUFFER_BIT, _NEAREST = 0x4000, 0x2600


@dataclass(frozen=True, slots=True)
class SceneView:
    """Camera and props at one frame.

    Attributes:
        size: (width, height) of the render.
        jitter: see `Frame`.
        view_projection: without jitter, to a clip space from -1 to 1.
        near: distance of the near plane; of the far plane `far`.
        parallel: whether the projection is parallel.
        matrices: matrices of the props, from their own space to the world's.
    """

    size: Size
    jitter: tuple[float, float]
    view_projection: Matrix
    near: float
    far: float
    parallel: bool
    matrices: dict[vtkProp3D, Matrix]

    @classmethod
    def of(cls, renderer: Any, size: Size, jitter: tuple[float, float]) -> Self:
        """Read the view of a renderer whose viewport has the size, before the camera is jittered."""
        camera = renderer.GetActiveCamera()
        aspect = renderer.GetTiledAspectRatio()
        matrix = _array(camera.GetCompositeProjectionTransformMatrix(aspect, -1.0, 1.0))
        near, far = camera.GetClippingRange()
        props = [p for p in renderer.GetViewProps() if isinstance(p, vtkProp3D) and p.GetVisibility()]
        matrices = {prop: _array(prop.GetMatrix()) for prop in props}
        return cls(size, jitter, matrix, near, far, bool(camera.GetParallelProjection()), matrices)

    def frame_depth(self, buffer: Float32, unit: float) -> Float32:
        """Return unit / view distance of the depth buffer's values, 0 at the background."""
        if self.parallel:  # planes may lie behind the camera: distances count from the near plane
            range_ = self.far - self.near
            distance = np.float32(unit) / (np.float32(range_) * (buffer + np.float32(0.1)))
            return np.where(buffer < 1.0, distance, np.float32(0.0))
        depth = to_reversed_infinite(buffer, "forward", self.near, self.far)
        depth *= np.float32(unit / self.near)
        depth *= buffer < 1.0
        return depth

    def motion(self, buffer: Float32, previous: "SceneView") -> Float32:
        """Return `Frame.motion` of static props: that of the camera."""
        return self._motion(buffer, previous.view_projection)

    def moved_props(
        self, buffer: Float32, previous: "SceneView"
    ) -> Iterator[tuple[Collection[vtkProp3D], Float32]]:
        """Yield props that move together, and the motion of pixels that show them."""
        moves: dict[bytes, list[vtkProp3D]] = {}
        for prop, matrix in self.matrices.items():
            before = previous.matrices.get(prop)
            if before is not None and not np.array_equal(before, matrix):
                move = before @ np.linalg.inv(matrix)
                moves.setdefault(move.round(12).tobytes(), []).append(prop)
        for props in moves.values():
            move = previous.matrices[props[0]] @ np.linalg.inv(self.matrices[props[0]])
            yield props, self._motion(buffer, previous.view_projection @ move)

    def is_jump(self, motion: Float32, previous: "SceneView") -> bool:
        """Return whether the camera jumped, so that the history is useless."""
        if self.parallel != previous.parallel or self.size != previous.size:
            return True
        ahead, before = (view.view_projection[2, :3] for view in (self, previous))  # the view directions
        if ahead @ before < _MIN_TURN_COSINE * np.linalg.norm(ahead) * np.linalg.norm(before):
            return True
        probes = np.abs(motion[::_PROBE_STEP, ::_PROBE_STEP]) / np.array(self.size, np.float32)
        return bool(np.median(probes.max(axis=-1)) > _MAX_MEDIAN_MOTION)

    def _motion(self, buffer: Float32, previous: Matrix) -> Float32:
        return camera_motion(
            buffer, self.view_projection, previous, jitter=self.jitter, clip="minus_one_to_one"
        )


def move_background(vectors: NDArray[np.uint64], buffer: Float32) -> None:
    """Give the background of each tile the motion of the tile's closest surface, or 0 if it has few samples.

    Outlines of broad objects then keep their history. Behind a thin moving object, the background must be
    static: its trail is detected by its motion over the background.

    Args:
        vectors: (h, w) motion, two floats per word; changed at background pixels.
        buffer: (h, w) depth buffer, 1 at the background.
    """
    height, width = buffer.shape
    nearest = np.ones(-(-width // _TILE) * _TILE, np.float32)  # of each column; 1 beyond the last
    count = np.zeros(nearest.size, np.int32)  # of samples of surfaces in each column
    first = np.arange(0, width, _TILE)
    for top in range(0, height, _TILE):
        depth, motion = buffer[top : top + _TILE], vectors[top : top + _TILE]
        background = depth == 1.0
        if background.any():
            np.min(depth, axis=0, out=nearest[:width])
            column = first + nearest.reshape(-1, _TILE).argmin(axis=1)
            row = depth[:, column].argmin(axis=0)
            np.sum(~background, axis=0, out=count[:width])
            is_broad = count.reshape(-1, _TILE).sum(axis=1) > _MAX_THIN_SAMPLES
            found = np.where(is_broad, motion[row, column], np.uint64(0))
            np.copyto(motion, found.repeat(_TILE)[:width], where=background)


def _array(matrix: Any) -> Matrix:
    return np.array([[matrix.GetElement(row, column) for column in range(4)] for row in range(4)])


class LineWidths:
    """Renders lines and points at their width / `scale`.

    Args:
        scale: window size / render size, >= 1.
    """

    def __init__(self, scale: float) -> None:
        self._scale = scale
        self._edges: set[Any] = set()  # actors whose shaders are changed
        self._lines: set[Any] = set()

    @contextmanager
    def scaled(self, props: Iterable[Any], size: Size) -> Iterator[None]:
        """Scale the widths of the props within the block; `size` is the (width, height) of the render."""
        with ExitStack() as stack:
            for actor in props:
                if isinstance(actor, vtkActor):
                    self._scale_one(actor, size, stack)
            yield

    def restore(self) -> None:
        """Restore the shaders of all actors."""
        for actor in self._edges:
            actor.GetShaderProperty().ClearFragmentShaderReplacement(_EDGE, False)
        for actor in tuple(self._lines):
            self._end_thin_lines(actor)
        self._edges.clear()

    def _scale_one(self, actor: Any, size: Size, stack: ExitStack) -> None:
        look, shader = actor.GetProperty(), actor.GetShaderProperty()
        if look.GetRepresentation() == _POINTS or _count(actor, "Verts"):
            points = max(1.0, look.GetPointSize() / self._scale)
            stack.enter_context(changed(look, "PointSize", points))
        if look.GetEdgeVisibility():
            if actor not in self._edges:
                self._edges.add(actor)
                shader.AddFragmentShaderReplacement(_EDGE, False, _SHARP_EDGE, False)
            shader.GetFragmentCustomUniforms().SetUniformf("lineShare", 1.0 / self._scale)
        elif look.GetRepresentation() == _WIREFRAME or _count(actor, "Lines"):
            width = look.GetLineWidth() / self._scale
            if width < 1.0:
                self._begin_thin_lines(actor)
                shader.GetFragmentCustomUniforms().SetUniformf("lineShare", width)
                shader.GetFragmentCustomUniforms().SetUniform2f("viewSize", list(size))
            else:
                self._end_thin_lines(actor)
            stack.enter_context(changed(look, "LineWidth", max(1.0, width)))

    def _begin_thin_lines(self, actor: Any) -> None:
        if actor not in self._lines:
            self._lines.add(actor)
            shader = actor.GetShaderProperty()
            for place, code in _VERTEX.items():
                shader.AddVertexShaderReplacement(place, True, f"{place}\n{code}\n", False)
            for place, code in _FRAGMENT.items():
                shader.AddFragmentShaderReplacement(place, True, f"{place}\n{code}\n", False)

    def _end_thin_lines(self, actor: Any) -> None:
        if actor in self._lines:
            self._lines.remove(actor)
            for place in _VERTEX:
                actor.GetShaderProperty().ClearVertexShaderReplacement(place, True)
                actor.GetShaderProperty().ClearFragmentShaderReplacement(place, True)


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


def _count(actor: Any, kind: str) -> int:
    """Return the number of cells of a kind, "Lines" or "Verts"; 0 for an actor without vtkPolyData."""
    mapper = actor.GetMapper()
    mesh = None if mapper is None else mapper.GetInput()
    return int(getattr(mesh, f"GetNumberOf{kind}", int)())


class WindowPixels:
    """Reads the lower left part of a window's image, and replaces all of it by another image.

    Args:
        window: a `vtkRenderWindow` with OpenGL, without multi-sampling.
    """

    def __init__(self, window: Any) -> None:
        self._window = window
        self._color, self._depth = vtkUnsignedCharArray(), vtkFloatArray()
        self._texture, self._buffer = vtkTextureObject(), vtkOpenGLFramebufferObject()
        self._encoded = np.empty((0, 0), np.int32)

    def read_color(self, size: Size) -> Float32:
        """Return (h, w, 3) display values in [0, 1] of the lower left (width, height) pixels."""
        width, height = size
        self._window.GetPixelData(0, 0, width - 1, height - 1, 0, self._color, 0)
        pixels = vtk_to_numpy(self._color).reshape(height, width, 3)[::-1]  # VTK's row 0 is at the bottom
        color: Float32 = np.multiply(pixels, np.float32(1.0 / 255.0), dtype=np.float32)
        return color

    def read_depth(self, size: Size) -> Float32:
        """Return (h, w) of the depth buffer: 0 at the near plane, 1 at the far plane and the background."""
        width, height = size
        self._window.GetZbufferData(0, 0, width - 1, height - 1, self._depth)
        return np.ascontiguousarray(vtk_to_numpy(self._depth).reshape(height, width)[::-1])

    def show(self, image: Float32) -> None:
        """Write (h, w, 3) display values of the window's size to its colour buffer."""
        height, width = image.shape[:2]
        if self._encoded.shape != (height, width):
            self._encoded = np.empty((height, width), np.int32)
        encode_rgba(image, self._encoded)
        self._texture.SetContext(self._window)
        self._buffer.SetContext(self._window)
        state = self._window.GetState()
        state.PushFramebufferBindings()
        try:  # a copy: `SetPixelData` renders a rectangle, which is much slower in software
            pixels = self._encoded.view(np.uint8)
            self._texture.Create2DFromRaw(width, height, 4, VTK_UNSIGNED_CHAR, pixels)
            self._buffer.Bind(_READ_FRAMEBUFFER)
            self._buffer.AddColorAttachment(0, self._texture)
            self._buffer.ActivateReadBuffer(0)
            window = self._window.GetRenderFramebuffer()
            window.Bind(_DRAW_FRAMEBUFFER)
            window.ActivateDrawBuffer(0)
            corners = (0, width, 0, height)
            vtkOpenGLFramebufferObject.Blit(corners, corners, _COLOR_BUFFER_BIT, _NEAREST)
        finally:
            state.PopFramebufferBindings()


class SupersampledWindow:
    """A render window that renders at its size / `scale`, and shows what an `Upscaler` makes of it.

    Each `Render` of the window is one frame. While nothing moves, each adds samples to
    the image. Motion comes from the camera and the matrices of the props; a mesh whose points change has
    none, and blurs for a few frames. The background moves with the closest surface of each 16x16 pixels, so
    that outlines keep their history; beside thin objects, and without a surface, it is static. Lines and
    points keep their width. 2D props (text, scalar bars) and other renderers (axes, overlays) are rendered
    at full size on top. A camera jump or another window size restarts the history.

    Colours are display values, as VTK blends and resolves them.

    Attributes:
        upscaler: the Upscaler for the window's current size; None before the first image.

    Args:
        window: a `vtkRenderWindow` with OpenGL; its multi-sampling is turned off.
        renderer: the renderer of the scene, which covers the window.
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
        self._unit = 1.0  # view distance of depth 1, since the first frame
        self._view: SceneView | None = None  # of the last frame; None makes the next one the first
        self._small: tuple[ExitStack, SceneView] | None = None  # while the window renders small
        self._nested = False
        self._pixels = WindowPixels(window)
        self._samples = window.GetMultiSamples()
        window.SetMultiSamples(0)
        self._observers = [
            window.AddObserver("StartEvent", lambda *_: self._before_render()),
            window.AddObserver("EndEvent", lambda *_: self._after_render()),
        ]

    def reset(self) -> None:
        """Drop the history: the next image depends on one frame only."""
        self._view = None

    def disable(self) -> None:
        """Restore the window's own rendering."""
        while self._observers:
            self._window.RemoveObserver(self._observers.pop())
        self._widths.restore()
        self._window.SetMultiSamples(self._samples)

    @ieee_arithmetic
    def _before_render(self) -> None:
        """Make the window render this frame small and jittered, without 2D props and other renderers."""
        if self._nested:
            return
        self._window.SetMultiSamples(0)  # it may have been turned on again
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
            view = SceneView.of(self._renderer, size, jitter)
            x, y = camera.GetWindowCenter()
            center = x + 2.0 * jitter[0] / size[0], y - 2.0 * jitter[1] / size[1]  # jitter y points down
            stack.enter_context(changed(camera, "WindowCenter", *center))
            self._small = stack.pop_all(), view

    @ieee_arithmetic
    def _after_render(self) -> None:
        """Upscale the rendered frame, and show it."""
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

    def _frame(self, view: SceneView) -> Frame:
        color, buffer = self._pixels.read_color(view.size), self._pixels.read_depth(view.size)
        if self._view is None:
            self._unit, reset = view.near, True
            motion = np.zeros((*buffer.shape, 2), np.float32)
        else:
            motion = self._motion(view, buffer, self._view)
            reset = view.is_jump(motion, self._view)
        depth = view.frame_depth(buffer, self._unit)
        return Frame(color=color, depth=depth, motion=motion, jitter=view.jitter, reset=reset, exposure=1.0)

    def _motion(self, view: SceneView, buffer: Float32, previous: SceneView) -> Float32:
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
