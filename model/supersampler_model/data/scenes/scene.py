"""The scene of one frame, with its state in the previous frame, from which motion vectors are computed.

Plain arrays, no file, no GL. Space is right-handed with y up, in metres. Matrices are (4, 4), row-major,
acting on column vectors: world = model @ local. Colours are linear RGB; lights and the environment are in the
same radiometric unit, so that a white wall facing a sun of colour pi looks as bright as an environment of 1.

Meshes, materials, textures and environments are uploaded once and recognised again by identity: share them
between the frames of a sequence.
"""

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from supersampler_model.data.errors import (
    SceneError,
    check_array,
    check_color,
    check_matrices,
    check_number,
    check_vector,
)

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


@dataclass(frozen=True, slots=True, kw_only=True)
class Camera:
    """A pinhole camera.

    Attributes:
        fov_y: vertical field of view, degrees.
        near: metres; depth is near / view distance.
        exposure: factor of the frame's colour before the tone curve; the colour is stored without it.
    """

    position: Vector
    target: Vector
    up: Vector = (0.0, 1.0, 0.0)
    fov_y: float = 60.0
    near: float = 0.1
    exposure: float = 1.0

    def __post_init__(self) -> None:
        for name in ("position", "target", "up"):
            check_vector(f"camera.{name}", getattr(self, name), 3)
        for name, maximum in (("fov_y", 175.0), ("near", np.inf), ("exposure", np.inf)):
            check_number(f"camera.{name}", getattr(self, name), 0.0, maximum, open_below=True)
        if not np.linalg.norm(np.cross(np.subtract(self.target, self.position), self.up)) > 0.0:
            got = f"{self.target} from {self.position}, up {self.up}"
            raise SceneError("camera.target", got=got, want="a direction other than up, at some distance")

    def view(self) -> Matrix:
        """Return world to view: x right, y up, looking at -z."""
        return look_at(self.position, self.target, self.up)

    def projection(self, aspect: float) -> Matrix:
        """Return view to clip: reversed depth in [0, 1], infinite far, y downwards so that row 0 is on top.

        Args:
            aspect: width / height of the image.
        """
        f = 1.0 / np.tan(np.radians(self.fov_y) / 2.0)
        return np.array(
            [[f / aspect, 0, 0, 0], [0, -f, 0, 0], [0, 0, 0, self.near], [0, 0, -1, 0]], np.float64
        )


def look_at(position: Vector, target: Vector, up: Vector) -> Matrix:
    """Return world to view of an eye at `position`: x right, y up, looking at -z."""
    back = np.subtract(position, target) / np.linalg.norm(np.subtract(position, target))
    right = np.cross(up, back)
    right /= np.linalg.norm(right)
    matrix = np.eye(4)
    matrix[:3, :3] = right, np.cross(back, right), back
    matrix[:3, 3] = -matrix[:3, :3] @ position
    return matrix


CONVOLVED = 64  # width from which on mips are true GGX convolutions; above, their lobes are a texel wide


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, weakref_slot=True)
class Environment:
    """A distant panorama.

    Attributes:
        pixels: (h, 2 h, 3) float32 linear RGB radiance, >= 0; h a power of two, 32 or more. Row 0 looks up
            (+y), the middle column looks at -z, columns go right.
    """

    pixels: Points

    def __post_init__(self) -> None:
        check_array("environment.pixels", self.pixels, (None, None, 3), np.float32)
        height, width = self.pixels.shape[:2]
        if width != 2 * height or height < 32 or height & (height - 1):
            want = "(h, 2 h, 3), h a power of two from 32 on"
            raise SceneError("environment.pixels", got=self.pixels.shape, want=want)
        if self.pixels.min() < 0.0:
            raise SceneError("environment.pixels", got="negative in places", want="radiance >= 0")

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
        """Return (9, 3) coefficients: irradiance of a normal n is sum_i coefficients[i] basis_i(n).

        The basis is 1, x, y, z, xy, yz, 3 z^2 - 1, xz, x^2 - y^2, with all constants in the coefficients.
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

    Weights depend on the two rows and on how far apart the columns are, so each pair of rows is one circular
    correlation: those of the first column's normals, moved along the row in the frequency domain.
    """
    rows = source.shape[0]
    first = directions(height)[:, 0]  # (height, 3); its column is `rows / height` of the source's wide
    cosine = np.einsum(
        "ai,bci->abc", first, directions(rows)
    )  # of the normal, taken as the reflection, and light
    half = np.clip(0.5 + 0.5 * cosine, 0.0, 1.0)  # squared cosine of half that angle
    weights = np.maximum(cosine, 0.0) / (half * (alpha * alpha - 1.0) + 1.0) ** 2
    weights *= solid_angles(rows)
    weights /= weights.sum(axis=(1, 2), keepdims=True)
    spectrum = np.einsum(
        "abf,bfc->afc", np.conj(np.fft.rfft(weights, axis=2)), np.fft.rfft(source.astype(np.float64), axis=1)
    )
    return np.fft.irfft(spectrum, 2 * rows, axis=1)[:, :: rows // height].astype(np.float32)


MAX_POINTS = 16


@dataclass(frozen=True, slots=True, kw_only=True)
class Sun:
    """Parallel light with a shadow inside a sphere.

    Attributes:
        direction: direction from the light to the scene; its length does not matter.
        color: irradiance on a surface that faces it.
        center, radius: sphere that the shadow map covers, metres; there is no shadow outside.
    """

    direction: Vector
    color: Color
    center: Vector = (0.0, 0.0, 0.0)
    radius: float = 20.0

    def __post_init__(self) -> None:
        _check_direction("sun.direction", self.direction)
        check_vector("sun.center", self.center, 3)
        check_color("sun.color", self.color)
        check_number("sun.radius", self.radius, 0.0, np.inf, open_below=True)

    def matrix(self) -> Matrix:
        """Return world to the shadow map's clip space: x, y in [-1, 1], depth in [0, 1], 0 at the light."""
        to_light = -np.array(self.direction) / np.linalg.norm(self.direction)
        eye = np.array(self.center) + to_light * self.radius
        scale = np.diag([1.0 / self.radius, 1.0 / self.radius, -0.5 / self.radius, 1.0])
        return scale @ look_at(_vector(eye), self.center, _up_for(to_light))


@dataclass(frozen=True, slots=True, kw_only=True)
class Spot:
    """A cone of light with a shadow.

    Attributes:
        color: radiant intensity on the axis: irradiance at 1 m.
        inner, outer: half angles, degrees, between which it fades.
        reach: distance at which it has faded to 0, metres, > 0.1.
    """

    position: Vector
    target: Vector
    color: Color
    inner: float = 15.0
    outer: float = 25.0
    reach: float = 20.0

    def __post_init__(self) -> None:
        check_vector("spot.position", self.position, 3)
        check_vector("spot.target", self.target, 3)
        _check_direction("spot.target - position", _vector(np.subtract(self.target, self.position)))
        check_color("spot.color", self.color)
        check_number("spot.outer", self.outer, 0.0, 80.0, open_below=True)
        check_number("spot.inner", self.inner, 0.0, self.outer)
        check_number("spot.reach", self.reach, 0.1, np.inf, open_below=True)

    def matrix(self) -> Matrix:
        """Return world to the shadow map's clip space: depth in [0, 1], 0 is 0.1 m from the light."""
        axis = np.subtract(self.target, self.position)
        f, near, far = 1.0 / np.tan(np.radians(self.outer)), 0.1, self.reach
        project = np.zeros((4, 4))
        project[0, 0] = project[1, 1] = f
        project[2, 2:], project[3, 2] = (far / (near - far), near * far / (near - far)), -1.0
        return project @ look_at(self.position, self.target, _up_for(axis / np.linalg.norm(axis)))


@dataclass(frozen=True, slots=True, kw_only=True)
class PointLight:
    """Light into all directions, without a shadow.

    Attributes:
        color: radiant intensity: irradiance at 1 m.
        reach: distance at which it has faded to 0, metres.
    """

    position: Vector
    color: Color
    reach: float = 10.0

    def __post_init__(self) -> None:
        check_vector("point.position", self.position, 3)
        check_color("point.color", self.color)
        check_number("point.reach", self.reach, 0.0, np.inf, open_below=True)


def _vector(values: Matrix) -> Vector:
    x, y, z = (float(value) for value in values)
    return x, y, z


def _up_for(direction: Matrix) -> Vector:
    return (0.0, 0.0, 1.0) if abs(direction[1]) > 0.99 else (0.0, 1.0, 0.0)


def _check_direction(name: str, direction: Vector) -> None:
    if not np.linalg.norm(check_vector(name, direction, 3)) > 0.0:
        raise SceneError(name, got=direction, want="a direction")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Skin:
    """The joints that move each vertex.

    Attributes:
        joints: (n, 4) uint16, indices into the instance's palette.
        weights: (n, 4) float32 that sum to 1.
    """

    joints: Joints
    weights: Points

    def __post_init__(self) -> None:
        check_array("skin.joints", self.joints, (None, 4), np.uint16)
        check_array("skin.weights", self.weights, (len(self.joints), 4), np.float32)
        if np.abs(self.weights.sum(axis=1) - 1.0).max() > 1e-3:
            raise SceneError("skin.weights", got="another sum at some vertices", want="a sum of 1")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, weakref_slot=True)
class Mesh:
    """Triangles; counter-clockwise ones face the viewer.

    Attributes:
        positions: (n, 3) float32, local.
        normals: (n, 3) float32, unit length.
        uv: (n, 2) float32, v downwards in the texture.
        tangents: (n, 4) float32: direction of u, unit length, and the sign of the bitangent
            cross(normal, tangent) w, which points to decreasing v. `tangents_of` derives them.
        indices: (m, 3) uint32.
        skin: None for a rigid mesh.
    """

    positions: Points
    normals: Points
    uv: Points
    tangents: Points
    indices: Indices
    skin: Skin | None = None

    def __post_init__(self) -> None:
        count = len(self.positions)
        check_array("mesh.positions", self.positions, (None, 3), np.float32)
        check_array("mesh.normals", self.normals, (count, 3), np.float32)
        check_array("mesh.uv", self.uv, (count, 2), np.float32)
        check_array("mesh.tangents", self.tangents, (count, 4), np.float32)
        check_array("mesh.indices", self.indices, (None, 3), np.uint32)
        if int(self.indices.max()) >= count:
            raise SceneError("mesh.indices", got=int(self.indices.max()), want=f"vertices below {count}")
        if self.skin is not None and len(self.skin.joints) != count:
            raise SceneError("mesh.skin", got=f"{len(self.skin.joints)} vertices", want=f"{count}")

    def center(self) -> Points:
        """Return the middle of the bounding box (3,), local."""
        return np.asarray((self.positions.min(axis=0) + self.positions.max(axis=0)) / 2.0)


def tangents_of(positions: Points, normals: Points, uv: Points, indices: Indices) -> Points:
    """Return (n, 4) tangents: the direction of u averaged over each vertex's triangles, and handedness.

    Where u does not vary, any direction along the surface is taken.
    """
    a, b, c = indices.T
    edge, other = positions[b] - positions[a], positions[c] - positions[a]
    along, beside = uv[b] - uv[a], uv[c] - uv[a]
    area = along[:, :1] * beside[:, 1:] - along[:, 1:] * beside[:, :1]
    flip = np.where(area < 0.0, -1.0, 1.0)  # weighted by area in the texture, which may be 0: no division
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
    # v grows downwards in the image while a normal map's green points up it: the bitangent opposes v.
    sign = np.where((np.cross(normals, u) * v).sum(axis=1, keepdims=True) > 0.0, -1.0, 1.0)
    return np.concatenate([u, sign], axis=1).astype(np.float32)


MAX_JOINTS = 128  # two palettes of this size fill the 16 KiB that every GL grants a uniform block


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, weakref_slot=True)
class Texture:
    """An image that repeats in both directions.

    Attributes:
        pixels: (h, w, 3 or 4) uint8. Row 0 is at v = 0, as in glTF. A fourth channel is opacity.
        srgb: True for colours, which are stored sRGB-encoded; False for normal and ORM maps.
    """

    pixels: Pixels
    srgb: bool = True

    def __post_init__(self) -> None:
        check_array("texture.pixels", self.pixels, (None, None, (3, 4)), np.uint8)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, weakref_slot=True)
class Material:
    """A surface as glTF and Unreal describe it: GGX on Lambert. Textures multiply the constants.

    Attributes:
        base_color: linear RGB in [0, 1].
        roughness: perceptual, in [0, 1]; alpha = roughness^2.
        metallic: in [0, 1].
        specular: in [0, 1]; dielectric F0 = 0.08 specular.
        emissive: linear RGB radiance, >= 0.
        base_color_texture: sRGB; its opacity is tested against `alpha_cutoff`.
        normal_texture: tangent-space normals, linear, green up (as in glTF).
        orm_texture: occlusion, roughness, metallic, linear.
        emissive_texture: sRGB.
        alpha_cutoff: samples less opaque than this are holes; None draws all.
        double_sided: draw back faces too, lit from their own side.
    """

    base_color: Color = (1.0, 1.0, 1.0)
    roughness: float = 0.5
    metallic: float = 0.0
    specular: float = 0.5
    emissive: Color = (0.0, 0.0, 0.0)
    base_color_texture: Texture | None = None
    normal_texture: Texture | None = None
    orm_texture: Texture | None = None
    emissive_texture: Texture | None = None
    alpha_cutoff: float | None = None
    double_sided: bool = False

    def __post_init__(self) -> None:
        check_color("material.base_color", self.base_color, 1.0)
        check_color("material.emissive", self.emissive)
        for name in ("roughness", "metallic", "specular"):
            check_number(f"material.{name}", getattr(self, name), 0.0, 1.0)
        self._check_textures()

    def _check_textures(self) -> None:
        for name, srgb in (("base_color", True), ("normal", False), ("orm", False), ("emissive", True)):
            texture = getattr(self, f"{name}_texture")
            if texture is None:
                continue
            if not isinstance(texture, Texture):
                raise SceneError(f"material.{name}_texture", got=type(texture).__name__, want="a Texture")
            if texture.srgb != srgb:
                raise SceneError(f"material.{name}_texture.srgb", got=texture.srgb, want=srgb)
        if self.alpha_cutoff is not None:
            check_number("material.alpha_cutoff", self.alpha_cutoff, 0.0, 1.0)
            if self.base_color_texture is None or self.base_color_texture.pixels.shape[2] != 4:
                hint = "The opacity that alpha_cutoff tests is its fourth channel."
                got = "missing" if self.base_color_texture is None else "without opacity"
                raise SceneError("material.base_color_texture", got=got, want="an RGBA texture", hint=hint)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Instance:
    """A mesh somewhere, now and one frame ago.

    Attributes:
        model: (4, 4) local to world, now.
        model_before: the same one frame ago; None: no motion.
        palette: (joints, 4, 4) of a skinned mesh: bind pose to posed, now; it is applied before `model`.
        palette_before: the same one frame ago; None: no motion.
        emission: multiplies the material's emissive colour; flickering lights vary it.
        casts_shadow: False keeps it out of the shadow maps.
        thin: whether it counts as a thin object, see `PixelTruth`.
    """

    mesh: Mesh
    material: Material
    model: Matrix
    model_before: Matrix | None = None
    palette: Matrices | None = None
    palette_before: Matrices | None = None
    emission: float = 1.0
    casts_shadow: bool = True
    thin: bool = False

    def __post_init__(self) -> None:
        for name in ("model", "palette"):
            if getattr(self, f"{name}_before") is None:
                object.__setattr__(self, f"{name}_before", getattr(self, name))
        for name in ("model", "model_before"):
            check_matrices(f"instance.{name}", getattr(self, name), (4, 4))
        check_number("instance.emission", self.emission, 0.0, np.inf)
        self._check_palettes()

    def _check_palettes(self) -> None:
        skin = self.mesh.skin
        if (skin is None) != (self.palette is None):
            got, want = ("given", "None") if skin is None else ("None", "a pose, since the mesh has a skin")
            raise SceneError("instance.palette", got=got, want=want)
        if skin is None or self.palette is None:
            return
        joints = len(self.palette)
        if not int(skin.joints.max()) < joints <= MAX_JOINTS:
            want = f"{int(skin.joints.max()) + 1} to {MAX_JOINTS}, as the skin refers to them"
            raise SceneError("instance.palette", got=f"{joints} joints", want=want)
        check_matrices("instance.palette", self.palette, (joints, 4, 4))
        check_matrices("instance.palette_before", self.palette_before, (joints, 4, 4))

    def moves(self) -> bool:
        """Return whether it has moved or bent since the previous frame, whatever the camera did."""
        pairs = (self.model, self.model_before), (self.palette, self.palette_before)
        return not all(np.array_equal(np.asarray(now), np.asarray(before)) for now, before in pairs)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Particles:
    """Soft round sprites that face the camera.

    As in engines, they are rendered after all opaque surfaces, depth-tested, and write only colour.

    Attributes:
        centers: (n, 3) world.
        radii: (n,) metres, > 0.
        colors: (n, 4) linear RGB radiance multiplied by opacity, and opacity in [0, 1]; opacity 0 adds light.
    """

    centers: Points
    radii: Points
    colors: Points

    def __post_init__(self) -> None:
        count = len(self.centers)
        check_array("particles.centers", self.centers, (count, 3), np.float32)
        check_array("particles.radii", self.radii, (count,), np.float32)
        check_array("particles.colors", self.colors, (count, 4), np.float32)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Scene:
    """The scene of one frame.

    Attributes:
        camera_before: camera of the previous frame; on the first frame after a cut, `camera` itself.
        points: at most `MAX_POINTS`, without shadows. `sun` and `spot` cast them.
    """

    camera: Camera
    camera_before: Camera
    environment: Environment
    instances: tuple[Instance, ...]
    sun: Sun | None = None
    spot: Spot | None = None
    points: tuple[PointLight, ...] = ()
    particles: tuple[Particles, ...] = ()

    def __post_init__(self) -> None:
        if len(self.points) > MAX_POINTS:
            hint = "Drop those with the shortest reach, per frame if necessary."
            raise SceneError(
                "scene.points", got=f"{len(self.points)} lights", want=f"at most {MAX_POINTS}", hint=hint
            )
        if self.camera.near != self.camera_before.near:
            hint = "Depth is near / distance and is compared between frames."
            raise SceneError(
                "scene.camera_before.near", got=self.camera_before.near, want=self.camera.near, hint=hint
            )
