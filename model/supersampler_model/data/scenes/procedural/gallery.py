"""Family of the test shots: a gallery with a polished floor, sculptures, paintings and mobiles that turn."""

from itertools import pairwise

import numpy as np

from supersampler_model.data.scenes.procedural import lighting, materials, paths, shapes
from supersampler_model.data.scenes.procedural.fixtures import bulb
from supersampler_model.data.scenes.procedural.particles import dust
from supersampler_model.data.scenes.procedural.stage import Stage
from supersampler_model.data.scenes.procedural.transforms import placed, turned_by
from supersampler_model.data.scenes.scene import Material
from supersampler_model.data.values import Rng


def gallery(rng: Rng) -> Stage:
    """Build the rooms."""
    bright = rng.random() < 0.6
    stage = Stage(
        environment=lighting.indoors(rng, (0.2, 0.2, 0.21) if bright else (0.05, 0.05, 0.06), 12, 3.5),
        exposure=rng.uniform(0.7, 0.95) if bright else rng.uniform(1.4, 1.9),
    )
    _rooms(rng, stage, bright)
    for x, z in ((-2.4, -1.0), (2.3, -2.2), (-0.5, -4.2), (2.6, -6.0), (-2.8, -5.6)):
        _sculpture(rng, stage, x + rng.normal(0, 0.2), z + rng.normal(0, 0.2))
    _mobile(rng, stage)
    _ropes(rng, stage)
    _lights(rng, stage)
    if rng.random() < 0.4:
        stage.particles.append(dust(rng, (-3, 0.5, -6), (3, 3, 2), opacity=0.25))
    stage.vantages += [
        paths.Vantage(position=(0.3, 1.6, 3.6), target=(-0.1, 1.2, -3.0), room=0.9),
        paths.Vantage(position=(-3.2, 1.3, 1.8), target=(1.5, 1.0, -3.6), room=0.8),
        paths.Vantage(position=(3.2, 0.8, 1.2), target=(-1.2, 1.2, -3.6), room=0.7),
    ]
    return stage


def _rooms(rng: Rng, stage: Stage, bright: bool) -> None:
    marble = materials.tiles(rng, 4, 1.0, 0.2) if rng.random() < 0.6 else materials.planks(rng, 12, 1.0)
    stage.put(shapes.plane(14.0, 24.0, 0.5), marble, placed(0, 0, -3))
    hue = (0.82, 0.81, 0.78) if bright else (0.3, 0.16, 0.16)
    plaster = materials.plaster(rng, hue)
    for side in (-1, 1):
        stage.put(shapes.wall(24.0, 4.6, 0.3), plaster, placed(side * 4.8, 0, -3.0, yaw=-side * np.pi / 2.0))
    stage.put(shapes.wall(10.0, 4.6, 0.3), plaster, placed(0, 0, -9.5))
    partition = shapes.box(2.6, 3.4, 0.3, 0.4)
    stage.put(partition, plaster, placed(float(rng.choice([-3.4, 3.4])), 0, -3.2))
    beams = [(shapes.box(9.6, 0.2, 0.14), placed(0, 4.3, z)) for z in np.arange(-9.0, 4.1, 0.8)]
    beams += [(shapes.box(0.12, 0.16, 14.0), placed(x, 4.1, -3.0)) for x in (-3.4, 0.0, 3.4)]
    stage.put(beams, materials.paint(rng, (0.16, 0.16, 0.17)), shadow=False)
    gold = materials.any_metal(rng, 0.3)
    for side in (-1, 1):
        for z in (-7.5, -5.2, -2.6, -0.2):
            size, yaw = rng.uniform(0.9, 1.6), -side * np.pi / 2.0
            at = placed(side * 4.74, 1.1, z, yaw=yaw)
            stage.put(shapes.box(size + 0.14, size * 0.75 + 0.14, 0.06), gold, at @ placed(0, -0.07, 0))
            stage.put(shapes.panel(size, 0.75 * size), materials.poster(rng), at @ placed(0, 0, 0.035))
    for x in (-2.0, 1.6):
        stage.put(shapes.panel(1.7, 1.7), materials.poster(rng), placed(x, 1.0, -9.44))


def _sculpture(rng: Rng, stage: Stage, x: float, z: float) -> None:
    tall = rng.uniform(0.5, 1.0)
    stage.put(shapes.box(0.75, tall, 0.75, 0.6), materials.plaster(rng, (0.85, 0.85, 0.83)), placed(x, 0, z))
    cover, kind, place = _stuff(rng), int(rng.integers(4)), placed(x, tall, z)
    turn = rng.normal(0.0, 1.5)
    if kind == 0:
        form = paths.spinning(place @ placed(0, 0.42, 0), (0, 1, 0), turn)
        knot = shapes.tube(shapes.knot(97, 0.28, 0.11, 0.16), 0.06, 12)
        stage.put(knot, cover, paths.attached(form, placed(size=0.85)))
    elif kind == 1:
        turns = [turned_by(0, 0.5 * k) @ turned_by(2, 0.4 * k) for k in range(4)]
        rings = [(shapes.torus(0.16 + 0.07 * k, 0.018, 40), at) for k, at in enumerate(turns)]
        stage.put(rings, cover, paths.spinning(place @ placed(0, 0.45, 0), (0.2, 1, 0.1), 2.0 * turn))
    elif kind == 2:
        heights = np.linspace(0.0, 0.95, 26)
        radii = 0.16 + 0.07 * np.sin(heights * rng.uniform(6, 14)) - 0.08 * heights
        figure = shapes.lathe(list(zip(radii.tolist(), heights.tolist(), strict=True)), 30, smooth=True)
        stage.put(figure, cover, paths.spinning(place, (0, 1, 0), turn))
    else:
        bar, angles = shapes.box(0.02, 0.9, 0.02), np.linspace(0, 2 * np.pi, 20, endpoint=False)
        bars = [(bar, placed(0.22 * np.sin(a), 0, 0.22 * np.cos(a))) for a in angles]
        stage.put(bars, cover, paths.spinning(place, (0, 1, 0), 1.5 * turn))
        stage.put(shapes.ball(0.15), _stuff(rng), place @ placed(0, 0.45, 0))


def _stuff(rng: Rng) -> Material:
    kind = rng.random()
    if kind < 0.3:
        return materials.metal(rng, (0.93, 0.93, 0.94), 0.06, 0.04)
    if kind < 0.55:
        return materials.any_metal(rng, rng.uniform(0.12, 0.35))
    if kind < 0.8:
        return materials.plaster(rng, (0.88, 0.86, 0.82))  # marble
    return materials.paint(rng, gloss=1.0)


def _mobile(rng: Rng, stage: Stage) -> None:
    turning = paths.spinning(placed(rng.uniform(-0.6, 0.6), 2.9, -1.6), (0, 1, 0), rng.uniform(0.6, 2.5))
    frame = [shapes.tube([(-1.1, 0, 0), (1.1, 0, 0)], 0.01, 6)]
    frame += [shapes.tube([(0, 0, 0), (0, 1.4, 0)], 0.006, 5)]
    stage.put(frame, materials.paint(rng, (0.08, 0.08, 0.08)), turning)
    for x in (-1.1, -0.5, 0.5, 1.1):
        drop = rng.uniform(0.2, 0.7)
        thread = shapes.tube([(0, -drop, 0), (0, 0, 0)], 0.004, 5)
        leaf = shapes.merged([(shapes.ball(1.0, 8), placed(0, -drop, 0, size=(0.16, 0.11, 0.02)))])
        hanging = paths.attached(turning, paths.spinning(placed(x), (0, 1, 0), rng.normal(0, 3)))
        stage.put(thread, materials.paint(rng, (0.1, 0.1, 0.1)), hanging)
        stage.put(leaf, materials.paint(rng, gloss=0.9), hanging)


def _ropes(rng: Rng, stage: Stage) -> None:
    brass = materials.metal(rng, (0.9, 0.75, 0.4), 0.15)
    posts = [(-1.3, -2.6), (0.2, -2.9), (1.5, -3.4), (1.3, -4.8)]
    stand = shapes.lathe([(0.16, 0), (0.16, 0.03), (0.025, 0.06), (0.025, 0.9), (0.05, 0.95), (0, 1.0)], 14)
    stage.put([(stand, placed(x, 0, z)) for x, z in posts], brass)
    ropes = [shapes.wire((a[0], 0.88, a[1]), (b[0], 0.88, b[1]), 0.18, 0.018) for a, b in pairwise(posts)]
    stage.put(ropes, materials.cloth(rng, (0.55, 0.08, 0.12)))


def _lights(rng: Rng, stage: Stage) -> None:
    sweep = paths.swing(rng, (-2.5, 0.8, -5.0), (2.5, 0.8, -1.0), rng.uniform(1.5, 5.0))
    head, pulsing = (rng.uniform(-2, 2), 4.0, 0.5), lighting.pulse(rng, "throb", "fade")
    stage.spot = lighting.spotlight(head, sweep, lighting.tint(rng, 85.0, 0.25), outer=28.0, pulsing=pulsing)
    for x, z in ((-3.4, -1.0), (3.4, -2.0), (0.0, -4.5), (-3.4, -6.0), (3.4, -6.5)):
        pulsing = lighting.maybe(rng, 0.5, lighting.pulse)
        bulb(stage, (x, 3.95, z), lighting.tint(rng, 9.0, 0.3), reach=7.0, pulsing=pulsing)
    orb = paths.circuit(rng, (0, 1.3, -3.0), (1.6, 2.0), rng.uniform(1.5, 5.0))
    bulb(stage, orb, lighting.tint(rng, 4.0), size=0.09, pulsing=lighting.pulse(rng))
