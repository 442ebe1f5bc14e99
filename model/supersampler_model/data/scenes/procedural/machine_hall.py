"""Family of the test shots: a machine hall of pipes, grilles, pistons and beacons, in steam."""

import numpy as np

from supersampler_model.data.scenes.procedural import lighting, materials, paths, shapes
from supersampler_model.data.scenes.procedural.fixtures import bulb
from supersampler_model.data.scenes.procedural.particles import smoke, sparks
from supersampler_model.data.scenes.procedural.stage import Stage
from supersampler_model.data.scenes.procedural.transforms import placed, turned_by
from supersampler_model.data.values import Rng


def machine_hall(rng: Rng) -> Stage:
    """Build the hall."""
    stage = Stage(
        environment=lighting.indoors(rng, (0.1, 0.09, 0.075), 10, 2.0), exposure=rng.uniform(1.3, 1.8)
    )
    _shell(rng, stage)
    _pipes(rng, stage)
    _catwalk(rng, stage)
    for x in (-3.0, 0.2, 3.2):
        _machine(rng, stage, x + rng.uniform(-0.4, 0.4), rng.uniform(-4.0, -2.6))
    _lights(rng, stage)
    stage.particles.append(smoke(rng, (rng.uniform(-3, 3), 0.3, -4.0), grey=0.25))
    if rng.random() < 0.6:
        stage.particles.append(sparks(rng, (rng.uniform(-3, 3), 1.6, -2.4), 90))
    stage.vantages += [
        paths.Vantage(position=(0.5, 1.7, 3.4), target=(0.0, 1.5, -3.0), room=0.9),
        paths.Vantage(position=(-4.0, 2.9, 2.0), target=(1.0, 1.0, -3.5), room=0.8),
        paths.Vantage(position=(3.6, 1.2, 1.6), target=(-1.5, 1.8, -4.0), room=0.8),
    ]
    return stage


def _shell(rng: Rng, stage: Stage) -> None:
    stage.put(shapes.plane(24.0, 24.0, 0.6), materials.plates(rng, (0.42, 0.44, 0.46)), placed(0, 0, -2))
    sheet = materials.plates(rng, (0.38, 0.45, 0.42) if rng.random() < 0.5 else (0.5, 0.45, 0.38))
    stage.put(shapes.wall(24.0, 7.0, 0.4), sheet, placed(0, 0, -8.0))
    for side in (-1, 1):
        stage.put(shapes.wall(24.0, 7.0, 0.4), sheet, placed(side * 8.0, 0, 0, yaw=-side * np.pi / 2.0))
    girders = [(shapes.box(0.3, 7.0, 0.3), placed(x, 0, -7.8)) for x in np.arange(-7.5, 7.6, 2.5)]
    girders += [(shapes.box(16.0, 0.35, 0.25), placed(0, 5.8, z)) for z in (-6.0, -3.0, 0.0, 3.0)]
    stage.put(girders, materials.paint(rng, (0.75, 0.55, 0.12)))


def _pipes(rng: Rng, stage: Stage) -> None:
    groups = [materials.paint(rng), materials.any_metal(rng, 0.25), materials.plates(rng, (0.6, 0.42, 0.3))]
    for index, cover in enumerate(groups):
        parts: list[shapes.Part] = []
        for _ in range(4):
            x, z, y = rng.uniform(-7, 7), rng.uniform(-7.6, -6.2), rng.uniform(2.6, 5.2)
            radius, way = rng.uniform(0.06, 0.2), rng.uniform(2, 5)
            bend = np.linspace(0.0, np.pi / 2.0, 6)
            corner = np.stack([x + 0.4 * (1.0 - np.cos(bend)), y - 0.4 + 0.4 * np.sin(bend), 0 * bend + z], 1)
            path = np.concatenate([[(x, 0.0, z)], corner, [(x + way, y, z)]])
            parts.append(shapes.tube(path, radius, 12))
            for height in np.arange(0.5, y - 0.6, 1.1):
                parts.append((shapes.cylinder(1.35 * radius, 0.08, 14), placed(x, height, z)))
        high = [(-8.0, 4.6 + 0.3 * index, -1.5 * index), (8.0, 4.6 + 0.3 * index, -1.5 * index)]
        parts.append(shapes.tube(high, 0.12, 12))
        stage.put(parts, cover)


def _catwalk(rng: Rng, stage: Stage) -> None:
    floor = materials.grille(rng, 12, 12, 0.28)
    stage.put(shapes.plane(14.0, 1.4, 1.0), floor, placed(0, 3.1, -5.2))
    stage.put(shapes.plane(6.0, 1.2, 1.0), floor, placed(-1.0, 0.08, -1.2))
    rails = [shapes.tube([(-7, y, z), (7, y, z)], 0.02, 6) for y in (3.6, 4.1) for z in (-5.9, -4.5)]
    posts = [(shapes.cylinder(0.02, 1.0, 6), placed(x, 3.1, -4.5)) for x in np.arange(-7.0, 7.1, 0.7)]
    struts = [(shapes.cylinder(0.05, 3.1, 8), placed(x, 0, -4.55)) for x in np.arange(-6.0, 6.1, 3.0)]
    stage.put([*rails, *posts, *struts], materials.paint(rng, (0.8, 0.65, 0.1)))
    cage = materials.grille(rng, 16, 8, 0.2, (0.3, 0.3, 0.32))
    stage.put(shapes.wall(3.0, 1.6, 0.7), cage, placed(rng.uniform(-3, 3), 0, -1.6, yaw=rng.normal(0, 0.3)))


def _machine(rng: Rng, stage: Stage, x: float, z: float) -> None:
    cover, steel = materials.paint(rng), materials.brushed(rng, (0.68, 0.67, 0.65))
    body = [(shapes.box(1.7, 0.9, 1.2), placed(x, 0, z)), (shapes.box(0.3, 2.3, 0.9), placed(x - 0.7, 0, z))]
    body += [(shapes.box(1.7, 0.3, 0.9), placed(x, 2.2, z)), (shapes.box(1.9, 0.12, 1.4), placed(x, 0, z))]
    stage.put(body, cover)
    for k in (-0.25, 0.25, 0.6):
        stroke = paths.swing(rng, (x + k, 1.0, z), (x + k, 1.6, z), rng.uniform(1.0, 4.0))
        rod = [shapes.cylinder(0.05, 1.2, 12), shapes.cylinder(0.11, 0.22, 16)]
        stage.put(rod, steel, paths.upright(stroke))
    rim = shapes.torus(0.5, 0.06, 28)
    spokes = [(shapes.box(0.95, 0.03, 0.06), placed(yaw=a)) for a in np.linspace(0, np.pi, 3, endpoint=False)]
    wheel = shapes.merged([rim, *spokes])
    axle = paths.spinning(placed(x + 1.0, 0.9, z + 0.2), (1, 0, 0), rng.normal(0.0, 7.0))
    stage.put(wheel, materials.any_metal(rng, 0.3), paths.attached(axle, turned_by(2, np.pi / 2.0)))
    gauge = materials.poster(rng, 1.0)
    pulsing = lighting.pulse(rng)
    stage.put(shapes.panel(0.5, 0.35), gauge, placed(x + 0.2, 0.45, z + 0.61), emission=pulsing)


def _lights(rng: Rng, stage: Stage) -> None:
    sweep = paths.swing(rng, (-3.0, 0.0, -4.0), (3.0, 0.5, -2.0), rng.uniform(1.5, 5.0))
    crane = paths.swing(rng, (-3.0, 5.6, 0.0), (3.0, 5.6, -1.0), rng.uniform(0.5, 2.0))
    color, pulsing = lighting.tint(rng, 150.0, 0.3), lighting.pulse(rng, "throb")
    stage.spot = lighting.spotlight(crane, sweep, color, outer=30.0, pulsing=pulsing)
    rope, hook = shapes.tube([(0, -2.0, 0), (0, 0, 0)], 0.015, 5), shapes.torus(0.14, 0.03)
    stage.put([rope, (hook, placed(0, -2.1, 0))], materials.paint(rng, (0.2, 0.2, 0.2)), paths.upright(crane))
    for x in (-6.0, 0.0, 6.0):
        wander = paths.together((x, 3.9, -4.2), paths.drift(rng, 0.1, 1.0))
        bulb(stage, wander, lighting.tint(rng, 14.0, 0.5), size=0.09, reach=9.0, pulsing=lighting.pulse(rng))
    turning = paths.spinning(placed(rng.uniform(-3, 3), 2.9, -3.2), (0, 1, 0), rng.uniform(5, 9))
    beam = paths.point_of(turning, (0.0, 0.0, 0.5))
    bulb(stage, beam, lighting.tint(rng, 9.0, 1.0), size=0.07, glow=8.0, reach=7.0)
