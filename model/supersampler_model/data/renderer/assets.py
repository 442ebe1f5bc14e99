"""Meshes, textures, materials and environments on the GPU, each uploaded once and freed with its source."""

from collections.abc import Callable
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from supersampler_model.data.scenes.environment import Environment
from supersampler_model.data.scenes.mesh import Mesh
from supersampler_model.data.scenes.scene import Material, Texture

_SRGB8_ALPHA8 = 0x8C43
_MAPS = ("base_color", "normal", "orm", "emissive")
_PLAIN = ("3f4 3f4 4f4 2f4", "position", "normal", "tangent", "uv")
_SKINNED = ("4u2 4f4", "joints", "weights")
COVERAGE_ERROR = 0.15  # relative error of the fraction of a mip that passes the alpha test


class Assets:
    """The assets uploaded to one context."""

    def __init__(self, gl: Any) -> None:
        self._gl = gl
        self._buffers: WeakKeyDictionary[Mesh, list[Any]] = WeakKeyDictionary()
        self._arrays: WeakKeyDictionary[Mesh, dict[Any, Any]] = WeakKeyDictionary()
        self._textures: WeakKeyDictionary[Texture, dict[float | None, Any]] = WeakKeyDictionary()
        self._materials: WeakKeyDictionary[Material, Any] = WeakKeyDictionary()
        self._environments: WeakKeyDictionary[Environment, Any] = WeakKeyDictionary()
        self._white = gl.texture((1, 1), 4, b"\xff" * 4)

    def draw(self, mesh: Mesh, program: Any) -> None:
        """Draw all triangles of `mesh`."""
        arrays = self._arrays.setdefault(mesh, {})
        if program not in arrays:
            arrays[program] = self._vertex_array(mesh, program)
        arrays[program].render()

    def _vertex_array(self, mesh: Mesh, program: Any) -> Any:
        buffers = _once(self._buffers, mesh, self._upload_mesh)
        content: list[tuple[Any, ...]] = [(buffers[1], *_PLAIN)]
        if len(buffers) > 2:
            content.append((buffers[2], *_SKINNED))
        return self._gl.vertex_array(program, content, buffers[0], skip_errors=True)

    def _upload_mesh(self, mesh: Mesh) -> list[Any]:
        """Return buffers of indices, of vertices and, with a skin, of joints and weights."""
        vertices = np.concatenate([mesh.positions, mesh.normals, mesh.tangents, mesh.uv], axis=1)
        buffers = [mesh.indices.tobytes(), np.ascontiguousarray(vertices, np.float32).tobytes()]
        if mesh.skin is not None:
            skin = np.zeros(len(mesh.positions), [("joints", "u2", 4), ("weights", "f4", 4)])
            skin["joints"], skin["weights"] = mesh.skin.joints, mesh.skin.weights
            buffers.append(skin.tobytes())
        return [self._gl.buffer(data) for data in buffers]

    def bind_material(self, material: Material, block: int, *, maps: int = len(_MAPS)) -> None:
        """Bind the constants to uniform block `block`, the first `maps` textures to units from 0 on."""
        _once(self._materials, material, self._upload_material).bind_to_uniform_block(block)
        for unit, name in enumerate(_MAPS[:maps]):
            texture: Texture | None = getattr(material, f"{name}_texture")
            cutoff = material.alpha_cutoff if name == "base_color" else None
            (self._white if texture is None else self._texture(texture, cutoff)).use(unit)

    def _texture(self, texture: Texture, cutoff: float | None) -> Any:
        by_cutoff = self._textures.setdefault(texture, {})
        if cutoff not in by_cutoff:
            by_cutoff[cutoff] = self._upload_texture(texture, cutoff)
        return by_cutoff[cutoff]

    def _upload_material(self, material: Material) -> Any:
        cutoff = -1.0 if material.alpha_cutoff is None else material.alpha_cutoff
        has_maps = [float(getattr(material, f"{name}_texture") is not None) for name in _MAPS]
        rows = [
            (*material.base_color, 0.0),
            (material.roughness, material.metallic, material.specular, cutoff),
            (*material.emissive, 0.0),
            has_maps,
        ]
        return self._gl.buffer(np.array(rows, np.float32).tobytes())

    def _upload_texture(self, texture: Texture, cutoff: float | None) -> Any:
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

    def environment(self, environment: Environment) -> tuple[Any, NDArray[np.float64]]:
        """Return the panorama's texture, rougher from mip to mip, and its irradiance (9, 3)."""
        texture, irradiance = _once(self._environments, environment, self._upload_environment)
        return texture, irradiance

    def _upload_environment(self, environment: Environment) -> tuple[Any, Any]:
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


def _once(made: Any, source: Any, make: Callable[[Any], Any]) -> Any:
    if source not in made:
        made[source] = make(source)
    return made[source]


def _keep_coverage(texture: Any, pixels: NDArray[np.uint8], cutoff: float) -> None:
    """Scale the opacity of each mip so that the same fraction passes the alpha test as in `pixels`.

    Without that, distant fences vanish. Mips too small for it are dropped: there holes alias, as in games.
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
