"""A hall whose finely patterned, polished floor runs to the horizon, seen from low above it."""

import numpy as np

from supersampler_model.data.procedural import lighting, materials, shapes
from supersampler_model.data.procedural.fixtures import bulb
from supersampler_model.data.procedural.particles import dust
from supersampler_model.data.procedural.paths import (
    Vantage,
    bounces,
    circuit,
    drift,
    spinning,
    swing,
    together,
    upright,
)
from supersampler_model.data.procedural.stage import Stage
from supersampler_model.data.procedural.transforms import placed

Rng = np.random.Generator


def floors(rng: Rng) -> Stage:
    """Build a hall of columns with a wandering spot and balls that roll over the floor."""
    stage = Stage(
        environment=lighting.indoors(rng, (0.1, 0.11, 0.14), 14, 3.0), exposure=float(rng.uniform(1.2, 1.7))
    )
    gloss = float(rng.uniform(0.2, 1.0))
    floor = (
        materials.planks(rng, 8, gloss)
        if rng.random() < 0.3
        else materials.tiles(rng, int(rng.choice([8, 12, 16])), gloss)
    )
    stage.put(shapes.plane(60.0, 60.0, float(rng.uniform(0.3, 0.6))), floor)
    _architecture(rng, stage)
    _movers(rng, stage)
    _lights(rng, stage)
    if rng.random() < 0.5:
        stage.particles.append(dust(rng, (-5, 0.2, -8), (5, 3, 4)))
    low = float(rng.uniform(0.5, 1.3))
    stage.vantages += [
        Vantage(position=(0.6, low, 5.5), target=(0.0, 0.6, -6.0), room=1.3),
        Vantage(position=(-3.0, low + 0.3, 4.0), target=(2.0, 0.5, -5.0), room=1.2),
        Vantage(position=(2.8, 1.7, 3.0), target=(-1.0, 0.0, -4.0), room=1.2),
    ]
    return stage


def _architecture(rng: Rng, stage: Stage) -> None:
    stone = materials.concrete(rng) if rng.random() < 0.5 else materials.brick(rng)
    spacing, radius = float(rng.uniform(2.6, 3.6)), float(rng.uniform(0.22, 0.4))
    column = shapes.lathe(
        [(radius * 1.5, 0), (radius * 1.5, 0.2), (radius, 0.4), (radius * 0.85, 3.9), (radius * 1.4, 4.1),
         (radius * 1.4, 4.4)], 20,
    )  # fmt: skip
    rows = [placed(side * 4.2, 0, z) for side in (-1, 1) for z in np.arange(2.0, -16.0, -spacing)]
    stage.put(shapes.merged((column, at) for at in rows), stone)
    plaster = materials.plaster(rng, (0.62, 0.58, 0.52))
    for side in (-1, 1):
        stage.put(shapes.wall(44.0, 6.0, 0.3), plaster, placed(side * 7.0, 0, -4.0, yaw=-side * np.pi / 2.0))
        for z in (-9.0, -5.0, -1.0):
            at = placed(side * 6.95, 1.2, z, yaw=-side * np.pi / 2.0)
            stage.put(shapes.panel(1.8, 1.8), materials.poster(rng), at)
    stage.put(shapes.wall(16.0, 6.0, 0.3), plaster, placed(0, 0, -18.0))
    beams = [(shapes.box(14.2, 0.4, 0.35, 0.4), placed(0, 4.4, z)) for z in np.arange(2.0, -16.0, -spacing)]
    stage.put(shapes.merged(beams), plaster)
    plinths = [
        (shapes.box(0.7, 0.8, 0.7, 0.6), placed(float(x), 0, float(z)))
        for x, z in rng.uniform((-3, -9), (3, -2), (4, 2))
    ]
    stage.put(shapes.merged(plinths), stone)


def _movers(rng: Rng, stage: Stage) -> None:
    for _ in range(int(rng.integers(3, 6))):
        radius = float(rng.uniform(0.14, 0.4))
        path = circuit(
            rng, (float(rng.uniform(-1, 1)), 0, float(rng.uniform(-5, -1))),
            (float(rng.uniform(1, 2.6)), float(rng.uniform(1, 3))), float(rng.uniform(1.0, 5.0)),
        )  # fmt: skip
        hops = bounces(rng, path, float(rng.uniform(0.02, 0.5)), radius)
        cover = materials.paint(rng) if rng.random() < 0.6 else materials.any_metal(rng, 0.2)
        stage.put(shapes.ball(radius), cover, spinning(hops, rng.normal(size=3), float(rng.uniform(2, 8))))
    trolley = swing(rng, (-3.0, 0, -6.0), (3.0, 0, -6.5), float(rng.uniform(1.5, 4.0)))
    load = [
        (shapes.box(1.2, 0.08, 0.7), placed(0, 0.25, 0)),
        (shapes.box(0.5, 0.6, 0.5), placed(-0.25, 0.33, 0, yaw=0.2)),
        (shapes.cylinder(0.2, 0.9), placed(0.35, 0.33, 0)),
        (
            shapes.tube([(-0.6, 0.3, 0.3), (-0.6, 1.1, 0.3), (-0.6, 1.1, -0.3), (-0.6, 0.3, -0.3)], 0.02),
            np.eye(4),
        ),
    ]
    stage.put(shapes.merged(load), materials.paint(rng), upright(trolley))


def _lights(rng: Rng, stage: Stage) -> None:
    sweep = swing(rng, (-3.5, 0.0, -6.0), (3.5, 0.0, 0.5), float(rng.uniform(2.0, 6.0)))
    stage.spot = lighting.spotlight(
        lighting.at_rest((float(rng.uniform(-2, 2)), 4.3, -2.0)), sweep, lighting.tint(rng, 130.0, 0.2),
        outer=float(rng.uniform(22, 40)), pulsing=lighting.pulse(rng, "throb"),
    )  # fmt: skip
    if rng.random() < 0.6:
        stage.sun = lighting.sunlight(rng, 4.5, 13.0, elevation=(35.0, 55.0), center=(0, 0, -4))
    for x, z in rng.uniform((-3.5, -9.0), (3.5, 1.0), (5, 2)):
        path = together((x, float(rng.uniform(0.8, 2.6)), z), drift(rng, 1.0, 0.5))
        color = lighting.tint(rng, float(rng.uniform(3, 10)))
        bulb(stage, path, color, size=0.07, pulsing=lighting.pulse(rng))
