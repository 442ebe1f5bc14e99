"""Lines and points of VTK props, as wide in the upscaled image as without supersampling.

OpenGL renders no line narrower than one pixel. For a narrower line, the shader discards the pixels whose
centres are beside it. Averaged over the jitter of several frames, the line then has its width.
"""

from collections.abc import Iterable, Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

from vtkmodules.vtkRenderingCore import vtkActor

from supersampler.frame import Size

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
        """Render the props so within the block; `size` is the (width, height) of the render."""
        with ExitStack() as stack:
            for actor in props:
                if isinstance(actor, vtkActor):
                    self._scale_one(actor, size, stack)
            yield

    def restore(self) -> None:
        """Give all actors their own shaders again."""
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
    """Set a property of a VTK object, and set it back."""
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
    """Return how many cells of a kind, "Lines" or "Verts", an actor has; 0 if it shows no vtkPolyData."""
    mapper = actor.GetMapper()
    mesh = None if mapper is None else mapper.GetInput()
    return int(getattr(mesh, f"GetNumberOf{kind}", int)())
