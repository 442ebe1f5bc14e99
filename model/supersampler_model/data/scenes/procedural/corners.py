"""Families of test shots that are hard for a history: moving thin objects and moving shadows."""

import numpy as np

from supersampler_model.data.scenes.procedural import lighting, materials, paths, shapes
from supersampler_model.data.scenes.procedural.paths import Pose, attached, placed, turned_by
from supersampler_model.data.scenes.procedural.shapes import Part
from supersampler_model.data.scenes.procedural.stage import WHEEL, Stage, caster, hills
from supersampler_model.data.scenes.scene import Mesh, Rng, Vector

ROD = 0.008
"""Radius of most thin objects in metres: about a display pixel wide in 640x360 at 5 m."""


def thin_movers(rng: Rng) -> Stage:
    """Build a yard where wires swing, fans of rods turn and fences pass, in front of a brick wall."""
    sky = lighting.outdoors(rng, (0.25, 0.42, 0.8), (0.8, 0.78, 0.74), (0.2, 0.19, 0.17), clouds=1.0)
    stage = Stage(environment=sky, exposure=0.75)
    stage.sun = lighting.sunlight(
        rng, 6.0, 10.0, elevation=(35.0, 55.0), azimuth=(3.9, 5.5), center=(0.0, 0.0, -4.0)
    )
    _yard(rng, stage)
    iron = materials.paint(rng, (0.07, 0.07, 0.08), 0.3)
    wires = ((-2.9, -3.6, 2.3), (-1.9, -3.0, 2.0), (-0.7, -3.5, 2.4), (1.6, -3.2, 2.1), (2.9, -3.6, 2.4))
    for x, z, length in wires:
        line = [(0.0, -step, 0.0) for step in np.linspace(0.0, length, 7)]
        wire = shapes.tube(line, rng.uniform(0.7, 1.1) * ROD, 6)
        stage.put(wire, iron, _swinging(rng, (x, 3.1, z)), thin=True)
    beam = shapes.tube([(-4.0, 3.1, -3.3), (4.5, 3.1, -3.3)], 0.06)
    posts = [(shapes.cylinder(0.06, 3.1, 10), placed(x, 0.0, -3.3)) for x in (-4.0, 4.5)]
    stage.put([beam, *posts], materials.planks(rng, 4))
    for x, y, z, rate in ((0.6, 1.55, -4.2, 3.4), (-3.3, 1.5, -4.4, -4.6)):
        stage.put(_rods(5, 0.95), iron, paths.spinning(placed(x, y, z), (0, 0, 1), rate), thin=True)
        steel = materials.metal(rng, (0.6, 0.6, 0.62), 0.4)
        stage.put(shapes.cylinder(0.05, y, 10), steel, placed(x, 0, z - 0.12))
    _passing_fences(rng, stage)
    _lines(rng, stage)
    _solids(rng, stage)
    stage.add_vantages(
        ((0.2, 1.6, 1.6), (0.0, 1.5, -4.0), 1.0), ((-2.2, 1.9, 1.2), (0.4, 1.3, -4.0), 1.0),
        ((2.4, 1.4, 1.4), (-0.4, 1.5, -4.0), 1.0),
    )  # fmt: skip
    return stage


def _yard(rng: Rng, stage: Stage) -> None:
    stage.put(shapes.plane(50.0, 50.0, 0.6), materials.tiles(rng, 8, 0.2, 0.5))
    stage.put(shapes.box(7.0, 3.0, 0.4, 0.5), materials.brick(rng, 14), placed(-1.2, 0.0, -6.4))
    stage.put(shapes.wall(2.4, 0.9), materials.sign(rng, 5), placed(-0.6, 1.6, -6.18))
    plaster = materials.plaster(rng, (0.82, 0.76, 0.6))
    stage.put(shapes.box(3.4, 4.2, 2.0, 0.5), plaster, placed(4.6, 0.0, -7.4))
    hills(rng, stage, (0.3, 0.36, 0.24))


def _swinging(rng: Rng, pivot: Vector) -> Pose:
    """Return the pose of a wire that swings across the view, its end by up to 8 render pixels a frame."""
    extent, rate, phase = rng.uniform(0.45, 0.7), rng.uniform(2.8, 4.2), rng.uniform(0.0, 6.3)
    hung = placed(*pivot)
    return lambda t: np.asarray(hung @ turned_by(2, extent * np.sin(rate * t + phase)))


def _rods(count: int, length: float) -> Mesh:
    """Return rods that point away from the origin in the plane of x and y."""
    turns = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
    return shapes.merged((shapes.cylinder(ROD, length, 6), turned_by(2, turn)) for turn in turns)


def _passing_fences(rng: Rng, stage: Stage) -> None:
    """Add two fences of thin bars that pass on wheels."""
    bars: list[Part] = [(shapes.cylinder(0.75 * ROD, 1.0, 6), placed(x)) for x in np.arange(-1.2, 1.21, 0.3)]
    rails: list[Part] = [shapes.tube([(-1.2, y, 0.0), (1.2, y, 0.0)], ROD, 6) for y in (0.05, 1.0)]
    wheels = [(shapes.torus(0.1, 0.03, 20), placed(x) @ WHEEL) for x in (-1.0, 1.0)]
    for z, speed in ((-1.9, 2.2), (-5.3, 3.0)):
        pose = paths.upright(paths.swing(rng, (-3.0, 0.2, z), (3.2, 0.2, z), speed))
        stage.put([*bars, *rails], materials.paint(rng, (0.06, 0.06, 0.07), 0.3), pose, thin=True)
        stage.put(wheels, materials.paint(rng, (0.5, 0.1, 0.08)), attached(pose, placed(0.0, -0.1)))


def _lines(rng: Rng, stage: Stage) -> None:
    """Add wires and a railing that do not move."""
    cord = materials.paint(rng, (0.08, 0.08, 0.08), 0.2)
    lines = [
        shapes.wire((-7.0, y, z), (7.0, y + rise, z), 0.5, ROD)
        for y, z, rise in ((4.0, -5.6, 0.3), (3.7, -5.0, 0.5), (4.4, -5.3, -0.4))
    ]
    stage.put(lines, cord, thin=True)
    bars = [(shapes.cylinder(ROD, 0.9, 6), placed(x, 0.0, -2.7)) for x in np.arange(1.3, 3.4, 0.18)]
    stage.put([*bars, shapes.tube([(1.3, 0.9, -2.7), (3.3, 0.9, -2.7)], 1.4 * ROD, 6)], cord, thin=True)


def _solids(rng: Rng, stage: Stage) -> None:
    """Add balls that hop and a crate that passes: silhouettes that move."""
    for x, z, speed in ((-0.8, -2.4, 2.0), (1.8, -4.9, 3.0)):
        across = paths.swing(rng, (x - 1.4, 0.0, z), (x + 1.4, 0.0, z), speed)
        pose = paths.spinning(paths.bounces(rng, across, 0.9, 0.2), rng.normal(size=3), 6.0)
        stage.put(shapes.ball(0.2, 14), materials.striped(rng, 5), pose)
    way = paths.upright(paths.swing(rng, (-3.6, 0.05, -5.7), (2.4, 0.05, -5.7), 2.2))
    stage.put(shapes.box(0.8, 0.7, 0.5, 1.2), materials.planks(rng, 6), way)


def moving_shadows(rng: Rng) -> Stage:
    """Build a court in low sun: shadows of blades, wagons, balls and rods cross it, and a lamp swings."""
    sky = lighting.outdoors(rng, (0.2, 0.35, 0.75), (0.7, 0.68, 0.66), (0.16, 0.15, 0.14), clouds=0.8)
    stage = Stage(environment=sky, exposure=0.8)
    stage.sun = sun = lighting.sunlight(
        rng, 7.0, 9.0, elevation=(32.0, 46.0), azimuth=(4.2, 5.2), center=(0.0, 0.0, -3.5)
    )
    for kind in ("mill", "train"):
        caster(rng, stage, sun, kind)
    stage.put(shapes.plane(40.0, 40.0, 0.7), materials.tiles(rng, 6, 0.15, 0.3))
    plaster = materials.plaster(rng, (0.85, 0.8, 0.7))
    stage.put(shapes.box(9.0, 3.2, 0.4, 0.5), plaster, placed(-0.5, 0.0, -7.0))
    stage.put(shapes.box(1.6, 1.1, 1.2, 0.8), materials.brick(rng, 10), placed(2.6, 0.0, -5.2))
    urn = shapes.lathe([(0.5, 0.0), (0.35, 0.9), (0.6, 1.0), (0.0, 1.0)], 28)
    stage.put(urn, materials.concrete(rng), placed(-2.4, 0.0, -4.6))
    for x, z, speed in ((-0.6, -2.6, 2.4), (1.2, -4.0, 3.2), (-1.8, -5.8, 2.0)):
        across = paths.swing(rng, (x - 1.5, 0.0, z), (x + 1.5, 0.0, z), speed)
        pose = paths.spinning(paths.bounces(rng, across, 1.2, 0.22), rng.normal(size=3), 5.0)
        stage.put(shapes.ball(0.22, 14), materials.striped(rng, 4), pose)
    turning = paths.spinning(placed(0.6, 2.6, -3.4) @ turned_by(0, 0.5 * np.pi), (0, 0, 1), 1.8)
    stage.put(_rods(5, 1.1), materials.paint(rng, (0.1, 0.1, 0.1)), turning, thin=True)
    steel = materials.metal(rng, (0.6, 0.6, 0.62), 0.4)
    stage.put(shapes.cylinder(0.05, 2.6, 10), steel, placed(0.6, 0.0, -3.4))
    lamp, cone = lighting.hanging(rng, (-2.6, 4.4, -5.2), 1.6, 0.5, (26.0, 17.0, 8.0))
    stage.spot = cone
    stage.put(shapes.ball(0.09, 8), materials.glow((1.0, 0.7, 0.35), 6.0), paths.upright(lamp), shadow=False)
    hills(rng, stage, (0.3, 0.34, 0.24))
    stage.add_vantages(
        ((0.0, 1.9, 2.0), (0.0, 0.7, -4.2), 1.0), ((-2.4, 2.4, 1.4), (0.4, 0.5, -4.4), 1.0),
        ((2.6, 2.0, 1.2), (-0.6, 0.6, -4.4), 1.0),
    )  # fmt: skip
    return stage
