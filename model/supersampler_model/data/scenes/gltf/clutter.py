"""Procedural objects for compositions: thin ones, leaves, mirrors, fast movers, lights, particles."""

from collections.abc import Callable

import numpy as np

from supersampler_model.data.scenes.gltf.ground import Ground
from supersampler_model.data.scenes.procedural import lighting, materials, particles, paths, shapes
from supersampler_model.data.scenes.procedural.outdoors import bush
from supersampler_model.data.scenes.procedural.paths import placed
from supersampler_model.data.scenes.procedural.stage import Stage, bulb
from supersampler_model.data.scenes.scene import Color, Material, Matrix, Mesh, Rng, Values

_CLEARANCE = 0.5  # metres around an object that are kept free
Kind = Callable[[Rng, Stage, Ground, Values], list[Values]]
"""Function that adds an object near a position (3,), and returns the positions (3,) that it occupies."""


def add_clutter(rng: Rng, stage: Stage, ground: Ground, focus: Values) -> list[Values]:
    """Add thin and moving objects around a position (3,), and perhaps others and particles.

    Returns:
        The positions (3,) that cameras should keep away from.
    """
    kinds: list[Kind] = []
    for choices, low, high in ((_THIN, 1, 2), (_MOVING, 1, 2), (_OTHER, 0, 1)):
        order = rng.permutation(len(choices))[: int(rng.integers(low, high + 1))]
        kinds += [choices[int(index)] for index in order]
    if rng.random() < 0.6:
        _particles(rng, stage, focus)
    occupied: list[Values] = []
    for kind in kinds:
        for place in kind(rng, stage, ground, focus):
            ground.take(place, _CLEARANCE)
            occupied.append(place)
    return occupied


def _cables(rng: Rng, stage: Stage, ground: Ground, focus: Values) -> list[Values]:
    """Add wires between two poles."""
    start, end = ground.stretch(rng, focus, 2.5, 2.0, 5.0)
    tall, radius = rng.uniform(1.4, 1.95), rng.uniform(0.003, 0.01)
    poles = [_pole(place, tall, rng.uniform(0.015, 0.045)) for place in (start, end)]
    wires = []
    for height in np.linspace(0.4, 1.0, int(rng.integers(3, 7))) * tall:
        up, sag = np.array([0.0, height, 0.0]), rng.uniform(0.0, 0.25)
        wires.append(shapes.wire(start + up, end + up, sag, radius))
    stage.put(poles, materials.planks(rng))
    stage.put(wires, materials.paint(rng, (0.06, 0.06, 0.06)))
    return [start, end]


def _screen(rng: Rng, stage: Stage, ground: Ground, focus: Values) -> list[Values]:
    """Add a panel with holes between two posts: chain-link, a grille or a net."""
    start, end = ground.stretch(rng, focus, 2.0, 1.0, 3.0)
    along, tall = end - start, rng.uniform(0.8, 1.8)
    hue: Color = (0.55, 0.56, 0.58)
    surface = (
        lambda: materials.fence(rng),
        lambda: materials.grille(rng, int(rng.integers(8, 20)), int(rng.integers(2, 12)), 0.2, hue),
        lambda: materials.net(rng, int(rng.integers(10, 20)), 0.15),
    )[int(rng.integers(3))]()
    panel = shapes.wall(float(np.hypot(along[0], along[2])), tall, rng.uniform(0.7, 1.4))
    across = placed(yaw=float(np.arctan2(-along[2], along[0])))
    stage.put(panel, surface, placed(*(0.5 * (start + end))) @ across)
    posts = [_pole(place, tall + 0.05, 0.025) for place in (start, end)]
    stage.put(posts, materials.metal(rng, hue, 0.35))
    return [start, 0.5 * (start + end), end]


def _rods(rng: Rng, stage: Stage, ground: Ground, focus: Values) -> list[Values]:
    """Add a ring of thin upright rods, half of the time turning."""
    place, radius = ground.near(rng, focus, 0.5, 2.5), rng.uniform(0.25, 0.5)
    tall, thin = rng.uniform(0.7, 1.7), rng.uniform(0.004, 0.012)
    angles = np.linspace(0.0, 2.0 * np.pi, int(rng.integers(9, 24)), endpoint=False)
    around = [np.array([radius * np.cos(a), 0.0, radius * np.sin(a)]) for a in angles]
    hoops = [(shapes.torus(radius, 1.5 * thin), placed(0, height, 0)) for height in (0.02, tall)]
    cage = shapes.merged([*(_pole(foot, tall, thin) for foot in around), *hoops])
    speed = float(rng.choice([-1.0, 1.0]) * rng.uniform(0.5, 4.0) * rng.integers(2))
    stage.put(cage, _shiny(rng), paths.spinning(placed(*place), (0.0, 1.0, 0.0), speed))
    return [place]


def _bush(rng: Rng, stage: Stage, ground: Ground, focus: Values) -> list[Values]:
    """Add leaves in the wind."""
    place = ground.near(rng, focus, 0.6, 2.5)
    plant = Stage(environment=stage.environment)
    bush(rng, plant, (0.0, 0.0), rng.uniform(0.05, 0.16))
    stage.props += [prop._replace(pose=paths.attached(prop.pose, placed(*place))) for prop in plant.props]
    return [place]


def _balls(rng: Rng, stage: Stage, ground: Ground, focus: Values) -> list[Values]:
    """Add glossy balls; some of them bounce along a path."""
    for _ in range(int(rng.integers(2, 5))):
        radius, surface = rng.uniform(0.08, 0.24), _shiny(rng)
        if rng.random() < 0.4:
            at = placed(*ground.near(rng, focus, 0.3, 2.0))
            stage.put(shapes.ball(radius), surface, at @ placed(0.0, radius, 0.0))
            continue
        start, end = ground.stretch(rng, focus, 1.5, 0.8, 3.0)
        way = paths.swing(rng, paths.vector(start), paths.vector(end), rng.uniform(0.5, 5.0))
        path = paths.bounces(rng, way, rng.uniform(0.1, 0.8), radius)
        stage.put(shapes.ball(radius), surface, paths.spinning(path, rng.normal(size=3), rng.uniform(1, 9)))
    return []


def _runner(rng: Rng, stage: Stage, ground: Ground, focus: Values) -> list[Values]:
    """Add an object that moves back and forth."""
    start, end = ground.stretch(rng, focus, 2.0, 1.5, 5.0)
    path = paths.swing(rng, paths.vector(start), paths.vector(end), rng.uniform(1.0, 7.0))
    size = rng.uniform(0.25, 0.6)
    column = [(0.3, 0.0), (0.35, 0.8), (0.12, 1.1), (0.3, 1.6), (0.0, 2.0)]
    mesh = (
        shapes.box(size, rng.uniform(1.0, 2.5) * size, size, 1.5),
        shapes.lathe([(size * radius, size * height) for radius, height in column], 20, smooth=True),
        shapes.merged([(shapes.torus(0.4 * size, 0.12 * size), placed(0, 0.12 * size, 0))]),
    )[int(rng.integers(3))]
    turning = paths.spinning(np.eye(4), (0.0, 1.0, 0.0), rng.normal(0.0, 4.0))
    stage.put(mesh, _patterned(rng), paths.attached(paths.headed(path), turning))
    return []


def _crates(rng: Rng, stage: Stage, ground: Ground, focus: Values) -> list[Values]:
    """Add a pile of boxes with fine patterns."""
    place, level = ground.near(rng, focus, 0.8, 2.5), 0.0
    for _ in range(int(rng.integers(1, 4))):
        size = rng.uniform(0.25, 0.55)
        box = shapes.box(size, 0.8 * size, size, rng.uniform(0.8, 2.5))
        at = placed(*place) @ placed(0, level, 0, yaw=rng.uniform(0.0, 1.6))
        stage.put(box, _patterned(rng), at)
        level += 0.8 * size
    return [place]


def _light(rng: Rng, stage: Stage, ground: Ground, focus: Values) -> list[Values]:
    """Add a glowing ball that circles and pulses."""
    home = ground.near(rng, focus, 0.0, 1.5)
    home[1] += rng.uniform(0.5, 1.6)
    path = paths.circuit(rng, paths.vector(home), (rng.uniform(0.1, 0.8), 0.3), rng.uniform(0.3, 3.0))
    color = lighting.tint(rng, rng.uniform(1.0, 4.0))
    bulb(stage, path, color, size=0.04, glow=6.0, reach=5.0, pulsing=lighting.pulse(rng))
    return []


_THIN: tuple[Kind, ...] = (_cables, _screen, _rods, _bush)
_MOVING: tuple[Kind, ...] = (_balls, _runner)
_OTHER: tuple[Kind, ...] = (_crates, _light)


def _particles(rng: Rng, stage: Stage, focus: Values) -> None:
    low, high = (paths.vector(np.add(focus, corner)) for corner in ((-2.0, 0.1, -2.0), (2.0, 1.8, 2.0)))
    above = paths.vector(focus + rng.uniform((-1.0, 0.1, -1.0), (1.0, 1.0, 1.0)))
    kind = int(rng.integers(4))
    if kind == 0:
        cloud = particles.dust(rng, low, high, size=rng.uniform(0.006, 0.014))
    elif kind == 1:
        cloud = particles.fireflies(rng, low, high)
    else:
        cloud = (particles.sparks if kind == 2 else particles.smoke)(rng, above)
    stage.particles.append(cloud)


def _shiny(rng: Rng) -> Material:
    kind = rng.random()
    if kind < 0.3:
        return materials.metal(rng, (0.92, 0.92, 0.93), 0.06, 0.05)  # a mirror
    if kind < 0.6:
        return materials.any_metal(rng, rng.uniform(0.08, 0.4))
    return materials.paint(rng, gloss=0.95)


def _patterned(rng: Rng) -> Material:
    return (
        lambda: materials.tiles(rng, 4, rng.random()),
        lambda: materials.striped(rng, int(rng.integers(3, 9))),
        lambda: materials.brick(rng),
        lambda: materials.planks(rng),
        lambda: materials.plates(rng, (0.5, 0.53, 0.56)),
    )[int(rng.integers(5))]()


def _pole(foot: Values, tall: float, radius: float) -> tuple[Mesh, Matrix]:
    return shapes.cylinder(radius, tall, 8), placed(*foot)
