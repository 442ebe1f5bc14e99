"""Camera, props and motion of a VTK renderer, and what of it is upscaled."""

import re
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from functools import cache
from typing import Any, Self

import numpy as np
from numpy.typing import NDArray
from vtkmodules import vtkRenderingCore as vtk
from vtkmodules.vtkCommonCore import reference

from supersampler.conventions import camera_motion
from supersampler.conventions.encodings import to_reversed_infinite
from supersampler.frame import Float32, Size

Matrix = NDArray[np.float64]
_MAX_MEDIAN_MOTION = 0.5  # of the image; beyond it the camera has jumped
_MIN_TURN_COSINE = np.cos(np.radians(30.0))  # of the angle between view directions; below it, too
_TILE = 16  # side in pixels of the tiles in which the background moves with a surface
_MAX_THIN_SAMPLES = 32  # samples in a tile of a surface that is two samples wide
_PROBE_STEP = 16  # pixels between those whose motion is probed
_FARTHEST = 0.99999  # maximum depth of a surface; 1 is the background
_REACTIVE = 0.3  # of volumes; errors are larger at 0 and at 1
_SURFACE = 2  # `vtkProperty.GetRepresentation`
_GENERATED = (
    "vtkAnnotatedCubeActor", "vtkAxesActor", "vtkAxisActor", "vtkCubeAxesActor", "vtkPolarAxesActor"
)  # props that make their lines, surfaces and text  # fmt: skip
_MIN_VOLUME = 1e-9  # of a transformed cube, relative to its edges; below it, the matrix is flat
_UPRIGHT = ("vtkTextActor", "vtkScalarBarActor", "vtkCornerAnnotation", "vtkLegendBoxActor")
_SURFACE_TEXTURES = ("albedoTex", "materialTex", "normalTex", "emissiveTex", "anisotropyTex", "coatNormalTex")
_LOOKS = ("Property", "BackfaceProperty", "ShaderProperty", "TextProperty", "PropertyKeys")  # of a prop
_COMPOSING = (
    "Layer", "Pass", "PreserveColorBuffer", "PreserveDepthBuffer", "UseFXAA", "UseShadows", "UseSSAO"
)  # fmt: skip
_RENDERER_LOOKS = (
    "Ambient", "Background", "Background2", "BackgroundAlpha", "EnvironmentRight", "EnvironmentUp",
    "GradientBackground", "GradientMode", "MaximumNumberOfPeels", "OcclusionRatio", "TexturedBackground",
    "TwoSidedLighting", "UseDepthPeeling", "UseDepthPeelingForVolumes", "UseHiddenLineRemoval",
    "UseImageBasedLighting", "UseOIT", "UseSphericalHarmonics",
)  # fmt: skip


@dataclass(frozen=True, slots=True)
class SceneView:
    """Camera and props at one frame.

    Attributes:
        size: (width, height) of the render.
        jitter: see `Frame`.
        view_projection: without jitter, to a clip space from -1 to 1.
        near, far: distances of the near plane and the far plane.
        parallel: whether the projection is parallel.
        matrices: matrices of the visible actors and volumes, from their own space to the world's.
        upscaled: the visible props that are upscaled.
        aspect: width / height that the camera projects to.
        sky: `view_projection` without the camera's position; None without a skybox.
    """

    size: Size
    jitter: tuple[float, float]
    view_projection: Matrix
    near: float
    far: float
    parallel: bool
    matrices: dict[vtk.vtkProp3D, Matrix]
    upscaled: frozenset[vtk.vtkProp3D]
    aspect: float
    sky: Matrix | None

    @classmethod
    def of(cls, renderer: Any, upscaled: frozenset[vtk.vtkProp3D], aspect: float | None = None) -> Self:
        """Read the view of a renderer, before the camera is jittered; None is the viewport's aspect."""
        camera = renderer.GetActiveCamera()
        aspect = renderer.GetTiledAspectRatio() if aspect is None else aspect
        matrix = _array(camera.GetCompositeProjectionTransformMatrix(aspect, -1, 1))
        near, far = camera.GetClippingRange()
        props = visible(renderer)
        matrices = {prop: _array(prop.GetMatrix()) for prop in props if _has_motion(prop)}
        sky = None
        if any(prop.IsA("vtkSkybox") for prop in props):
            sky = _array(camera.GetModelViewTransformMatrix())
            sky[:3, 3] = 0.0
            sky = _array(camera.GetProjectionTransformMatrix(aspect, -1, 1)) @ sky
        return cls(
            size=tuple(renderer.GetSize()), jitter=(0.0, 0.0), view_projection=matrix, near=near, far=far,
            parallel=bool(camera.GetParallelProjection()), matrices=matrices, upscaled=upscaled,
            aspect=aspect, sky=sky,
        )  # fmt: skip

    def is_same(self, other: "SceneView") -> bool:
        """Return whether neither the camera nor a prop has moved."""
        return np.array_equal(self.view_projection, other.view_projection) and all(
            _is_equal(other.matrices.get(prop), matrix) for prop, matrix in self.matrices.items()
        )

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
        return self._motion(buffer, self.view_projection, previous.view_projection)

    def sky_motion(self, buffer: Float32, previous: "SceneView") -> Float32 | None:
        """Return `Frame.motion` of a skybox, which is infinitely far away; None without one."""
        if self.sky is None or previous.sky is None:
            return None
        return self._motion(buffer, self.sky, previous.sky)

    def knows_motion(self, previous: "SceneView") -> bool:
        """Return whether all props that moved have a matrix with an inverse."""
        moved = (p for p, matrix in self.matrices.items() if not _is_equal(previous.matrices.get(p), matrix))
        return not any(_is_flat(self.matrices[prop]) for prop in moved)

    def moved_props(
        self, buffer: Float32, previous: "SceneView"
    ) -> Iterator[tuple[Collection[vtk.vtkProp3D], Float32]]:
        """Yield upscaled props that move together, and the motion of pixels that show them."""
        moves: dict[bytes, list[vtk.vtkProp3D]] = {}
        for prop, matrix in self.matrices.items():
            before = previous.matrices.get(prop) if prop in self.upscaled else None
            if before is not None and not _is_equal(before, matrix):
                move = before @ np.linalg.inv(matrix)
                moves.setdefault(move.round(12).tobytes(), []).append(prop)
        for props in moves.values():
            move = previous.matrices[props[0]] @ np.linalg.inv(self.matrices[props[0]])
            yield props, self._motion(buffer, self.view_projection, previous.view_projection @ move)

    def is_jump(self, motion: Float32, previous: "SceneView") -> bool:
        """Return whether the camera jumped, so that the history is useless."""
        if self.parallel != previous.parallel:
            return True
        ahead, before = (view.view_projection[2, :3] for view in (self, previous))  # the view directions
        if ahead @ before < _MIN_TURN_COSINE * np.linalg.norm(ahead) * np.linalg.norm(before):
            return True
        probes = np.abs(motion[::_PROBE_STEP, ::_PROBE_STEP]) / np.array(self.size, np.float32)
        return bool(np.median(probes.max(axis=-1)) > _MAX_MEDIAN_MOTION)

    def place_translucent(self, buffer: Float32) -> Float32:
        """Give the background behind volumes and translucent surfaces the depth of their centre.

        They write no depth. What they show is on both sides of that depth.

        Args:
            buffer: (h, w) depth buffer, 1 at the background; changed.

        Returns:
            (h, w) 0.3 where only volumes may be, else 0; see `Frame.reactive`.
        """
        mask = np.zeros(buffer.shape, np.float32)
        for prop in self.matrices:
            if prop in self.upscaled and _is_translucent(prop):
                columns, rows, depth = self._enclosing(prop.GetBounds())
                part = buffer[rows, columns]
                if isinstance(prop, vtk.vtkVolume):
                    mask[rows, columns][part == 1.0] = _REACTIVE
                part[part == 1.0] = min(depth, _FARTHEST)
        return mask

    def translucent_pixels(self, props: Collection[vtk.vtkProp3D]) -> NDArray[np.bool_]:
        """Return a mask (h, w) of the pixels in boxes of the volumes and translucent surfaces among these."""
        mask = np.zeros(self.size[::-1], np.bool_)
        for prop in filter(_is_translucent, props):
            columns, rows, _ = self._enclosing(prop.GetBounds())
            mask[rows, columns] = True
        return mask

    def _enclosing(self, bounds: tuple[float, ...]) -> tuple[slice, slice, float]:
        """Return the columns and rows that enclose a box of the world, and the depth of its centre."""
        x, y, z = np.reshape(bounds, (3, 2))
        corners = np.stack(np.meshgrid(x, y, z), axis=-1).reshape(-1, 3)
        points = np.vstack([corners, corners.mean(axis=0)])
        clip = np.column_stack([points, np.ones(9)]) @ self.view_projection.T
        depth = float(0.5 + 0.5 * clip[8, 2] / clip[8, 3])
        if clip[:, 3].min() <= 0.0:  # a corner is behind the camera
            return slice(None), slice(None), depth if 0.0 < depth < 1.0 else 0.5
        places = (0.5 + 0.5 * clip[:8, :2] / clip[:8, 3:] * (1, -1)) * self.size
        low, high = np.clip([places.min(axis=0) - 1, places.max(axis=0) + 2], 0, self.size).astype(int)
        return slice(low[0], high[0]), slice(low[1], high[1]), depth

    def _motion(self, buffer: Float32, now: Matrix, previous: Matrix) -> Float32:
        return camera_motion(buffer, now, previous, jitter=self.jitter, clip="minus_one_to_one")


def visible(renderer: Any) -> list[Any]:
    """Return the visible props of a renderer."""
    return [prop for prop in renderer.GetViewProps() if prop.GetVisibility()]


def is_upscaled(prop: Any) -> bool:
    """Return whether a prop is a volume or consists of surfaces only, without lines, points or text."""
    if isinstance(prop, vtk.vtkVolume):
        return True
    if not isinstance(prop, vtk.vtkActor) or isinstance(prop, vtk.vtkFollower) or prop.GetMapper() is None:
        return False
    look = prop.GetProperty()
    if look.GetRepresentation() != _SURFACE or look.GetEdgeVisibility() or look.GetVertexVisibility():
        return False
    if prop.GetMapper().IsA("vtkPointGaussianMapper") or _is_generated(prop) or _has_own_vertices(prop):
        return False
    return not any(m.GetNumberOfLines() or m.GetNumberOfVerts() for m in _meshes(prop.GetMapper()))


def is_on_top(prop: Any) -> bool:
    """Return whether a prop is rendered on top of each image, as text, charts and widgets are."""
    return not isinstance(prop, (vtk.vtkProp3D, vtk.vtkPropAssembly))


def has_oblique_lines(prop: Any) -> bool:
    """Return whether a prop on top may have edges that are not along rows or columns of pixels."""
    return is_on_top(prop) and not any(prop.IsA(name) for name in _UPRIGHT)


def _has_motion(prop: Any) -> bool:
    """Return whether the motion of a prop follows from its matrix."""
    return (
        isinstance(prop, (vtk.vtkActor, vtk.vtkVolume))
        and not isinstance(prop, vtk.vtkFollower)
        and not _is_generated(prop)
    )


def _is_generated(prop: Any) -> bool:
    """Return whether a prop makes its lines, surfaces and text itself, without a mapper."""
    return any(prop.IsA(name) for name in _GENERATED)


def is_composed(renderer: Any) -> bool:
    """Return whether an image is more than a render of props: it keeps what was there, or is filtered."""
    return not renderer.GetErase() or any(_value(renderer, name) for name in _COMPOSING)


def _has_own_shaders(shaders: Any) -> bool:
    """Return whether a `vtkShaderProperty` has code of the program."""
    return bool(
        shaders.GetNumberOfShaderReplacements()
        or shaders.HasFragmentShaderCode()
        or shaders.HasVertexShaderCode()
    )


def _has_own_vertices(prop: Any) -> bool:
    """Return whether a shader of the program places vertices, so that their motion is unknown."""
    shaders, code, unused = prop.GetShaderProperty(), reference(""), (reference(""), reference(False))
    for index in range(shaders.GetNumberOfShaderReplacements()):
        shaders.GetNthShaderReplacement(index, *unused, code, reference(False))
        if "gl_Position" in str(code):
            return True
    return bool(shaders.HasVertexShaderCode())


def _is_translucent(prop: Any) -> bool:
    """Return whether a prop writes no depth."""
    return isinstance(prop, vtk.vtkVolume) or bool(prop.HasTranslucentPolygonalGeometry())


def _is_equal(one: Matrix | None, other: Matrix) -> bool:
    return one is not None and np.array_equal(one, other)


def _is_flat(matrix: Matrix) -> bool:
    edges = np.linalg.norm(matrix[:3, :3], axis=0).prod()
    return not abs(np.linalg.det(matrix[:3, :3])) > _MIN_VOLUME * edges


def appearance(renderer: Any) -> tuple[Any, ...]:
    """Return what an image depends on, apart from the camera and the matrices of props, to be compared.

    Props, their properties, data and textures count by identity and modification time; lights and the
    renderer by value, as VTK modifies them while it renders.
    """
    lights = tuple(_light(light) for light in renderer.GetLights())
    looks = tuple(_value(renderer, name) for name in _RENDERER_LOOKS)
    textures = [_texture(t) for t in (renderer.GetBackgroundTexture(), renderer.GetEnvironmentTexture())]
    props = tuple((p, *_state(p)) for p in renderer.GetViewProps() if not is_on_top(p))
    return lights, looks, *textures, props


def _value(vtk_object: Any, name: str) -> Any:
    """Return a property of a VTK object; None if this version lacks it."""
    get = getattr(vtk_object, f"Get{name}", None)
    return None if get is None else get()


def _light(light: Any) -> tuple[Any, ...]:
    place = () if light.LightTypeIsHeadlight() else (light.GetPosition(), light.GetFocalPoint())
    if light.LightTypeIsSceneLight():  # VTK sets the matrices of others when the camera moves
        place += (light.GetTransformedPosition(), light.GetTransformedFocalPoint())
    return (
        light.GetSwitch(), light.GetLightType(), light.GetIntensity(), light.GetAmbientColor(),
        light.GetDiffuseColor(), light.GetSpecularColor(), light.GetPositional(), light.GetConeAngle(),
        light.GetExponent(), light.GetAttenuationValues(), *place,
    )  # fmt: skip


def _state(prop: Any) -> tuple[Any, ...]:
    """Return the visibility of a prop and the modification times of what it shows."""
    if not prop.GetVisibility():
        return (0,)
    state: list[Any] = [1] if _has_motion(prop) else [1, prop.GetRedrawMTime()]
    state += [_value(prop, name) for name in ("ForceOpaque", "ForceTranslucent")]
    parts = [_value(prop, name) for name in _LOOKS]
    parts += _own_looks(prop) if _is_generated(prop) else []
    if _has_own_shaders(shaders := prop.GetShaderProperty()):
        parts += [shaders.GetVertexCustomUniforms(), shaders.GetFragmentCustomUniforms()]
    textures = [_value(prop, "Texture")]
    if isinstance(prop, vtk.vtkActor):
        textures += [prop.GetProperty().GetTexture(name) for name in _SURFACE_TEXTURES]
    if (mapper := _value(prop, "Mapper")) is not None:
        parts += [mapper, *(mapper.GetClippingPlanes() or ()), *_data(mapper), _value(mapper, "MaskInput")]
        inner = _value(mapper, "PolyDataMapper")  # of a `vtkDataSetMapper`, made when it is first in view
        parts += [] if inner is None else [inner.GetInput()]
    for part in _parts(prop):
        matrix = _value(part, "Matrix")
        state += [part, None if matrix is None else _array(matrix).tobytes(), _state(part)]
    return (*state, *map(_modified, parts), *map(_texture, textures))


@cache
def _look_names(kind: type) -> tuple[str, ...]:
    """Return the names of a class's methods that return properties, captions and coordinates."""
    return tuple(
        name for name in dir(kind) if re.fullmatch(r"Get\w+(Property|CaptionActor2D|Coordinate)", name)
    )


def _own_looks(prop: Any) -> Iterator[Any]:
    """Yield the properties of what a prop makes itself, such as axes, and of their captions."""
    for name in _look_names(prop.__class__):
        get = getattr(prop, name)
        for arguments in ((), (0,), (1,), (2,)):  # some are those of an axis
            try:
                look = get(*arguments)
            except (TypeError, ValueError):
                continue
            yield look
            if look is not None and look.IsA("vtkProp"):
                yield from _own_looks(look)


def _parts(prop: Any) -> Iterator[Any]:
    """Yield the props of an assembly or a follower, those of a multi-volume, or the level of detail shown."""
    yield from _value(prop, "Parts") or ()
    if prop.IsA("vtkProp3DFollower") and (followed := prop.GetProp3D()) is not None:
        yield followed
    if prop.IsA("vtkMultiVolume") and (mapper := prop.GetMapper()) is not None:
        ports = range(mapper.GetNumberOfInputPorts())
        yield from (prop.GetVolume(port) for port in ports if mapper.GetNumberOfInputConnections(port))
    if prop.IsA("vtkLODProp3D"):
        shown = vtk.vtkPropCollection()
        prop.GetActors(shown)
        prop.GetVolumes(shown)
        yield from shown


def _modified(vtk_object: Any) -> tuple[Any, int]:
    return vtk_object, 0 if vtk_object is None else vtk_object.GetMTime()


def _texture(texture: Any) -> tuple[Any, ...]:
    """Return the modification times of a texture, its transform and its images."""
    if texture is None:
        return (None,)
    return (*_modified(texture), *map(_modified, (texture.GetTransform(), *_inputs(texture))))


def _inputs(algorithm: Any, first_port: int = 0) -> Iterator[Any]:
    """Yield the data of all inputs of a mapper or a texture, brought up to date."""
    for port in range(first_port, algorithm.GetNumberOfInputPorts()):
        for index in range(algorithm.GetNumberOfInputConnections(port)):
            algorithm.GetInputAlgorithm(port, index).Update()
            yield algorithm.GetInputDataObject(port, index)


def _data(mapper: Any, first_port: int = 0) -> Iterator[Any]:
    """Yield the data sets of a mapper, each block on its own."""
    for data in _inputs(mapper, first_port):
        if data is None or not data.IsA("vtkCompositeDataSet"):
            yield data
            continue
        blocks = data.NewIterator()
        blocks.InitTraversal()
        while not blocks.IsDoneWithTraversal():
            yield blocks.GetCurrentDataObject()
            blocks.GoToNextItem()


def _meshes(mapper: Any) -> Iterator[Any]:
    """Yield the polygons that a mapper draws."""
    if mapper.IsA("vtkDataSetMapper"):  # it extracts them
        mapper.Update()
        inner = mapper.GetPolyDataMapper()
        yield from () if inner is None else _meshes(inner)
        return
    is_glyphs = mapper.IsA("vtkGlyph3DMapper")  # its first input only tells where they are
    for data in _data(mapper, first_port=1 if is_glyphs else 0):
        if data is not None and data.IsA("vtkPolyData"):
            yield data


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
    # `GetData` is a pointer in VTK 9.2
    return np.array([[matrix.GetElement(row, column) for column in range(4)] for row in range(4)])
