"""The scene of one frame, with its state in the previous frame, from which motion vectors are computed.

A scene is plain arrays. Space is right-handed with y up, in metres. Matrices are (4, 4), row-major, acting on
column vectors: world = model @ local. Colours are linear RGB. Lights and the environment are in the same
radiometric unit: a white wall facing a sun of colour pi is as bright as an environment of 1.

Meshes, materials, textures and environments are uploaded once and recognised by identity: share them between
the frames of a sequence. Checks cover what files may get wrong, and errors that would go unnoticed in images.
"""

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from supersampler_model.data.errors import SceneError, check_number

Rng: TypeAlias = np.random.Generator
Values: TypeAlias = NDArray[np.float64]
Vector: TypeAlias = tuple[float, float, float]
Color: TypeAlias = tuple[float, float, float]
Matrix: TypeAlias = NDArray[np.float64]
"""(4, 4), row-major, acting on column vectors."""
Matrices: TypeAlias = NDArray[np.float64]
"""(n, 4, 4)."""
Points: TypeAlias = NDArray[np.float32]
Indices: TypeAlias = NDArray[np.uint32]
Joints: TypeAlias = NDArray[np.uint16]
Pixels: TypeAlias = NDArray[np.uint8]


NEAR = 0.1
"""Distance of the near plane, metres; depth is NEAR / view distance."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Camera:
    """A pinhole camera."""

    position: Vector
    target: Vector
    up: Vector = (0.0, 1.0, 0.0)
    fov_y: float = 60.0  # vertical field of view, degrees
    exposure: float = 1.0  # factor of the colour before the tone curve; the colour is stored without it

    def view(self) -> Matrix:
        """Return world to view: x right, y up, looking at -z."""
        return look_at(self.position, self.target, self.up)

    def projection(self, aspect: float) -> Matrix:
        """Return view to clip for width / height: reversed depth in [0, 1], infinite far, y downwards."""
        f = 1.0 / np.tan(np.radians(self.fov_y) / 2.0)
        rows = [[f / aspect, 0, 0, 0], [0, -f, 0, 0], [0, 0, 0, NEAR], [0, 0, -1, 0]]
        return np.array(rows, np.float64)


def look_at(position: Vector | Values, target: Vector, up: Vector) -> Matrix:
    """Return world to view of an eye at `position`: x right, y up, looking at -z."""
    back = np.subtract(position, target) / np.linalg.norm(np.subtract(position, target))
    right = np.cross(up, back)
    right /= np.linalg.norm(right)
    matrix = np.eye(4)
    matrix[:3, :3] = right, np.cross(back, right), back
    matrix[:3, 3] = -matrix[:3, :3] @ position
    return matrix


CONVOLVED = 64  # maximum width of mips that are GGX convolutions; the lobes of larger ones are a texel wide


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, weakref_slot=True)
class Environment:
    """A distant panorama.

    Attributes:
        pixels: (h, 2 h, 3) float32 linear RGB radiance, >= 0; h is a power of two, at least 32. Row 0 is up
            (+y), the middle column is -z, and columns run to the right.
    """

    pixels: Points

    def __post_init__(self) -> None:
        height, width = self.pixels.shape[:2]
        if width != 2 * height or height < 32 or height & (height - 1):
            want = "(h, 2 h, 3), h a power of two from 32 on"
            raise SceneError("environment.pixels", got=self.pixels.shape, want=want)

    def mips(self) -> list[Points]:
        """Return mip levels of the panorama, down to 4 x 2, prefiltered for increasing roughness.

        Level l is filtered for alpha = pi 2^l / h, so that a lobe is about two texels wide.
        """
        levels = [self.pixels]
        while levels[-1].shape[0] > 2:
            levels.append(downsampled(levels[-1]))
        source = next(level for level in levels if level.shape[1] <= 2 * CONVOLVED)
        for index, level in enumerate(levels):
            if level.shape[1] <= CONVOLVED and level is not source:
                alpha = min(1.0, np.pi / level.shape[0])
                levels[index] = reflected(source, level.shape[0], alpha)
        return levels

    def irradiance(self) -> Values:
        """Return coefficients (9, 3): the irradiance of a normal n is sum_i coefficients[i] basis_i(n).

        The basis is 1, x, y, z, xy, yz, 3 z^2 - 1, xz, x^2 - y^2; the coefficients include all constants.
        """
        weights, basis = solid_angles(self.pixels.shape[0]), harmonics(directions(self.pixels.shape[0]))
        norm = np.array([0.282095] + [0.488603] * 3 + [1.092548] * 2 + [0.315392, 1.092548, 0.546274])
        lobe = np.array([np.pi] + [2.0 * np.pi / 3.0] * 3 + [np.pi / 4.0] * 5)  # of the clamped cosine
        radiance = (self.pixels.astype(np.float64) * weights[..., None]).reshape(-1, 3)
        return np.asarray((norm * norm * lobe)[:, None] * (basis.reshape(-1, 9).T @ radiance))


def directions(height: int) -> Values:
    """Return the unit vectors (h, 2 h, 3) of a panorama's texel centres."""
    theta = (np.arange(height) + 0.5) * np.pi / height
    phi = (np.arange(2 * height) + 0.5) * np.pi / height - np.pi
    sin = np.sin(theta)[:, None]
    y = np.broadcast_to(np.cos(theta)[:, None], (height, 2 * height))
    return np.stack([sin * np.sin(phi), y, -sin * np.cos(phi)], axis=-1)


def solid_angles(height: int) -> Values:
    """Return the solid angle of each texel: (h, 2 h) steradians that sum to 4 pi."""
    edges = np.cos(np.arange(height + 1) * np.pi / height)
    return np.repeat((edges[:-1] - edges[1:])[:, None] * np.pi / height, 2 * height, axis=1)


def harmonics(normals: Values) -> Values:
    """Return the nine functions of `Environment.irradiance` (..., 9) of unit vectors (..., 3)."""
    x, y, z = np.moveaxis(normals, -1, 0)
    columns = [np.ones_like(x), x, y, z, x * y, y * z, 3.0 * z * z - 1.0, x * z, x * x - y * y]
    return np.stack(columns, axis=-1)


def downsampled(pixels: Points) -> Points:
    """Average 2 x 2 texels, by their solid angle."""
    height, width = pixels.shape[:2]
    weighted = pixels * solid_angles(height)[..., None]
    sums = weighted.reshape(height // 2, 2, width // 2, 2, 3).sum(axis=(1, 3))
    return np.asarray(sums / solid_angles(height // 2)[..., None], np.float32)


def reflected(source: Points, height: int, alpha: float) -> Points:
    """Convolve a panorama with the GGX lobe of roughness alpha at normal incidence: (height, 2 height, 3).

    Weights depend on both rows and on the distance between the columns. Each pair of rows is therefore a
    circular correlation with the weights of the first column, computed in the frequency domain.
    """
    rows = source.shape[0]
    first = directions(height)[:, 0]  # (height, 3); a column spans `rows / height` columns of the source
    cosine = np.einsum("ai,bci->abc", first, directions(rows))  # between the normal and the light
    half = np.clip(0.5 + 0.5 * cosine, 0.0, 1.0)  # squared cosine of half that angle
    weights = np.maximum(cosine, 0.0) / (half * (alpha * alpha - 1.0) + 1.0) ** 2
    weights *= solid_angles(rows)
    weights /= weights.sum(axis=(1, 2), keepdims=True)
    lobes, light = np.fft.rfft(weights, axis=2), np.fft.rfft(source.astype(np.float64), axis=1)
    spectrum = np.einsum("abf,bfc->afc", np.conj(lobes), light)
    return np.fft.irfft(spectrum, 2 * rows, axis=1)[:, :: rows // height].astype(np.float32)


MAX_POINTS = 16


@dataclass(frozen=True, slots=True, kw_only=True)
class Sun:
    """Parallel light with shadows inside a sphere, which the shadow map covers."""

    direction: Vector  # from the light to the scene, of any length
    color: Color  # irradiance on a surface that faces the light
    center: Vector = (0.0, 0.0, 0.0)  # of the sphere
    radius: float = 20.0  # metres

    def matrix(self) -> Matrix:
        """Return world to the shadow map's clip space: x, y in [-1, 1], depth in [0, 1], 0 at the light."""
        to_light = -np.array(self.direction) / np.linalg.norm(self.direction)
        eye = np.array(self.center) + to_light * self.radius
        scale = np.diag([1.0 / self.radius, 1.0 / self.radius, -0.5 / self.radius, 1.0])
        return scale @ look_at(eye, self.center, _up_for(to_light))


@dataclass(frozen=True, slots=True, kw_only=True)
class Spot:
    """A cone of light with shadows, which fades between two half angles."""

    position: Vector
    target: Vector
    color: Color  # radiant intensity on the axis: irradiance at 1 m
    inner: float = 15.0  # half angle, degrees
    outer: float = 25.0
    reach: float = 20.0  # distance at which the light has faded to 0, metres, > 0.1

    def matrix(self) -> Matrix:
        """Return world to the shadow map's clip space: depth in [0, 1], 0 at 0.1 m from the light."""
        axis = np.subtract(self.target, self.position)
        f, near, far = 1.0 / np.tan(np.radians(self.outer)), 0.1, self.reach
        project = np.zeros((4, 4))
        project[0, 0] = project[1, 1] = f
        project[2, 2:], project[3, 2] = (far / (near - far), near * far / (near - far)), -1.0
        return project @ look_at(self.position, self.target, _up_for(axis / np.linalg.norm(axis)))


@dataclass(frozen=True, slots=True, kw_only=True)
class PointLight:
    """Light in all directions, without shadows."""

    position: Vector
    color: Color  # radiant intensity: irradiance at 1 m
    reach: float = 10.0  # distance at which the light has faded to 0, metres


def _up_for(direction: Matrix) -> Vector:
    return (0.0, 0.0, 1.0) if abs(direction[1]) > 0.99 else (0.0, 1.0, 0.0)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Skin:
    """The joints that move each vertex."""

    joints: Joints  # (n, 4), indices into the instance's palette
    weights: Points  # (n, 4), sums of 1


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, weakref_slot=True)
class Mesh:
    """Triangles; counter-clockwise ones face the viewer.

    A tangent is the direction of u, of unit length, and the sign w of the bitangent cross(normal, tangent) w,
    which points to decreasing v. `tangents_of` derives tangents.
    """

    positions: Points  # (n, 3), local
    normals: Points  # (n, 3), unit length
    uv: Points  # (n, 2), v downwards in the texture
    tangents: Points  # (n, 4)
    indices: Indices  # (m, 3)
    skin: Skin | None = None  # None for a rigid mesh

    def __post_init__(self) -> None:
        for name in ("positions", "normals", "uv", "tangents"):
            _check_finite(f"mesh.{name}", getattr(self, name))

    def center(self) -> Points:
        """Return the middle of the bounding box (3,), local."""
        return np.asarray((self.positions.min(axis=0) + self.positions.max(axis=0)) / 2.0)


def tangents_of(positions: Points, normals: Points, uv: Points, indices: Indices) -> Points:
    """Return (n, 4) tangents: the direction of u, averaged over each vertex's triangles, and its handedness.

    Where u does not vary, they have an arbitrary direction along the surface.
    """
    a, b, c = indices.T
    edge, other = positions[b] - positions[a], positions[c] - positions[a]
    along, beside = uv[b] - uv[a], uv[c] - uv[a]
    area = along[:, :1] * beside[:, 1:] - along[:, 1:] * beside[:, :1]
    flip = np.where(area < 0.0, -1.0, 1.0)  # weighted by area in the texture; no division, as it may be 0
    of_u = flip * (edge * beside[:, 1:] - other * along[:, 1:])
    of_v = flip * (other * along[:, :1] - edge * beside[:, :1])
    u, v = np.zeros((2, *positions.shape), np.float64)
    for corner in (a, b, c):
        np.add.at(u, corner, of_u)
        np.add.at(v, corner, of_v)
    axis = np.eye(3)[np.abs(normals).argmin(axis=1)]  # far from the normal, used where u is degenerate
    u = np.where(np.linalg.norm(u, axis=1, keepdims=True) > 1e-12, u, np.cross(normals, axis))
    u -= normals * (u * normals).sum(axis=1, keepdims=True)
    u /= np.maximum(np.linalg.norm(u, axis=1, keepdims=True), 1e-12)
    # v grows downwards in the image, while green in a normal map points up: the bitangent opposes v.
    sign = np.where((np.cross(normals, u) * v).sum(axis=1, keepdims=True) > 0.0, -1.0, 1.0)
    return np.concatenate([u, sign], axis=1).astype(np.float32)


MAX_JOINTS = 128  # two palettes of this size fill the 16 KiB that every GL grants a uniform block


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, weakref_slot=True)
class Texture:
    """An image that repeats in both directions."""

    pixels: Pixels  # (h, w, 3 or 4), row 0 at v = 0, as in glTF; a fourth channel is opacity
    srgb: bool = True  # for colours, which are sRGB-encoded; False for normal and ORM maps


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, weakref_slot=True)
class Material:
    """A surface as glTF and Unreal describe it: GGX on Lambert. Textures multiply the constants."""

    base_color: Color = (1.0, 1.0, 1.0)  # linear RGB in [0, 1]
    roughness: float = 0.5  # perceptual, in [0, 1]; alpha = roughness^2
    metallic: float = 0.0  # in [0, 1]
    specular: float = 0.5  # in [0, 1]; dielectric F0 = 0.08 specular
    emissive: Color = (0.0, 0.0, 0.0)  # linear RGB radiance, >= 0
    base_color_texture: Texture | None = None  # sRGB; opacity is tested against `alpha_cutoff`
    normal_texture: Texture | None = None  # tangent-space normals, linear, green up (as in glTF)
    orm_texture: Texture | None = None  # occlusion, roughness, metallic, linear
    emissive_texture: Texture | None = None  # sRGB
    alpha_cutoff: float | None = None  # samples less opaque than this are holes; None: no holes
    double_sided: bool = False  # whether back faces are drawn, too, lit from their own side

    def __post_init__(self) -> None:
        for channel in self.base_color:
            check_number("material.base_color", channel, 0.0, 1.0)
        for channel in self.emissive:
            check_number("material.emissive", channel, 0.0, np.inf)
        for name in ("roughness", "metallic", "specular"):
            check_number(f"material.{name}", getattr(self, name), 0.0, 1.0)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Instance:
    """A placed mesh, in this frame and in the previous one.

    The palette of a skinned mesh, (joints, 4, 4), has at most MAX_JOINTS matrices from the bind pose to the
    pose, applied before `model`.
    """

    mesh: Mesh
    material: Material
    model: Matrix  # local to world
    model_before: Matrix | None = None  # in the previous frame; None: no motion
    palette: Matrices | None = None  # None for a rigid mesh
    palette_before: Matrices | None = None  # in the previous frame; None: no motion
    emission: float = 1.0  # factor of the material's emissive colour
    casts_shadow: bool = True
    thin: bool = False  # whether it counts as a thin object, see `PixelTruth`

    def __post_init__(self) -> None:
        for name in ("model", "palette"):
            if getattr(self, f"{name}_before") is None:
                object.__setattr__(self, f"{name}_before", getattr(self, name))
        for name in ("model", "model_before", "palette", "palette_before"):
            if (matrices := getattr(self, name)) is not None:
                _check_finite(f"instance.{name}", matrices)
        joints = 0 if self.palette is None else len(self.palette)
        needed = 0 if self.mesh.skin is None else int(self.mesh.skin.joints.max()) + 1
        largest = 0 if self.mesh.skin is None else MAX_JOINTS
        if not needed <= joints <= largest:
            want = f"{needed} to {largest}, as the skin of the mesh refers to them"
            raise SceneError("instance.palette", got=f"{joints} joints", want=want)

    def moves(self) -> bool:
        """Return whether the instance has moved or bent since the previous frame."""
        pairs = (self.model, self.model_before), (self.palette, self.palette_before)
        return not all(np.array_equal(np.asarray(now), np.asarray(before)) for now, before in pairs)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Particles:
    """Soft round sprites that face the camera.

    As in engines, they are rendered after all opaque surfaces, depth-tested, and write only colour.
    """

    centers: Points  # (n, 3), world
    radii: Points  # (n,) metres, > 0
    colors: Points  # (n, 4) linear RGB radiance times opacity, and opacity in [0, 1]; 0 adds light


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Scene:
    """The scene of one frame."""

    camera: Camera
    camera_before: Camera  # of the previous frame; after a cut, `camera` itself
    environment: Environment
    instances: tuple[Instance, ...]
    sun: Sun | None = None
    spot: Spot | None = None
    points: tuple[PointLight, ...] = ()  # at most MAX_POINTS
    particles: tuple[Particles, ...] = ()

    def __post_init__(self) -> None:
        if len(self.points) > MAX_POINTS:
            hint = "Drop those with the shortest reach, per frame if necessary."
            want = f"at most {MAX_POINTS}"
            raise SceneError("scene.points", got=f"{len(self.points)} lights", want=want, hint=hint)


def _check_finite(name: str, values: Points | Values) -> None:
    if not np.isfinite(values).all():
        raise SceneError(name, got="NaN or infinite in places", want="finite numbers")
