"""Training family: a cellar corridor with a swinging lamp, a fan and flickering tubes; shadows move."""

import numpy as np

from supersampler_model.data.scenes.procedural import lighting, materials, paths, shapes, textures
from supersampler_model.data.scenes.procedural.fixtures import bulb, fan, glowing_ball
from supersampler_model.data.scenes.procedural.particles import dust, sparks
from supersampler_model.data.scenes.procedural.stage import Stage
from supersampler_model.data.scenes.procedural.transforms import placed, turned_by
from supersampler_model.data.values import Rng, Values

HEIGHT = 3.0


def flicker(rng: Rng) -> Stage:
    """Build the corridor: with dim ambient light, or lit by its lamps alone."""
    ambient = 0.035 if rng.random() < 0.65 else 0.004
    stage = Stage(
        environment=lighting.indoors(rng, (ambient, 1.15 * ambient, 1.4 * ambient), 3, 11.0 * ambient),
        exposure=rng.uniform(1.6, 2.3),
    )
    _walls(rng, stage)
    _furniture(rng, stage)
    _swinging_lamp(rng, stage)
    _tubes(rng, stage)
    _screens(rng, stage)
    if rng.random() < 0.5:
        stage.particles.append(sparks(rng, (rng.uniform(-1.5, 1.5), 2.4, -2.9)))
    if rng.random() < 0.5:
        stage.particles.append(dust(rng, (-2, 0.3, -6), (2, 2.6, 2)))
    stage.vantages += [
        paths.Vantage(position=(0.4, 1.55, 3.4), target=(-0.1, 1.2, -3.0), room=0.7, brisk=True),
        paths.Vantage(position=(-1.6, 1.3, 2.2), target=(0.9, 1.0, -2.5), room=0.5, brisk=True),
        paths.Vantage(position=(1.5, 1.9, 2.6), target=(-0.6, 0.8, -2.5), room=0.5, brisk=True),
        paths.Vantage(position=(0.3, 1.6, -7.0), target=(-0.2, 1.1, 1.0), room=0.6, brisk=True),
        paths.Vantage(position=(-1.9, 1.5, 0.6), target=(2.0, 1.0, -3.0), room=0.4, brisk=True),
        paths.Vantage(position=(0.2, 0.5, 1.6), target=(-0.1, 1.5, -4.0), room=0.5, brisk=True),
    ]
    return stage


def _walls(rng: Rng, stage: Stage) -> None:
    kind = rng.random()
    rough = materials.brick(rng) if kind < 0.4 else materials.tiles(rng, 12, 0.5, 0.3)
    sides = rough if kind < 0.7 else materials.plaster(rng, textures.color(rng, 0.25, 0.6))
    for side in (-1, 1):
        stage.put(shapes.wall(16.0, HEIGHT, 0.6), sides, placed(side * 2.4, 0, -3.0, yaw=-side * np.pi / 2.0))
    stage.put(shapes.wall(5.0, HEIGHT, 0.6), sides, placed(0, 0, -8.0))
    stage.put(shapes.wall(5.0, HEIGHT, 0.6), sides, placed(0, 0, 4.9, yaw=np.pi))
    wet = materials.tiles(rng, 8, 0.9, 0.4) if rng.random() < 0.5 else materials.concrete(rng)
    stage.put(shapes.plane(6.0, 20.0, 0.6), wet, placed(0, 0, -2.0))
    lid = shapes.box(5.0, 0.2, 18.0, 0.4)
    stage.put(lid, materials.concrete(rng), placed(0, HEIGHT, -3.0), shadow=False)
    pipes = [
        shapes.tube([(x, y, -8.0), (x, y, 5.0)], r, 10)
        for x, y, r in ((-2.2, 2.7, 0.08), (-2.0, 2.8, 0.05), (2.2, 2.6, 0.1), (2.25, 0.4, 0.06))
    ]
    rings = [(shapes.box(0.3, 0.05, 0.06), placed(-2.2, 2.6, z)) for z in np.arange(-7.5, 4.0, 1.5)]
    stage.put([*pipes, *rings], materials.plates(rng, (0.55, 0.4, 0.3)))


def _furniture(rng: Rng, stage: Stage) -> None:
    for z in (-5.5, -3.5, -1.5, 0.2):
        side = float(rng.choice([-1.0, 1.0]))
        kind, x = int(rng.integers(3)), side * rng.uniform(1.2, 1.9)
        if kind == 0:
            size = rng.uniform(0.5, 0.8)
            wood = materials.planks(rng)
            stage.put(shapes.box(size, size, size, 1.0), wood, placed(x, 0, z, yaw=rng.uniform(0, 2)))
        elif kind == 1:
            stage.put(shapes.cylinder(0.3, 0.9, 20), materials.paint(rng), placed(x, 0, z))
        else:
            shelf = [(shapes.box(0.9, 0.04, 0.4), placed(0, y, 0)) for y in (0.1, 0.7, 1.3, 1.9)]
            post = shapes.box(0.04, 1.95, 0.04)
            posts = [(post, placed(a, 0, b)) for a in (-0.43, 0.43) for b in (-0.18, 0.18)]
            stage.put(shelf + posts, materials.paint(rng), placed(x, 0, z, yaw=np.pi / 2.0))
    seat, back = shapes.box(0.45, 0.05, 0.45), shapes.box(0.45, 0.5, 0.04)
    chair = [(seat, placed(0, 0.45, 0)), (back, placed(0, 0.5, -0.22))]
    chair += [(shapes.box(0.04, 0.45, 0.04), placed(a, 0, b)) for a in (-0.2, 0.2) for b in (-0.2, 0.2)]
    stage.put(chair, materials.planks(rng), placed(rng.uniform(-0.6, 0.6), 0, -2.2, yaw=rng.uniform(0, 6)))
    stage.put(shapes.wall(2.0, 2.2), materials.fence(rng, 6), placed(rng.uniform(-1, 1), 0, -4.6))


def _swinging_lamp(rng: Rng, stage: Stage) -> None:
    """Add a lamp on a cable, its cone, and below it a fan that cuts the light, or a bare swinging cone."""
    z, reach = rng.uniform(-3.0, -1.5), 1.0
    angle = paths.swing(rng, (-0.55, 0.0, -0.3), (0.55, 0.0, 0.3), rng.uniform(0.8, 2.2))

    def lamp(t: float) -> Values:
        x, _, dz = angle(t)
        return np.array([reach * np.sin(x), HEIGHT - reach * np.cos(x), z + reach * np.sin(dz)])

    def below(t: float) -> Values:
        return lamp(t) + 2.0 * (lamp(t) - (0.0, HEIGHT, z))

    pulsing = lighting.pulse(rng, "throb", "flicker", "fade")
    stage.spot = lighting.spotlight(
        lamp, below, lighting.tint(rng, 16.0, 0.5), outer=62.0, reach=12.0, pulsing=pulsing
    )
    shade = shapes.lathe([(0.28, -0.02), (0.12, 0.14), (0.03, 0.2)], 20)
    stage.put(shade, materials.paint(rng, gloss=0.8), paths.upright(lamp), shadow=False)
    glowing_ball(stage, lamp, 0.06, (1.0, 0.85, 0.6), 14.0, pulsing)
    if rng.random() < 0.5:
        fan(rng, stage, (0.0, 1.45, z), 0.9, 0.16, (2.0, 7.0))


def _tubes(rng: Rng, stage: Stage) -> None:
    for index, z in enumerate((-6.5, -4.0, 0.5)):
        color, pulsing = (lighting.tint(rng, 1.0, rng.uniform(-0.5, 0.3)), lighting.pulse(rng, "flicker"))
        if index == 1:
            pulsing = lighting.pulse(rng)
        x = float(rng.choice([-1.2, 1.2]))
        tube = shapes.merged([(shapes.tube([(-0.6, 0, 0), (0.6, 0, 0)], 0.025), turned_by(1, np.pi / 2.0))])
        stage.put(tube, materials.glow(color, 6.0), placed(x, 2.85, z), emission=pulsing, shadow=False)
        bright = paths.vector(np.multiply(color, rng.uniform(2.0, 4.0)))
        stage.points.append(lighting.lamp((x, 2.7, z), bright, reach=6.0, pulsing=pulsing))


def _screens(rng: Rng, stage: Stage) -> None:
    for side in (-1.0, 1.0):
        z, y = rng.uniform(-4.5, -0.5), rng.uniform(1.2, 1.8)
        pulsing, yaw = lighting.pulse(rng, "flicker", "throb"), -side * np.pi / 2.0
        case, screen = placed(side * 2.34, y - 0.05, z, yaw=yaw), placed(side * 2.28, y, z, yaw=yaw)
        stage.put(shapes.box(1.0, 0.7, 0.1), materials.paint(rng, (0.1, 0.1, 0.1)), case)
        stage.put(shapes.panel(0.9, 0.6), materials.poster(rng, 1.2), screen, emission=pulsing)
        color, home = lighting.tint(rng, 1.2), (side * 1.9, y + 0.3, z)
        wander = paths.together(home, paths.drift(rng, 0.1, 2.0))
        stage.points.append(lighting.lamp(wander, color, reach=4.0, pulsing=pulsing))
    beacon = paths.circuit(rng, (0.0, 2.5, -7.1), (0.7, 0.7), rng.uniform(3.0, 7.0))
    bulb(stage, beacon, lighting.tint(rng, 5.0, 1.0), reach=7.0)
