"""Training family: a hall with a finely patterned, polished floor, seen at grazing angles."""

import numpy as np

from supersampler_model.data.scenes.procedural import lighting, materials, paths, shapes
from supersampler_model.data.scenes.procedural.casters import caster
from supersampler_model.data.scenes.procedural.fixtures import bulb, fan, glowing_ball
from supersampler_model.data.scenes.procedural.particles import dust
from supersampler_model.data.scenes.procedural.stage import Stage
from supersampler_model.data.scenes.procedural.transforms import placed
from supersampler_model.data.scenes.scene import Material
from supersampler_model.data.values import Rng


def floors(rng: Rng) -> Stage:
    """Build a hall of columns with a light over it and balls that roll over the floor, lit or in the dark."""
    dark = rng.random() < 0.27
    ambient = 0.016 if dark else 0.1 * rng.uniform(0.25, 0.9)
    stage = Stage(
        environment=lighting.indoors(
            rng, (ambient, 1.1 * ambient, 1.4 * ambient), 5 if dark else 14, 0.8 if dark else 3.0
        ),
        exposure=float(rng.uniform(1.3, 1.8) if dark else rng.uniform(0.8, 1.2)),
    )
    stage.put(shapes.plane(60.0, 60.0, rng.uniform(0.3, 0.6)), _floor(rng))
    _architecture(rng, stage)
    _movers(rng, stage)
    _lights(rng, stage, dark)
    if rng.random() < 0.5:
        stage.particles.append(dust(rng, (-5, 0.2, -8), (5, 3, 4)))
    low = rng.uniform(0.5, 1.3)
    stage.vantages += [
        paths.Vantage(position=(0.6, low, 5.5), target=(0.0, 0.6, -6.0), room=1.3, brisk=True),
        paths.Vantage(position=(-3.0, low + 0.3, 4.0), target=(2.0, 0.5, -5.0), room=1.2, brisk=True),
        paths.Vantage(position=(2.8, 1.7, 3.0), target=(-1.0, 0.0, -4.0), room=1.2, brisk=True),
        paths.Vantage(position=(-6.2, 1.6, -3.5), target=(4.0, 0.2, -4.5), room=0.6, brisk=True),
        paths.Vantage(position=(0.8, low + 0.4, -13.5), target=(-0.4, 0.5, 0.0), room=1.2, brisk=True),
        paths.Vantage(position=(5.6, 3.8, 1.0), target=(-1.0, 0.0, -4.5), room=0.9, brisk=True),
        paths.Vantage(position=(1.4, 0.3, 1.6), target=(-0.8, 0.5, -6.0), room=0.8, brisk=True),
    ]
    return stage


def _floor(rng: Rng) -> Material:
    gloss, kind = rng.uniform(0.2, 1.0), rng.random()
    if kind < 0.25:
        return materials.planks(rng, 8, gloss)
    return materials.tiles(rng, int(rng.choice([4, 8, 12, 16])), gloss, rng.uniform(0.3, 0.8))


def _architecture(rng: Rng, stage: Stage) -> None:
    stone = materials.concrete(rng) if rng.random() < 0.5 else materials.brick(rng)
    spacing, radius = rng.uniform(2.6, 3.6), rng.uniform(0.22, 0.4)
    column = shapes.lathe(
        [(radius * 1.5, 0), (radius * 1.5, 0.2), (radius, 0.4), (radius * 0.85, 3.9), (radius * 1.4, 4.1),
         (radius * 1.4, 4.4)], 20,
    )  # fmt: skip
    rows = [placed(side * 4.2, 0, z) for side in (-1, 1) for z in np.arange(2.0, -16.0, -spacing)]
    stage.put([(column, at) for at in rows], stone)
    plaster = materials.plaster(rng, (0.62, 0.58, 0.52))
    for side in (-1, 1):
        stage.put(shapes.wall(44.0, 6.0, 0.3), plaster, placed(side * 7.0, 0, -4.0, yaw=-side * np.pi / 2.0))
        for z in (-9.0, -5.0, -1.0):
            at = placed(side * 6.95, 1.2, z, yaw=-side * np.pi / 2.0)
            stage.put(shapes.panel(1.8, 1.8), materials.poster(rng), at)
    stage.put(shapes.wall(16.0, 6.0, 0.3), plaster, placed(0, 0, -18.0))
    stage.put(shapes.wall(16.0, 6.0, 0.3), plaster, placed(0, 0, 9.0, yaw=np.pi))
    beams = [(shapes.box(14.2, 0.4, 0.35, 0.4), placed(0, 4.4, z)) for z in np.arange(2.0, -16.0, -spacing)]
    stage.put(beams, plaster)
    plinth = shapes.box(0.7, 0.8, 0.7, 0.6)
    stage.put([(plinth, placed(x, 0, z)) for x, z in rng.uniform((-3, -9), (3, -2), (4, 2))], stone)


def _movers(rng: Rng, stage: Stage) -> None:
    for _ in range(int(rng.integers(3, 6))):
        radius = rng.uniform(0.14, 0.4)
        middle, extent = (
            (rng.uniform(-1, 1), 0, rng.uniform(-5, -1)),
            (rng.uniform(1, 2.6), rng.uniform(1, 3)),
        )
        path = paths.circuit(rng, middle, extent, rng.uniform(1.0, 5.0))
        hops = paths.bounces(rng, path, rng.uniform(0.02, 0.5), radius)
        cover = materials.paint(rng) if rng.random() < 0.6 else materials.any_metal(rng, 0.2)
        stage.put(shapes.ball(radius), cover, paths.spinning(hops, rng.normal(size=3), rng.uniform(2, 8)))
    trolley = paths.swing(rng, (-3.0, 0, -6.0), (3.0, 0, -6.5), rng.uniform(1.5, 4.0))
    load: list[shapes.Part] = [
        (shapes.box(1.2, 0.08, 0.7), placed(0, 0.25, 0)),
        (shapes.box(0.5, 0.6, 0.5), placed(-0.25, 0.33, 0, yaw=0.2)),
        (shapes.cylinder(0.2, 0.9), placed(0.35, 0.33, 0)),
        shapes.tube([(-0.6, 0.3, 0.3), (-0.6, 1.1, 0.3), (-0.6, 1.1, -0.3), (-0.6, 0.3, -0.3)], 0.02),
    ]
    stage.put(load, materials.paint(rng), paths.upright(trolley))


def _lights(rng: Rng, stage: Stage, dark: bool) -> None:
    """Add a light with shadows, the sun through the open roof by day, and lamps that drift and flicker."""
    _ceiling_light(rng, stage, (1.1 if dark else 1.2) * rng.uniform(0.8, 1.3))
    if not dark and rng.random() < 0.65:
        pulsing = lighting.maybe(rng, 0.6, lighting.clouds)
        stage.sun = lighting.sunlight(
            rng, 6.0, 13.0, elevation=(35.0, 60.0), center=(0, 0, -4), pulsing=pulsing
        )
        if rng.random() < 0.6:
            caster(rng, stage, stage.sun)
    for x, z in rng.uniform((-3.5, -9.0), (3.5, 1.0), (6, 2)):
        path = paths.together((x, rng.uniform(0.6, 2.2), z), paths.drift(rng, 1.2, rng.uniform(0.4, 1.0)))
        color = lighting.tint(rng, rng.uniform(6, 16) * (1.0 if dark else 1.5))
        pulsing = lighting.maybe(rng, 0.6, lighting.nervous)
        bulb(stage, path, color, size=0.07, reach=7.0, pulsing=pulsing)


def _ceiling_light(rng: Rng, stage: Stage, strength: float) -> None:
    """Add a spot that wanders over the floor, a lamp that swings, or one behind the blades of a fan."""
    x, kind = rng.uniform(-2, 2), int(rng.integers(3))
    color, top = lighting.tint(rng, 130.0 * strength, 0.2), (x, 4.3, -2.5)
    pulsing = lighting.maybe(rng, 0.4, lighting.nervous)
    if kind == 0:
        sweep = paths.swing(rng, (-3.5, 0.0, -6.0), (3.5, 0.0, 0.5), rng.uniform(3.0, 14.0))
        outer = rng.uniform(22, 40)
        stage.spot = lighting.spotlight(top, sweep, color, outer=outer, pulsing=pulsing)
        return
    if kind == 1:
        extent = rng.uniform(0.3, 0.9)
        place, stage.spot = lighting.hanging(rng, (x, 5.2, -2.5), 1.8, extent, color, pulsing=pulsing)
        glowing_ball(stage, place, 0.12, (1.0, 0.9, 0.7), 12.0)
        return
    below = (x, 0.0, -2.5)
    stage.spot = lighting.spotlight(top, below, color, outer=60.0, pulsing=pulsing)
    fan(rng, stage, (x, 3.3, -2.5), 1.0, 0.24, (1.5, 6.0))
