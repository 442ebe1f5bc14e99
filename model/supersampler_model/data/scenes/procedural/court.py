"""Family of the test shots: a sports court with nets, fast balls, players' dummies and floodlights."""

import numpy as np

from supersampler_model.data.scenes.procedural import lighting, materials, paths, shapes
from supersampler_model.data.scenes.procedural.fixtures import bulb, skyline
from supersampler_model.data.scenes.procedural.particles import dust
from supersampler_model.data.scenes.procedural.stage import Stage
from supersampler_model.data.scenes.procedural.transforms import placed
from supersampler_model.data.values import Rng


def court(rng: Rng) -> Stage:
    """Build the court, by day or under floodlights."""
    night = rng.random() < 0.5
    if night:
        sky = lighting.outdoors(rng, (0.01, 0.015, 0.04), (0.05, 0.05, 0.09), (0.02, 0.02, 0.02))
    else:
        sky = lighting.outdoors(rng, (0.14, 0.3, 0.7), (0.5, 0.62, 0.8), (0.12, 0.13, 0.12), clouds=1.1)
    stage = Stage(environment=sky, exposure=1.5 if night else 0.7)
    if not night:
        clouds = lighting.maybe(rng, 0.5, lighting.pulse, "fade")
        stage.sun = lighting.sunlight(rng, 5.2, 12.0, elevation=(30, 60), pulsing=clouds, center=(0, 0, -3))
    skyline(rng, stage)
    _ground(rng, stage)
    _nets(rng, stage)
    _stands(rng, stage)
    _balls(rng, stage)
    _players(rng, stage)
    _lights(rng, stage, night)
    if rng.random() < 0.4:
        stage.particles.append(dust(rng, (-4, 0, -6), (4, 2, 3)))
    stage.vantages += [
        paths.Vantage(position=(0.8, 1.7, 4.6), target=(0.0, 1.0, -3.0), room=1.2),
        paths.Vantage(position=(-4.4, 1.3, 2.0), target=(1.0, 0.9, -3.5), room=1.0),
        paths.Vantage(position=(3.8, 2.8, 3.6), target=(-0.8, 0.4, -3.0), room=1.2),
    ]
    return stage


def _ground(rng: Rng, stage: Stage) -> None:
    one = ((0.2, 0.35, 0.55), (0.55, 0.25, 0.18), (0.22, 0.42, 0.3))[int(rng.integers(3))]
    other = (one[2], one[0], one[1])
    stage.put(shapes.plane(60.0, 60.0, 0.5), materials.ground(rng, (0.33, 0.33, 0.33), 0.6))
    stage.put(shapes.box(13.0, 0.03, 15.0, 0.6), materials.ground(rng, other, 0.5, 1.0), placed(0, 0, -3))
    stage.put(shapes.box(8.0, 0.02, 11.0, 0.6), materials.ground(rng, one, 0.5, 1.0), placed(0, 0.03, -3))
    line = 0.06
    lines = [(shapes.plane(line, 11.0), placed(x, 0.062, -3)) for x in (-4.0, -3.0, 0.0, 3.0, 4.0)]
    lines += [(shapes.plane(8.0, line), placed(0, 0.061, z)) for z in (-8.5, -6.0, 0.0, 2.5)]
    circle = shapes.lathe([(1.26, 0.0), (1.2, 0.0005)], 48)
    lines.append((circle, placed(0, 0.06, -3.0)))
    stage.put(lines, materials.ground(rng, (0.9, 0.9, 0.88), 0.5, 0.5))


def _nets(rng: Rng, stage: Stage) -> None:
    cord, dark = materials.net(rng, 16, 0.16), materials.net(rng, 16, 0.14, (0.1, 0.1, 0.1))
    stage.put(shapes.wall(9.0, 1.0, 0.6), dark, placed(0, 0.05, -3.0))
    band, steel = shapes.box(9.0, 0.07, 0.02), materials.metal(rng, (0.75, 0.75, 0.75), 0.3)
    stage.put(band, materials.cloth(rng, (0.9, 0.9, 0.9)), placed(0, 1.03, -3.0))
    posts: list[shapes.Part] = [(shapes.cylinder(0.05, 1.12), placed(x, 0, -3.0)) for x in (-4.5, 4.5)]
    for x in (-2.6, 2.6):
        goal = [(x - 1, 0, -7.5), (x - 1, 1.8, -7.5), (x + 1, 1.8, -7.5), (x + 1, 0, -7.5)]
        posts.append(shapes.tube(goal, 0.04))
        stage.put(shapes.wall(2.0, 1.8, 0.8), cord, placed(x, 0, -8.2))
        for side in (-1.0, 1.0):
            stage.put(shapes.wall(0.7, 1.8, 0.8), cord, placed(x + side, 0, -7.85, yaw=np.pi / 2.0))
    stage.put(posts, steel)
    fence = materials.fence(rng, 10)
    stage.put(shapes.wall(16.0, 3.2, 0.6), fence, placed(0, 0, -10.2))
    posts = [(shapes.cylinder(0.04, 3.4, 8), placed(x, 0, -10.2)) for x in np.arange(-8.0, 8.1, 2.0)]
    rails = [shapes.tube([(-8, y, -10.2), (8, y, -10.2)], 0.03) for y in (0.1, 3.2)]
    stage.put([*posts, *rails], steel)


def _stands(rng: Rng, stage: Stage) -> None:
    steps = [(shapes.box(1.0, 0.45 * k, 12.0, 0.5), placed(6.2 + 1.0 * k, 0, -3.0)) for k in range(1, 5)]
    stage.put(steps, materials.concrete(rng))
    seat, rows = shapes.box(0.4, 0.35, 0.42), np.arange(-8.5, 2.6, 0.62)
    for cover in (materials.paint(rng), materials.paint(rng)):
        places = [placed(6.3 + k, 0.45 * k, z) for k in range(1, 5) for z in rows if rng.random() < 0.45]
        stage.put([(seat, at) for at in places], cover)
    for z in (-8.0, -4.8, -1.6, 1.4):
        board = materials.poster(rng, 0.9 if rng.random() < 0.4 else 0.0)
        pulsing = lighting.maybe(rng, 0.4, lighting.pulse)
        stage.put(shapes.panel(3.0, 0.8), board, placed(-6.2, 0, z, yaw=np.pi / 2.0), emission=pulsing)
    tops = np.stack([np.full(6, -6.4), np.full(6, 3.2), np.linspace(-8, 2, 6)], axis=1)
    groups, middle = np.repeat(np.arange(6), 2), np.array([-20.0, 3.0, -3.0])
    flags = shapes.cards(rng, tops[groups], groups, 0.7, middle)
    stage.put(flags, materials.striped(rng, 2), palette=paths.wind(rng, tops, 0.2))
    poles = [(shapes.cylinder(0.025, 3.6, 8), placed(float(top[0]), 0, float(top[2]))) for top in tops]
    stage.put(poles, materials.paint(rng, (0.85, 0.85, 0.85)))


def _balls(rng: Rng, stage: Stage) -> None:
    for _ in range(int(rng.integers(4, 8))):
        radius, x = rng.uniform(0.1, 0.18), rng.uniform(-3.5, 3.5)
        across = paths.swing(rng, (x, 0.06, -8.0), (rng.uniform(-3.5, 3.5), 0.06, 2.2), rng.uniform(4, 16))
        path = paths.bounces(rng, across, rng.uniform(0.6, 2.2), radius)
        panels = materials.striped(rng, 4) if rng.random() < 0.5 else materials.tiles(rng, 4, 0.3, 0.9)
        pose = paths.spinning(path, rng.normal(size=3), rng.uniform(5, 15))
        stage.put(shapes.ball(radius, 12), panels, pose)
    for _ in range(9):
        at = placed(rng.uniform(-5.5, -4.4), 0.15, rng.uniform(-7, 1.5))
        stage.put(shapes.ball(0.12, 10), materials.paint(rng), at)


def _players(rng: Rng, stage: Stage) -> None:
    body = shapes.lathe([(0.1, 0.06), (0.14, 0.5), (0.17, 0.9), (0.23, 1.35), (0.08, 1.5)], 16, smooth=True)
    limbs = [shapes.tube([(0.22, 1.3, 0), (0.38, 1.0, 0.15), (0.36, 1.15, 0.4)], 0.05, 8)]
    limbs += [shapes.tube([(-0.22, 1.3, 0), (-0.36, 0.95, 0.0), (-0.3, 0.8, 0.2)], 0.05, 8)]
    for z in (-6.5, -5.0, -1.2, 0.6):
        home = (rng.uniform(-2, 2), 0.03, z + rng.uniform(-0.4, 0.4))
        pose = paths.headed(paths.circuit(rng, home, (rng.uniform(0.8, 2.0), 0.6), rng.uniform(1.5, 5.0)))
        stage.put([body, *limbs], materials.striped(rng, 5), pose)
        skin = materials.plaster(rng, (0.7, 0.5, 0.38))
        stage.put([(shapes.ball(0.12, 10), placed(0, 1.64, 0))], skin, pose)


def _lights(rng: Rng, stage: Stage, night: bool) -> None:
    steel = materials.paint(rng, (0.5, 0.52, 0.54))
    strength = 60.0 if night else 12.0
    for x, z in ((-5.5, -9.0), (5.5, -9.0), (-5.5, 2.0), (5.5, 2.0)):
        stage.put(shapes.cylinder(0.08, 5.6, 10), steel, placed(x, 0, z))
        pulsing = lighting.maybe(rng, 0.5, lighting.pulse, "flicker", "throb")
        color = lighting.tint(rng, strength, 0.0)
        bulb(stage, (x, 5.7, z), color, size=0.2, glow=9.0, reach=16.0, pulsing=pulsing)
    chase = paths.swing(rng, (-3.0, 0.0, -6.0), (3.0, 0.0, 0.0), rng.uniform(3.0, 7.0))
    stage.spot = lighting.spotlight(
        (rng.uniform(-5, 5), 6.5, 3.0), chase, lighting.tint(rng, 220.0, 0.1),
        outer=22.0, reach=26.0, pulsing=lighting.pulse(rng, "throb"),
    )  # fmt: skip
