"""Moving shadow casters between the sun and a scene; only their shadows are in view."""

from collections.abc import Callable

import numpy as np

from supersampler_model.data.scenes.lights import Sun
from supersampler_model.data.scenes.mesh import Mesh
from supersampler_model.data.scenes.procedural import materials, shapes
from supersampler_model.data.scenes.procedural.paths import Place, Pose, swing
from supersampler_model.data.scenes.procedural.stage import Stage
from supersampler_model.data.scenes.procedural.transforms import placed, turned_by
from supersampler_model.data.values import Matrix, Rng

CASTERS = ("mill", "train", "clouds", "boughs")


def caster(rng: Rng, stage: Stage, sun: Callable[[float], Sun], kind: str | None = None) -> None:
    """Add one of the CASTERS, a random one by default.

    All are flat and face the sun. Cameras in the scene see their backs, which are culled.
    """
    kind = kind or str(rng.choice(CASTERS))
    frame, radius = _frame(sun(0.0)), sun(0.0).radius
    if kind == "mill":
        mesh, pose = _mill(rng, radius, frame)
    elif kind == "train":
        mesh, pose = _train(rng, radius, frame)
    else:
        way = _clouds_way(rng, radius) if kind == "clouds" else _boughs_way(rng, radius)
        mesh = _blots(rng, 9, radius, 0.14) if kind == "clouds" else _blots(rng, 18, 0.8 * radius, 0.08)
        pose = _moved(frame, way)
    stage.put(mesh, materials.glow((0.0, 0.0, 0.0), 0.0), pose)


def _frame(sun: Sun) -> Matrix:
    """Return the matrix from a frame with z towards the sun and x level to the world, (4, 4).

    The origin lies between the scene and the sun, inside its shadow map.
    """
    to_sun = -np.asarray(sun.direction) / np.linalg.norm(sun.direction)
    across = np.cross((0.0, 1.0, 0.0), to_sun)
    across /= np.linalg.norm(across)
    frame = np.eye(4)
    frame[:3, 0], frame[:3, 1], frame[:3, 2] = across, np.cross(to_sun, across), to_sun
    frame[:3, 3] = np.asarray(sun.center) + 0.8 * sun.radius * to_sun
    return frame


def _mill(rng: Rng, radius: float, frame: Matrix) -> tuple[Mesh, Pose]:
    """The blades of a windmill or a fan before the sun."""
    length, count = radius * rng.uniform(0.3, 0.55), int(rng.integers(3, 6))
    blade = shapes.wall(length * rng.uniform(0.16, 0.34), length)
    turns = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
    mesh = shapes.merged((blade, turned_by(2, angle)) for angle in turns)
    hub = frame @ placed(*(radius * rng.uniform((-0.3, -0.2), (0.3, 0.2))).tolist())
    rate = float(rng.uniform(1.5, 5.0) * rng.choice([-1.0, 1.0]))
    return mesh, lambda t: np.asarray(hub @ turned_by(2, rate * t))


def _train(rng: Rng, radius: float, frame: Matrix) -> tuple[Mesh, Pose]:
    """Wagons of an elevated railway with gaps between them, without an end."""
    period, fraction = rng.uniform(2.5, 6.0), rng.uniform(0.4, 0.75)
    tall, y = radius * rng.uniform(0.2, 0.6), radius * rng.uniform(-0.5, 0.1)
    wagon = shapes.wall(fraction * period, tall)
    count = int(np.ceil(radius / period)) + 1
    mesh = shapes.merged((wagon, placed(k * period, y)) for k in range(-count, count + 1))
    speed = float(rng.uniform(5.0, 15.0) * rng.choice([-1.0, 1.0]))
    return mesh, lambda t: np.asarray(frame @ placed(speed * t % period))


def _blots(rng: Rng, count: int, radius: float, size: float) -> Mesh:
    """Return ragged spots, `size` times the radius wide on average, strewn over a square."""
    blots = []
    for x, y in rng.uniform(-0.75 * radius, 0.75 * radius, (count, 2)):
        width = 2.0 * radius * size * rng.uniform(0.5, 1.5)
        middle = placed(x, y)
        for angle in rng.uniform(0.0, np.pi, 3):
            leaf = shapes.wall(width, 0.6 * width)
            blots.append((leaf, middle @ turned_by(2, angle) @ placed(0.0, -0.3 * width)))
    return shapes.merged(blots)


def _clouds_way(rng: Rng, radius: float) -> Place:
    angle, extent = rng.uniform(-0.5, 0.5), 0.4 * radius
    end = extent * np.array([np.cos(angle), np.sin(angle), 0.0])
    return swing(rng, (-end).tolist(), end.tolist(), rng.uniform(5.0, 14.0))


def _boughs_way(rng: Rng, radius: float) -> Place:
    end = radius * rng.uniform(0.04, 0.12) * np.array([1.0, 0.3, 0.0])
    return swing(rng, (-end).tolist(), end.tolist(), rng.uniform(2.0, 8.0))


def _moved(frame: Matrix, way: Place) -> Pose:
    return lambda t: np.asarray(frame @ placed(*way(t).tolist()))
