"""The scene of one frame, with its state in the previous frame, from which motion vectors are computed.

Plain arrays, no file, no GL. Space is right-handed with y up, in metres. Matrices are (4, 4), row-major,
acting on column vectors: world = model @ local. Colours are linear RGB; lights and the environment are in the
same radiometric unit, so that a white wall facing a sun of colour pi looks as bright as an environment of 1.

Meshes, materials, textures and environments are uploaded once and recognised again by identity: share them
between the frames of a sequence.
"""

from dataclasses import dataclass

import numpy as np

from supersampler_model.data.checks import check, check_array, check_matrices, check_number
from supersampler_model.data.errors import SceneError
from supersampler_model.data.scenes.camera import Camera
from supersampler_model.data.scenes.environment import Environment
from supersampler_model.data.scenes.lights import MAX_POINTS, Point, Spot, Sun
from supersampler_model.data.scenes.mesh import Mesh
from supersampler_model.data.values import Color, Matrices, Matrix, Pixels, Points

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
        for name in ("base_color", "emissive"):
            most = 1.0 if name == "base_color" else np.inf
            for value in check(f"material.{name}", getattr(self, name), 3):
                check_number(f"material.{name}", value, 0.0, most)
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
    """

    mesh: Mesh
    material: Material
    model: Matrix
    model_before: Matrix | None = None
    palette: Matrices | None = None
    palette_before: Matrices | None = None
    emission: float = 1.0
    casts_shadow: bool = True

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
        camera_before: where the camera was one frame ago; on the first frame after a cut, `camera` itself.
        points: at most `MAX_POINTS`, without shadows. `sun` and `spot` cast them.
    """

    camera: Camera
    camera_before: Camera
    environment: Environment
    instances: tuple[Instance, ...]
    sun: Sun | None = None
    spot: Spot | None = None
    points: tuple[Point, ...] = ()
    particles: tuple[Particles, ...] = ()

    def __post_init__(self) -> None:
        if len(self.points) > MAX_POINTS:
            hint = "Drop those that reach the least, per frame if need be."
            raise SceneError(
                "scene.points", got=f"{len(self.points)} lights", want=f"at most {MAX_POINTS}", hint=hint
            )
        if self.camera.near != self.camera_before.near:
            hint = "Depth is near / distance and is compared between frames."
            raise SceneError(
                "scene.camera_before.near", got=self.camera_before.near, want=self.camera.near, hint=hint
            )
