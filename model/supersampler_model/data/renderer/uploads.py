"""GPU copies of a scene: meshes, textures, materials, environments, and the contents of uniform blocks."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from supersampler_model.data.scenes import scene as scenes

Size = tuple[int, int]
DRAW_BYTES = 256  # per instance; a multiple of every GL's offset alignment
PALETTES_BYTES = 2 * scenes.MAX_JOINTS * 64
SHADOW_SIZE = 2048  # side of the sun's shadow map, texels; the spot's has half of it
_SRGB8_ALPHA8 = 0x8C43
_MAPS = ("base_color", "normal", "orm", "emissive")
_PLAIN = ("3f4 3f4 4f4 2f4", "position", "normal", "tangent", "uv")
_SKINNED = ("4u2 4f4", "joints", "weights")
COVERAGE_ERROR = 0.15  # maximum relative error of the fraction of a mip that passes the alpha test


class Assets:
    """The assets uploaded to one context."""

    def __init__(self, gl: Any) -> None:
        self._gl = gl
        self._uploads: WeakKeyDictionary[Any, dict[Any, Any]] = WeakKeyDictionary()  # by source and variant
        self._white = gl.texture((1, 1), 4, b"\xff" * 4)

    def _once(self, source: Any, variant: Any, upload: Callable[[], Any]) -> Any:
        uploads = self._uploads.setdefault(source, {})
        if variant not in uploads:
            uploads[variant] = upload()
        return uploads[variant]

    def draw(self, mesh: scenes.Mesh, program: Any) -> None:
        """Draw all triangles of `mesh`."""
        self._once(mesh, program, lambda: self._vertex_array(mesh, program)).render()

    def _vertex_array(self, mesh: scenes.Mesh, program: Any) -> Any:
        buffers = self._once(mesh, None, lambda: self._upload_mesh(mesh))
        content: list[tuple[Any, ...]] = [(buffers[1], *_PLAIN)]
        if len(buffers) > 2:
            content.append((buffers[2], *_SKINNED))
        return self._gl.vertex_array(program, content, buffers[0], skip_errors=True)

    def _upload_mesh(self, mesh: scenes.Mesh) -> list[Any]:
        """Return buffers of indices, of vertices and, for a skin, of joints and weights."""
        vertices = np.concatenate([mesh.positions, mesh.normals, mesh.tangents, mesh.uv], axis=1)
        buffers = [mesh.indices.tobytes(), np.ascontiguousarray(vertices, np.float32).tobytes()]
        if mesh.skin is not None:
            skin = np.zeros(len(mesh.positions), [("joints", "u2", 4), ("weights", "f4", 4)])
            skin["joints"], skin["weights"] = mesh.skin.joints, mesh.skin.weights
            buffers.append(skin.tobytes())
        return [self._gl.buffer(data) for data in buffers]

    def bind_material(self, material: scenes.Material, block: int, *, maps: int = len(_MAPS)) -> None:
        """Bind the constants to uniform block `block`, and the first `maps` textures to units 0, 1, ..."""
        constants = self._once(material, None, lambda: self._upload_material(material))
        constants.bind_to_uniform_block(block)
        for unit, name in enumerate(_MAPS[:maps]):
            texture: scenes.Texture | None = getattr(material, f"{name}_texture")
            cutoff = material.alpha_cutoff if name == "base_color" else None
            if texture is None:
                self._white.use(unit)
            else:
                self._once(texture, cutoff, partial(self._upload_texture, texture, cutoff)).use(unit)

    def _upload_material(self, material: scenes.Material) -> Any:
        cutoff = -1.0 if material.alpha_cutoff is None else material.alpha_cutoff
        has_maps = [float(getattr(material, f"{name}_texture") is not None) for name in _MAPS]
        rows = [
            (*material.base_color, 0.0),
            (material.roughness, material.metallic, material.specular, cutoff),
            (*material.emissive, 0.0),
            has_maps,
        ]
        return self._gl.buffer(np.array(rows, np.float32).tobytes())

    def _upload_texture(self, texture: scenes.Texture, cutoff: float | None) -> Any:
        height, width, channels = texture.pixels.shape
        pixels = np.full((height, width, 4), 255, np.uint8)
        pixels[..., :channels] = texture.pixels
        internal = _SRGB8_ALPHA8 if texture.srgb else None
        uploaded = self._gl.texture((width, height), 4, pixels.tobytes(), internal_format=internal)
        uploaded.build_mipmaps()
        if cutoff is not None:
            _keep_coverage(uploaded, pixels, cutoff)
        uploaded.filter = (self._gl.LINEAR_MIPMAP_LINEAR, self._gl.LINEAR)
        return uploaded

    def environment(self, environment: scenes.Environment) -> tuple[Any, NDArray[np.float64]]:
        """Return the panorama's texture, with mips for increasing roughness, and its irradiance (9, 3)."""
        texture, irradiance = self._once(environment, None, lambda: self._upload_environment(environment))
        return texture, irradiance

    def _upload_environment(self, environment: scenes.Environment) -> tuple[Any, Any]:
        levels = environment.mips()
        height, width = levels[0].shape[:2]
        texture = self._gl.texture((width, height), 3, levels[0].tobytes(), dtype="f4")
        texture.build_mipmaps(0, len(levels) - 1)
        for index, level in enumerate(levels[1:], start=1):
            viewport = (0, 0, level.shape[1], level.shape[0])
            texture.write(np.ascontiguousarray(level).tobytes(), viewport=viewport, level=index)
        texture.filter = (self._gl.LINEAR_MIPMAP_LINEAR, self._gl.LINEAR)
        texture.repeat_y = False
        return texture, environment.irradiance()


def _keep_coverage(texture: Any, pixels: NDArray[np.uint8], cutoff: float) -> None:
    """Scale the opacity of each mip so that the same fraction passes the alpha test as in `pixels`.

    Otherwise distant fences would vanish. Mips too small for this are dropped; holes alias there.
    """
    threshold = 255.0 * cutoff
    covered = float((pixels[..., 3] >= threshold).mean())
    width, height = texture.size
    mips = []
    for level in range(1, max(width, height).bit_length()):
        mip = np.frombuffer(texture.read(level=level), np.uint8).reshape(-1, 4).copy()
        passes = float(np.quantile(mip[:, 3], 1.0 - covered))  # the cutoff that passes the same fraction
        mip[:, 3] = np.clip(np.ceil(mip[:, 3] * (threshold / max(passes, 1.0))), 0.0, 255.0)
        if abs(float((mip[:, 3] >= threshold).mean()) - covered) > COVERAGE_ERROR * covered:
            break
        mips.append(mip)
    texture.build_mipmaps(0, len(mips))
    for level, mip in enumerate(mips, start=1):
        size = max(1, width >> level), max(1, height >> level)
        texture.write(mip.tobytes(), viewport=(0, 0, *size), level=level)


@dataclass(frozen=True, slots=True)
class Raster:
    """A grid of samples over a part of the image."""

    size: Size  # samples (x, y)
    corner: tuple[float, float]  # of the part: (0, 0) is the top left corner of the image, (1, 1) the other
    extent: tuple[float, float]  # of the part, in the same unit
    pixels: Size  # size of the image in whose pixels motion is measured
    filter_width: float = 1.0  # width of a display pixel in samples of this grid, for texture filtering

    @classmethod
    def of_frame(
        cls, size: Size, jitter: tuple[float, float] = (0.0, 0.0), filter_width: float = 1.0
    ) -> "Raster":
        """Return a grid of one sample per pixel, at its centre + jitter."""
        return cls(size, (jitter[0] / size[0], jitter[1] / size[1]), (1.0, 1.0), size, filter_width)

    def window(self) -> list[float]:
        """Return scale x, y and offset x, y that map this part of clip space to [-1, 1]."""
        scale = 1.0 / np.array(self.extent)
        middle = 2.0 * np.array(self.corner) + self.extent - 1.0
        return [*scale, *(-middle * scale)]


def columns(*matrices: scenes.Values) -> bytes:
    """Return matrices (..., 4, 4) column by column, as in GL."""
    return b"".join(np.ascontiguousarray(np.swapaxes(m, -1, -2), np.float32).tobytes() for m in matrices)


def rows(*vectors: Any) -> bytes:
    """Return vectors of up to four numbers, padded with zeros."""
    return b"".join(np.array([*v, *[0.0] * (4 - len(v))], np.float32).tobytes() for v in vectors)


def view_block(scene: scenes.Scene, aspect: float, raster: Raster) -> bytes:
    """Return block View: the camera now and before, and the rendered part of the image."""
    camera, view = scene.camera, scene.camera.view()
    projection = camera.projection(aspect)
    before = scene.camera_before.projection(aspect) @ scene.camera_before.view()
    rays = np.zeros((4, 4))
    rays[:3, :3] = view[:3, :3].T @ np.diag([1.0 / projection[0, 0], 1.0 / projection[1, 1], -1.0])
    vectors = rows(
        raster.window(), (*camera.position, scenes.NEAR), view[0, :3], view[1, :3],
        (*raster.pixels, raster.filter_width),
    )  # fmt: skip
    return columns(projection @ view, before, rays) + vectors


def draw_blocks(instances: tuple[scenes.Instance, ...]) -> bytes:
    """Return block Draw of each instance, each `DRAW_BYTES` long."""
    blocks = []
    for instance in instances:
        normal = np.eye(4)
        normal[:3, :3] = _normal_matrix(instance.model[:3, :3])
        block = columns(instance.model, np.asarray(instance.model_before), normal)
        is_thin, moves = instance.thin, instance.moves()
        block += rows((instance.emission, is_thin and not moves, is_thin and moves, moves and not is_thin))
        blocks.append(block.ljust(DRAW_BYTES, b"\0"))
    return b"".join(blocks)


def _normal_matrix(model: scenes.Matrix) -> scenes.Matrix:
    """Return the inverse transpose (3, 3), or cofactors of the same direction if the model is flattened."""
    if np.linalg.det(model) != 0.0:
        return np.asarray(np.linalg.inv(model).T)
    x, y, z = model.T
    return np.stack([np.cross(y, z), np.cross(z, x), np.cross(x, y)], axis=1)


def palette_blocks(instances: list[scenes.Instance]) -> bytes:
    """Return block Palettes of each skinned instance, each `PALETTES_BYTES` long."""
    blocks = []
    for instance in instances:
        palettes = np.zeros((2, scenes.MAX_JOINTS, 4, 4))
        for palette, joints in zip(palettes, (instance.palette, instance.palette_before), strict=True):
            palette[: len(np.asarray(joints))] = joints
        blocks.append(columns(palettes))
    return b"".join(blocks)


def lights_block(scene: scenes.Scene, irradiance: scenes.Values) -> bytes:
    """Return block Lights."""
    height = scene.environment.pixels.shape[0]
    sun = scene.sun or scenes.Sun(direction=(0.0, -1.0, 0.0), color=(0.0, 0.0, 0.0))
    spot = scene.spot or scenes.Spot(position=(0.0, 1.0, 0.0), target=(0.0, 0.0, 0.0), color=(0.0, 0.0, 0.0))
    to_sun = -np.array(sun.direction) / np.linalg.norm(sun.direction)
    axis = np.subtract(spot.target, spot.position)
    axis = axis / np.linalg.norm(axis)
    outer, inner = np.cos(np.radians([spot.outer, min(spot.inner, spot.outer - 1e-3)]))
    spot_texel = 2.0 * np.tan(np.radians(spot.outer)) / (SHADOW_SIZE // 2)
    vectors = [
        (*to_sun, 2.0 * sun.radius / SHADOW_SIZE), sun.color,
        (*spot.position, spot.reach), (*axis, spot_texel), (*spot.color, inner),
        (len(scene.points), outer),
        (int(np.log2(height)), np.log2(height / np.pi)),
    ]  # fmt: skip
    padding = [(0.0,)] * (scenes.MAX_POINTS - len(scene.points))
    points = [*((*point.position, point.reach) for point in scene.points), *padding]
    colors = [*(point.color for point in scene.points), *padding]
    return columns(sun.matrix(), spot.matrix()) + rows(*vectors, *irradiance, *points, *colors)
