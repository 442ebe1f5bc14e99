"""Training family: thin wires, poles and chain-link before brick, with a moving cart behind the fence."""

import numpy as np

from supersampler_model.data.scenes.procedural import lighting, materials, paths, shapes
from supersampler_model.data.scenes.procedural.casters import caster
from supersampler_model.data.scenes.procedural.fixtures import WHEEL, bulb, glowing_ball, skyline
from supersampler_model.data.scenes.procedural.particles import dust
from supersampler_model.data.scenes.procedural.stage import Stage
from supersampler_model.data.scenes.procedural.transforms import placed
from supersampler_model.data.scenes.scene import Material
from supersampler_model.data.values import Rng

FENCE_HEIGHT = 2.2


def fences(rng: Rng) -> Stage:
    """Build a fenced yard under power lines, at any hour."""
    weather = lighting.weather(rng, 14.0)
    stage = Stage(environment=weather.environment, exposure=weather.exposure, sun=weather.sun)
    stage.put(shapes.plane(50.0, 50.0, 0.4), _yard(rng))
    _buildings(rng, stage)
    skyline(rng, stage)
    _fence(rng, stage)
    _power_lines(rng, stage)
    _cargo(rng, stage)
    _cart(rng, stage, weather.dark)
    _lights(rng, stage, weather.dark)
    if not weather.dark and rng.random() < 0.85:
        caster(rng, stage, weather.sun)
    if rng.random() < 0.4:
        stage.particles.append(dust(rng, (-6, 0, -5), (6, 3, 4)))
    side = rng.uniform(2.0, 4.5)
    stage.vantages += [
        paths.Vantage(position=(side, 1.6, 5.0), target=(-0.5, 1.3, -2.0), room=1.3, brisk=True),
        paths.Vantage(position=(-4.5, 1.2, 2.6), target=(1.0, 1.4, -2.5), room=1.0, brisk=True),
        paths.Vantage(position=(0.5, 1.0, 4.0), target=(0.0, 3.2, -4.0), room=1.0, brisk=True),
        paths.Vantage(position=(-6.8, 1.7, -1.2), target=(3.0, 0.7, -3.4), room=0.7, brisk=True),
        paths.Vantage(position=(2.5, 3.4, 3.6), target=(-0.5, 0.3, -2.5), room=1.2, brisk=True),
        paths.Vantage(position=(-1.0, 1.4, 1.7), target=(0.6, 0.9, -4.5), room=0.6, brisk=True),
    ]
    return stage


def _yard(rng: Rng) -> Material:
    kind = rng.random()
    if kind < 0.55:
        return materials.plaster(rng, (0.5, 0.49, 0.47))  # poured concrete
    return materials.ground(rng, (0.4, 0.39, 0.38), 0.6) if kind < 0.8 else materials.concrete(rng)


def _buildings(rng: Rng, stage: Stage) -> None:
    plastered = materials.plaster(rng, (0.66, 0.6, 0.5))
    wall = materials.brick(rng) if rng.random() < 0.6 else plastered
    roof = materials.plates(rng, (0.45, 0.47, 0.5))
    for x in (-9.0, -1.0, 8.0):
        width, height = rng.uniform(5.0, 8.5), rng.uniform(2.6, 5.5)
        stage.put(shapes.box(width, height, 4.0, 0.45), wall, placed(x, 0, -10.0))
        stage.put(shapes.box(width + 0.4, 0.15, 4.4, 0.5), roof, placed(x, height, -10.0))
    stage.put(shapes.panel(2.4, 1.6), materials.poster(rng), placed(rng.uniform(-3, 2), 0.9, -7.97))


def _fence(rng: Rng, stage: Stage) -> None:
    mesh = materials.fence(rng, int(rng.choice([4, 6, 8])))
    steel = materials.metal(rng, (0.55, 0.55, 0.56), 0.35)
    panel = shapes.wall(15.0, FENCE_HEIGHT, 0.7)
    stage.put(panel, mesh, placed(0.0, 0.05, 0.0))
    stage.put(panel, mesh, placed(7.5, 0.05, -7.5, yaw=np.pi / 2.0))
    post = shapes.cylinder(0.04, FENCE_HEIGHT + 0.5, 10)
    posts = [(post, placed(x, 0, 0)) for x in np.arange(-7.5, 7.6, 2.5)]
    rails = [shapes.tube([(-7.5, y, 0.0), (7.5, y, 0.0)], 0.022) for y in (0.1, FENCE_HEIGHT)]
    ends = [(x, y) for x in np.arange(-7.5, 7.0, 2.5) for y in (2.35, 2.5, 2.65)]
    barbs = [shapes.wire((x, y, 0.0), (x + 2.5, y, 0.0), 0.03, 0.006) for x, y in ends]
    stage.put([*posts, *rails, *barbs], steel)


def _power_lines(rng: Rng, stage: Stage) -> None:
    wood, cable = materials.planks(rng), materials.paint(rng, (0.06, 0.06, 0.06))
    z, tall = rng.uniform(-5.0, -3.0), rng.uniform(5.0, 6.5)
    poles, wires = [], []
    for x in (-10.0, -2.5, 5.0, 12.0):
        poles.append((shapes.cylinder(0.11, tall + 0.4, 10), placed(x, 0, z)))
        poles.append((shapes.box(0.1, 0.12, 1.8), placed(x, tall - 0.1, z)))
    for x in (-10.0, -2.5, 5.0):
        sag = rng.uniform(0.25, 0.6)
        wires += [shapes.wire((x, tall, z + k), (x + 7.5, tall, z + k), sag, 0.012) for k in (-0.8, 0, 0.8)]
    aerial = [shapes.tube([(x, 5.5, -9.0), (x + 0.02, 8.0, -9.0)], 0.015) for x in rng.uniform(-8, 8, 5)]
    stage.put(poles, wood)
    stage.put(wires + aerial, cable)


def _cargo(rng: Rng, stage: Stage) -> None:
    wood = materials.planks(rng)
    for _ in range(6):
        size = rng.uniform(0.5, 1.1)
        at = placed(rng.uniform(-6, 6), 0, rng.uniform(-6, -3), yaw=rng.uniform(0, 3))
        stage.put(shapes.box(size, size, size, 0.8), wood, at)
    drum = shapes.lathe([(0, 0), (0.3, 0), (0.3, 0.4), (0.32, 0.42), (0.3, 0.44), (0.3, 0.88), (0, 0.88)], 20)
    for _ in range(4):
        stage.put(drum, materials.paint(rng), placed(rng.uniform(-6, 6), 0, rng.uniform(-2.5, -1)))


def _cart(rng: Rng, stage: Stage, dark: bool) -> None:
    """Add a cart that drives to and fro behind the fence, its headlights and the lamp on its roof."""
    path = paths.swing(rng, (-5.5, 0.0, -2.2), (5.5, 0.0, -2.8), rng.uniform(2.0, 7.0))
    pose = paths.headed(path)
    body, tyres = materials.paint(rng), materials.paint(rng, (0.05, 0.05, 0.05), 0.2)
    hood, cabin = shapes.box(0.9, 0.5, 1.7), shapes.box(0.8, 0.7, 0.7)
    stage.put([(hood, placed(0, 0.3, 0)), (cabin, placed(0, 0.8, -0.3))], body, pose)
    wheel = shapes.torus(0.2, 0.1, 20)
    wheels = [(wheel, placed(x, 0.28, z) @ WHEEL) for x in (-0.5, 0.5) for z in (-0.55, 0.55)]
    stage.put(wheels, tyres, pose)
    stage.spot = lighting.spotlight(
        paths.point_of(pose, (0.0, 0.7, 0.95)), paths.point_of(pose, (0.0, 0.4, 5.0)),
        lighting.tint(rng, 160.0 if dark else 300.0, 0.2), pulsing=lighting.nervous(rng),
    )  # fmt: skip
    top, color = paths.point_of(pose, (0.0, 1.6, -0.3)), lighting.tint(rng, 9.0 if dark else 24.0, 0.9)
    bulb(stage, top, color, size=0.09, glow=8.0, reach=9.0, pulsing=lighting.pulse(rng, "strobe"))


def _lights(rng: Rng, stage: Stage, dark: bool) -> None:
    """Add lamps on the fence and over the yard; every other time a lamp swings there, with shadows."""
    strength = 9.0 if dark else 20.0
    for x, z in ((rng.uniform(-6, 6), 0.0), (-3.0, -5.6), (3.6, -5.6)):
        at = (x, 2.9, z)
        pulsing = lighting.maybe(rng, 0.7, lighting.nervous)
        color = lighting.tint(rng, strength * rng.uniform(0.6, 1.5), rng.uniform(-0.3, 0.7))
        bulb(stage, at, color, size=0.1, reach=10.0, pulsing=pulsing)
    if rng.random() < 0.5:
        pivot = (rng.uniform(-2.5, 2.5), 5.0, rng.uniform(-4.5, -3.2))
        color = lighting.tint(rng, strength * 9.0, 0.4)
        pulsing = lighting.maybe(rng, 0.4, lighting.nervous)
        place, stage.spot = lighting.hanging(rng, pivot, 1.6, rng.uniform(0.3, 0.9), color, pulsing=pulsing)
        glowing_ball(stage, place, 0.14, (1.0, 0.85, 0.6), 12.0)
