"""Stages, and objects that several families use: lamps, fans, skylines, moving shadow casters.

A stage holds all objects and lights of a scene as functions of time in seconds.
"""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from supersampler_model.data.scenes import scene as scenes
from supersampler_model.data.scenes.procedural import lighting, materials, paths, shapes
from supersampler_model.data.scenes.procedural.lighting import Pulse, steady
from supersampler_model.data.scenes.procedural.paths import Place, Point3, Pose, Vantage, placed, turned_by
from supersampler_model.data.scenes.procedural.shapes import Part


class Prop(NamedTuple):
    """An object that may move, bend and flicker."""

    mesh: scenes.Mesh
    material: scenes.Material
    pose: Pose
    palette: Callable[[float], scenes.Matrices] | None
    emission: Pulse
    casts_shadow: bool
    thin: bool

    def instance(self, now: float, before: float) -> scenes.Instance:
        """Return the object at the time `now`, with its state at the time `before`, both in seconds."""
        palette, palette_before = (self.palette and self.palette(time) for time in (now, before))
        return scenes.Instance(
            mesh=self.mesh, material=self.material, model=self.pose(now), model_before=self.pose(before),
            palette=palette, palette_before=palette_before, emission=self.emission(now),
            casts_shadow=self.casts_shadow, thin=self.thin,
        )  # fmt: skip


@dataclass(slots=True, kw_only=True, eq=False)
class Stage:
    """Objects, lights and camera positions of a scene."""

    environment: scenes.Environment
    exposure: float = 1.0  # that suits the light
    vantages: list[Vantage] = field(default_factory=list)  # each shot uses one
    props: list[Prop] = field(default_factory=list)
    sun: Callable[[float], scenes.Sun] | None = None
    spot: Callable[[float], scenes.Spot] | None = None
    points: list[Callable[[float], scenes.PointLight]] = field(default_factory=list)
    particles: list[Callable[[float], scenes.Particles]] = field(default_factory=list)

    def put(
        self, mesh: scenes.Mesh | Iterable[Part], material: scenes.Material,
        at: scenes.Matrix | Pose | None = None, *, palette: Callable[[float], scenes.Matrices] | None = None,
        emission: Pulse = steady, shadow: bool = True, thin: bool = False,
    ) -> None:  # fmt: skip
        """Add an object, at the origin by default; several parts are merged into one mesh."""
        fixed = np.eye(4) if at is None else at
        pose = fixed if callable(fixed) else lambda _: fixed
        mesh = mesh if isinstance(mesh, scenes.Mesh) else shapes.merged(mesh)
        self.props.append(Prop(mesh, material, pose, palette, emission, shadow, thin))

    def add_vantages(self, *views: tuple[scenes.Vector, scenes.Vector, float], brisk: bool = False) -> None:
        """Add camera positions: position, target and room, see `Vantage`."""
        self.vantages += [Vantage(*view, brisk) for view in views]

    def scene(
        self, now: float, before: float, camera: scenes.Camera, camera_before: scenes.Camera
    ) -> scenes.Scene:
        """Return the stage at the time `now`, with its state at the time `before`, both in seconds."""
        return scenes.Scene(
            camera=camera,
            camera_before=camera_before,
            environment=self.environment,
            instances=tuple(prop.instance(now, before) for prop in self.props),
            sun=None if self.sun is None else self.sun(now),
            spot=None if self.spot is None else self.spot(now),
            points=tuple(point(now) for point in self.points),
            particles=tuple(cloud(now) for cloud in self.particles),
        )


CASTERS = ("mill", "train", "clouds", "boughs")


def caster(
    rng: scenes.Rng, stage: Stage, sun: Callable[[float], scenes.Sun], kind: str | None = None
) -> None:
    """Add one of the CASTERS, a random one by default.

    Casters are flat and face the sun. Cameras in the scene see their backs, which are culled.
    """
    kind = kind or str(rng.choice(CASTERS))
    frame, radius = _frame(sun(0.0)), sun(0.0).radius
    if kind == "mill":
        mesh, pose = _mill(rng, radius, frame)
    elif kind == "train":
        mesh, pose = _train(rng, radius, frame)
    else:
        if kind == "clouds":
            angle, speed = rng.uniform(-0.5, 0.5), (5.0, 14.0)
            end = 0.4 * radius * np.array([np.cos(angle), np.sin(angle), 0.0])
        else:
            end, speed = radius * rng.uniform(0.04, 0.12) * np.array([1.0, 0.3, 0.0]), (2.0, 8.0)
        way = paths.swing(rng, (-end).tolist(), end.tolist(), rng.uniform(*speed))
        mesh = _blots(rng, 9, radius, 0.14) if kind == "clouds" else _blots(rng, 18, 0.8 * radius, 0.08)
        pose = paths.attached(lambda _: frame, paths.upright(way))
    stage.put(mesh, materials.glow((0.0, 0.0, 0.0), 0.0), pose)


def _frame(sun: scenes.Sun) -> scenes.Matrix:
    """Return the matrix to the world, (4, 4), from a frame with z towards the sun and level x.

    The origin lies between the scene and the sun, inside the shadow map.
    """
    to_sun = -np.asarray(sun.direction) / np.linalg.norm(sun.direction)
    across = np.cross((0.0, 1.0, 0.0), to_sun)
    across /= np.linalg.norm(across)
    frame = np.eye(4)
    frame[:3, 0], frame[:3, 1], frame[:3, 2] = across, np.cross(to_sun, across), to_sun
    frame[:3, 3] = np.asarray(sun.center) + 0.8 * sun.radius * to_sun
    return frame


def _mill(rng: scenes.Rng, radius: float, frame: scenes.Matrix) -> tuple[scenes.Mesh, Pose]:
    """Return the blades of a windmill or a fan in front of the sun."""
    length, count = radius * rng.uniform(0.3, 0.55), int(rng.integers(3, 6))
    blade = shapes.wall(length * rng.uniform(0.16, 0.34), length)
    turns = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
    mesh = shapes.merged((blade, turned_by(2, angle)) for angle in turns)
    hub = frame @ placed(*(radius * rng.uniform((-0.3, -0.2), (0.3, 0.2))).tolist())
    rate = float(rng.uniform(1.5, 5.0) * rng.choice([-1.0, 1.0]))
    return mesh, lambda t: np.asarray(hub @ turned_by(2, rate * t))


def _train(rng: scenes.Rng, radius: float, frame: scenes.Matrix) -> tuple[scenes.Mesh, Pose]:
    """Return an endless train of wagons with gaps between them."""
    period, fraction = rng.uniform(2.5, 6.0), rng.uniform(0.4, 0.75)
    tall, y = radius * rng.uniform(0.2, 0.6), radius * rng.uniform(-0.5, 0.1)
    wagon = shapes.wall(fraction * period, tall)
    count = int(np.ceil(radius / period)) + 1
    mesh = shapes.merged((wagon, placed(k * period, y)) for k in range(-count, count + 1))
    speed = float(rng.uniform(5.0, 15.0) * rng.choice([-1.0, 1.0]))
    return mesh, lambda t: np.asarray(frame @ placed(speed * t % period))


def _blots(rng: scenes.Rng, count: int, radius: float, size: float) -> scenes.Mesh:
    """Return ragged spots, on average `size` times the radius wide, scattered over a square."""
    blots = []
    for x, y in rng.uniform(-0.75 * radius, 0.75 * radius, (count, 2)):
        width = 2.0 * radius * size * rng.uniform(0.5, 1.5)
        spot = shapes.wall(width, 0.6 * width)
        turns = (placed(x, y) @ turned_by(2, angle) for angle in rng.uniform(0.0, np.pi, 3))
        blots += [(spot, turn @ placed(0.0, -0.3 * width)) for turn in turns]
    return shapes.merged(blots)


WHEEL = np.eye(4)[[1, 0, 2, 3]] * np.array([1.0, 1.0, -1.0, 1.0])
"""Maps y to x: a level ring becomes a wheel that rolls along z."""


def bulb(
    stage: Stage, path: Place | Point3, color: scenes.Color, *, size: float = 0.06, glow: float = 5.0,
    reach: float = 6.0, pulsing: Pulse = steady,
) -> None:  # fmt: skip
    """Add a point light and a glowing ball of radius `size`, at a point or moving along a path."""
    stage.points.append(lighting.lamp(path, color, reach=reach, pulsing=pulsing))
    glowing_ball(stage, path, size, paths.vector(np.divide(color, max(color))), glow, pulsing)


def glowing_ball(
    stage: Stage, path: Place | Point3, size: float, color: scenes.Color, glow: float, pulsing: Pulse = steady
) -> None:
    """Add a glowing ball without a light source, at a point or moving along a path."""
    shine, pose = materials.glow(color, glow), paths.upright(paths.place_of(path))
    stage.put(shapes.ball(size, 8), shine, pose, emission=pulsing, shadow=False)


def fan(
    rng: scenes.Rng, stage: Stage, at: scenes.Vector, length: float, depth: float, speeds: tuple[float, float]
) -> None:
    """Add a fan of four horizontal blades."""
    blade, turns = shapes.box(length, 0.02, depth), [k * np.pi / 2.0 for k in range(4)]
    blades = [(blade, placed(yaw=turn) @ placed(0.5 * length + 0.05)) for turn in turns]
    turning = paths.spinning(placed(*at), (0, 1, 0), rng.uniform(*speeds))
    stage.put(blades, materials.paint(rng), turning)


def skyline(rng: scenes.Rng, stage: Stage) -> None:
    """Add a ring of buildings far away."""
    blocks = []
    for angle in np.linspace(0.0, 2.0 * np.pi, 44, endpoint=False):
        away, width = rng.uniform(28.0, 45.0), rng.uniform(3.0, 8.0)
        block = shapes.box(width, float(rng.gamma(5.0, 1.3)), width, 0.07)
        blocks.append((block, placed(away * np.sin(angle), 0, away * np.cos(angle), yaw=angle)))
    stage.put(blocks, materials.facade(rng), shadow=False)


def bunting(
    rng: scenes.Rng, stage: Stage, left: Point3, right: Point3, *, sag: float, cord: tuple[float, float],
    flags: int, margin: float, gap: float,
) -> None:  # fmt: skip
    """Add flags in the wind on a cord that sags by `sag` metres.

    `cord` is the radius in metres and the grey value of the cord. `margin` is the fraction without flags at
    each end. `gap` is the distance from the cord to the middle of a flag, metres.
    """
    stage.put(shapes.wire(left, right, sag, cord[0]), materials.paint(rng, (cord[1],) * 3))
    t = np.linspace(margin, 1.0 - margin, flags)[:, None]
    middles = (1.0 - t) * np.array(left) + t * np.array(right)
    middles[:, 1] -= (4.0 * sag * t * (1.0 - t))[:, 0] + gap
    mesh = shapes.cards(rng, middles, np.arange(flags), 0.24, np.array([0.0, 30.0, float(left[2])]))
    stage.put(mesh, materials.striped(rng, 3), palette=paths.wind(rng, middles, 0.09))


def hills(rng: scenes.Rng, stage: Stage, hue: scenes.Color) -> None:
    """Add hills and far trees around; `hue` is sRGB."""
    lumps = []
    for angle in np.linspace(0.0, 2.0 * np.pi, 26, endpoint=False):
        away, size = rng.uniform(38.0, 55.0), rng.uniform(6.0, 13.0)
        form = placed(away * np.sin(angle), -1.5, away * np.cos(angle), size=(size, 0.45 * size, size))
        lumps.append((shapes.rock(rng, 1.0, 6), form))
    for angle in rng.uniform(0.0, 2.0 * np.pi, 60):
        away, size = rng.uniform(18.0, 34.0), rng.uniform(0.8, 2.2)
        form = placed(away * np.sin(angle), size, away * np.cos(angle), size=size)
        lumps.append((shapes.rock(rng, 1.0, 6), form))
    stage.put(lumps, materials.ground(rng, hue, 0.6, 8.0), shadow=False)
