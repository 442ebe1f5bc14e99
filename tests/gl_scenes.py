"""Tiny scenes for the renderer's tests: shapes, textures, and what moves as functions of a frame's index."""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from supersampler_model.data.scenes.procedural import shapes
from supersampler_model.data.scenes.procedural.paths import turned_by
from supersampler_model.data.scenes.scene import (
    Camera,
    Environment,
    Instance,
    Material,
    Mesh,
    Particles,
    PointLight,
    Scene,
    Skin,
    Spot,
    Sun,
    Texture,
    directions,
)

Values = NDArray[np.float64]


# --- shapes ---


def plane(repeat: float) -> Mesh:
    """2 x 2, facing +y; u along x, v along z; the texture repeats so many times."""
    return shapes.plane(2.0, 2.0, 0.5 * repeat)


def box() -> Mesh:
    """2 x 2 x 2, about the origin."""
    return shapes.merged([(shapes.box(2.0, 2.0, 2.0, 0.5), moved(0.0, -1.0, 0.0))])


def bending_tube() -> Mesh:
    """Radius 0.25, height 2 from 0 up, bound to two joints, the upper one ever more from half way up."""
    heights = np.linspace(0.0, 2.0, 17)
    mesh = shapes.lathe([(0.25, float(height)) for height in heights], 32, smooth=True)
    upper = np.clip(mesh.positions[:, 1] - 0.5, 0.0, 1.0)
    weights = np.stack([1 - upper, upper, 0 * upper, 0 * upper], axis=1)
    joints = np.tile(np.array([0, 1, 0, 0], np.uint16), (len(upper), 1))
    return replace(mesh, skin=Skin(joints=joints, weights=weights))


# --- matrices ---


def moved(x: float, y: float, z: float, size: float | tuple[float, float, float] = 1.0) -> Values:
    matrix = np.diag([*np.broadcast_to(size, 3), 1.0])
    matrix[:3, 3] = x, y, z
    return matrix


# --- textures ---


def smooth_noise(seed: int, size: int = 64, blur: float = 0.06) -> Values:
    """(size, size) in [0, 1], repeating, without frequencies above about `blur` size."""
    waves = np.fft.fft2(np.random.default_rng(seed).standard_normal((size, size)))
    y, x = np.meshgrid(np.fft.fftfreq(size), np.fft.fftfreq(size), indexing="ij")
    image = np.fft.ifft2(waves * np.exp(-(x * x + y * y) / (2.0 * blur**2))).real
    return np.asarray((image - image.min()) / np.ptp(image))


def tinted(values: Values, dark: tuple[int, int, int], bright: tuple[int, int, int]) -> Texture:
    pixels = np.array(dark) + values[..., None] * (np.array(bright) - dark)
    return Texture(pixels=pixels.round().astype(np.uint8))


def bumps(seed: int, strength: float) -> Texture:
    height = smooth_noise(seed) * strength * 64
    slope_x, slope_y = (np.roll(height, 1, axis) - np.roll(height, -1, axis) for axis in (1, 0))
    normals = np.stack([slope_x / 2, -slope_y / 2, np.ones_like(height)], axis=-1)  # green points up
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    return Texture(pixels=(127.5 * normals + 127.5).round().astype(np.uint8), srgb=False)


def fence_texture() -> Texture:
    y, x = np.mgrid[:64, :64] / 64.0
    wire = np.minimum(np.abs((x + y) % 1.0 - 0.5), np.abs((x - y) % 1.0 - 0.5))
    opacity = np.clip(0.5 + (0.09 - wire) * 16.0, 0.0, 1.0)
    pixels = np.concatenate([np.full((64, 64, 3), 190.0), 255.0 * opacity[..., None]], axis=-1)
    return Texture(pixels=pixels.round().astype(np.uint8))


def sky(seed: int = 0) -> Environment:
    """Blue above, brown below, some bright clouds."""
    up = directions(64)[..., 1]
    clouds = 2.0 * np.clip(np.tile(smooth_noise(seed), (1, 2)) - 0.6, 0.0, 1.0)
    color = np.where((up > 0)[..., None], (0.35, 0.55, 0.95), (0.25, 0.2, 0.15))
    color = color * (0.6 + 0.4 * np.abs(up))[..., None] + (clouds * (up > 0))[..., None]
    return Environment(pixels=color.astype(np.float32))


# --- scenes ---


class Yard:
    """All features of the renderer in one scene. Frame 0 onwards at 30 frames a second.

    Args:
        seed: seed of the textures.
        still: nothing moves at all.
    """

    def __init__(self, seed: int = 0, *, still: bool = False) -> None:
        self.still = still
        floor = tinted(smooth_noise(seed + 1, blur=0.12), (70, 60, 55), (200, 180, 150))
        paint = tinted(smooth_noise(seed + 2, blur=0.07), (30, 60, 160), (250, 200, 60))
        skin = tinted(smooth_noise(seed + 3, blur=0.08), (160, 40, 30), (240, 200, 170))
        orm = np.stack([np.full((64, 64), 255.0), 100 + 120 * smooth_noise(seed + 4), np.zeros((64, 64))], -1)
        self.floor = Material(
            base_color_texture=floor, roughness=1.0, normal_texture=bumps(seed + 5, 0.01),
            orm_texture=Texture(pixels=orm.astype(np.uint8), srgb=False),
        )  # fmt: skip
        self.paint = Material(base_color_texture=paint, roughness=0.4)
        self.skin = Material(base_color_texture=skin, roughness=1.0)
        self.metal = Material(base_color=(0.95, 0.75, 0.4), metallic=1.0, roughness=0.15)
        self.fence = Material(
            base_color_texture=fence_texture(), alpha_cutoff=0.5, double_sided=True, roughness=0.6
        )
        self.lamp = Material(base_color=(0.0, 0.0, 0.0), emissive=(4.0, 2.0, 0.5))
        self.plane, self.box, self.ball, self.tube = plane(10.0), box(), shapes.ball(1.0, 23), bending_tube()
        self.fence_shape = plane(8.0)
        self.sky = sky(seed)

    def camera(self, index: int) -> Camera:
        t = 0.0 if self.still else index / 30.0
        return Camera(
            position=(1.5 * t, 1.6 + 0.6 * t, 5.0 - t), target=(0.3 * t, 0.7 - 0.6 * t, 0.0), fov_y=50.0
        )

    def instances(self, index: int) -> tuple[Instance, ...]:
        now, before = self.poses(index), self.poses(index - 1)
        things = [
            (self.plane, self.floor, "floor"), (self.box, self.paint, "box"),
            (self.ball, self.metal, "ball"), (self.fence_shape, self.fence, "fence"),
            (self.ball, self.lamp, "lamp"),
        ]  # fmt: skip
        glow = 1.0 if self.still else 1.0 + 0.5 * np.sin(3.0 * index)
        rigid = [
            Instance(mesh=mesh, material=material, model=now[name], model_before=before[name], emission=glow)
            for mesh, material, name in things
        ]
        tube = Instance(
            mesh=self.tube, material=self.skin, model=moved(-1.0, 0.0, 0.8), palette=self.palette(index),
            palette_before=self.palette(index - 1),
        )  # fmt: skip
        return *rigid, tube

    def poses(self, index: int) -> dict[str, Values]:
        t = 0.0 if self.still else index / 30.0
        return {
            "floor": moved(0, 0, -2, (8, 1, 8)),
            "box": moved(0.1 + 2.0 * t, 0.55, 0.2) @ turned_by(1, 0.5 + 2.0 * t) @ moved(0, 0, 0, 0.5),
            "ball": moved(1.6, 0.6, -0.4, 0.6),
            "fence": moved(-1.5, 1.0, -1.5) @ turned_by(0, np.pi / 2) @ moved(0, 0, 0, (2, 1, 1)),
            "lamp": moved(0.9, 0.15, 1.4, 0.15),
        }

    def palette(self, index: int) -> Values:
        t = 0.0 if self.still else index / 30.0
        bend = moved(0, 1, 0) @ turned_by(2, 0.6 * np.sin(6.0 * t)) @ moved(0, -1, 0)
        return np.stack([np.eye(4), bend])

    def scene(self, index: int) -> Scene:
        t = 0.0 if self.still else index / 30.0
        pulse = 1.5 + np.sin(9.0 * t)
        lamp = PointLight(position=(0.9, 0.5, 1.4), color=(1.2 * pulse, 0.6 * pulse, 0.15 * pulse), reach=4.0)
        sparks = np.random.default_rng(7).uniform((-1, 0.2, 0), (2, 2, 2), (20, 3))
        sparks[:, 1] += 0.3 * t
        particles = Particles(
            centers=sparks.astype(np.float32), radii=np.full(20, 0.05, np.float32),
            colors=np.tile(np.array([1.0, 0.5, 0.2, 0.3], np.float32), (20, 1)),
        )  # fmt: skip
        return Scene(
            camera=self.camera(index),
            camera_before=self.camera(index - 1),
            environment=self.sky,
            instances=self.instances(index),
            sun=Sun(direction=(-0.5, -1.0, -0.45), color=(3.0, 2.8, 2.5), radius=7.0),
            spot=Spot(
                position=(2.5 - t, 3.5, 2.5), target=(0.5, 0.0, 0.0), color=(10.0, 8.0, 20.0), outer=30.0
            ),
            points=(lamp,),
            particles=(particles,),
        )


def unlit(scene: Scene) -> Scene:
    """Show base colours only: black surfaces that emit theirs, before a black sky."""
    dark = Environment(pixels=np.zeros((32, 64, 3), np.float32))
    glowing: dict[Material, Material] = {}
    for instance in scene.instances:
        material = instance.material
        glowing[material] = replace(
            material, base_color=(0.0, 0.0, 0.0), specular=0.0, metallic=0.0, orm_texture=None,
            emissive=material.base_color, emissive_texture=material.base_color_texture,
        )  # fmt: skip
    instances = tuple(replace(i, material=glowing[i.material], emission=1.0) for i in scene.instances)
    return replace(scene, environment=dark, instances=instances, sun=None, spot=None, points=(), particles=())
