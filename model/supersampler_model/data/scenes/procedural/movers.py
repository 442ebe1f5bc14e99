"""Training family: a street where vans and drones rush past the camera and disocclude the background."""

import numpy as np

from supersampler_model.data.scenes.mesh import Mesh
from supersampler_model.data.scenes.procedural import lighting, materials, paths, shapes, textures
from supersampler_model.data.scenes.procedural.casters import caster
from supersampler_model.data.scenes.procedural.fixtures import WHEEL, bulb, skyline
from supersampler_model.data.scenes.procedural.particles import dust, smoke
from supersampler_model.data.scenes.procedural.stage import Stage
from supersampler_model.data.scenes.procedural.transforms import placed
from supersampler_model.data.scenes.scene import Material
from supersampler_model.data.values import Rng


def movers(rng: Rng) -> Stage:
    """Build the street, at any hour."""
    weather = lighting.weather(rng, 13.0, (0.0, 0.0, -3.0))
    stage = Stage(environment=weather.environment, exposure=weather.exposure, sun=weather.sun)
    _street(rng, stage, 1.5 if weather.dark else 0.4)
    skyline(rng, stage)
    for _ in range(int(rng.integers(2, 4))):
        _van(rng, stage)
    for _ in range(int(rng.integers(2, 5))):
        _drone(rng, stage, weather.dark)
    _lights(rng, stage, weather.dark)
    if not weather.dark and rng.random() < 0.6:
        caster(rng, stage, weather.sun)
    if rng.random() < 0.4:
        stage.particles.append(smoke(rng, (rng.uniform(-4, 4), 0.0, -4.8)))
    if rng.random() < 0.3:
        stage.particles.append(dust(rng, (-5, 0, -4), (5, 2, 3)))
    stage.vantages += [
        paths.Vantage(position=(-1.0, 1.6, 5.2), target=(0.5, 1.5, -5.0), room=1.2, brisk=True),
        paths.Vantage(position=(-5.5, 1.9, 3.0), target=(2.5, 1.2, -4.0), room=1.2, brisk=True),
        paths.Vantage(position=(5.0, 1.1, 4.2), target=(-1.0, 1.6, -4.5), room=1.0, brisk=True),
        paths.Vantage(position=(-7.5, 1.7, -5.9), target=(4.0, 1.3, -4.2), room=0.6, brisk=True),
        paths.Vantage(position=(3.0, 4.4, 4.0), target=(-0.8, 0.4, -3.5), room=1.2, brisk=True),
        paths.Vantage(position=(0.8, 0.6, 3.4), target=(-1.5, 1.4, -5.0), room=0.8, brisk=True),
    ]
    return stage


def _street(rng: Rng, stage: Stage, shine: float) -> None:
    worn = materials.ground(rng, (0.3, 0.3, 0.31), 0.6)
    road = worn if rng.random() < 0.5 else materials.plaster(rng, (0.36, 0.36, 0.37))
    stage.put(shapes.plane(60.0, 60.0, 0.4), road)
    stage.put(shapes.box(60.0, 0.15, 3.0, 0.6), materials.tiles(rng, 8, 0.1, 0.25), placed(0, 0, -6.2))
    paint = materials.ground(rng, (0.8, 0.78, 0.7), 0.6)
    stage.put([(shapes.plane(1.6, 0.14), placed(x, 0.012, -1.3)) for x in range(-18, 20, 4)], paint)
    x = -17.0
    while x < 16.0:
        width, height = rng.uniform(3.5, 6.0), rng.uniform(4.0, 8.0)
        front = _wall(rng)
        stage.put(shapes.box(width, height, 5.0, 0.5), front, placed(x + width / 2.0, 0, -10.1))
        _front(rng, stage, x + width / 2.0, width, height, shine)
        x += width + float(rng.choice([0.0, 0.0, 1.5]))
    rails = [shapes.tube([(-12, y, -4.8), (12, y, -4.8)], 0.02, 6) for y in (0.5, 0.95)]
    posts = [(shapes.cylinder(0.03, 1.1, 8), placed(x, 0, -4.8)) for x in np.arange(-12.0, 12.1, 1.5)]
    stage.put([*rails, *posts], materials.paint(rng))


def _wall(rng: Rng) -> Material:
    kind = rng.random()
    if kind < 0.4:
        return materials.brick(rng)
    return materials.planks(rng) if kind < 0.6 else materials.plaster(rng, textures.color(rng, 0.3, 0.6))


def _front(rng: Rng, stage: Stage, x: float, width: float, height: float, shine: float) -> None:
    frames, panes = [], []
    for y in np.arange(0.9, height - 1.5, 2.1):
        for k in np.arange(x - width / 2.0 + 0.9, x + width / 2.0 - 0.5, 1.5):
            frames.append((shapes.box(1.0, 1.35, 0.12), placed(k, y, -7.6)))
            panes.append((shapes.wall(0.8, 1.15), placed(k, y + 0.1, -7.53)))
    if frames:
        stage.put(frames, materials.paint(rng, (0.85, 0.83, 0.78), 0.3))
        stage.put(panes, materials.metal(rng, (0.25, 0.28, 0.32), 0.08))
    if rng.random() < 0.6:
        sign = materials.poster(rng, shine if rng.random() < 0.6 else 0.0)
        pulsing = lighting.maybe(rng, 0.4, lighting.pulse)
        stage.put(shapes.panel(1.6, 0.8), sign, placed(x, rng.uniform(1.9, 2.6), -7.42), emission=pulsing)


def _van(rng: Rng, stage: Stage) -> None:
    z, speed = rng.uniform(-3.5, 1.2), rng.uniform(4.0, 12.0)
    pose = paths.headed(paths.swing(rng, (-9.0, 0.0, z), (9.0, 0.0, z), speed))
    stage.put(_van_body(rng), materials.paint(rng, gloss=0.9), pose)
    stage.put(_van_glass(), materials.metal(rng, (0.2, 0.22, 0.25), 0.08), pose)
    for side in (-0.86, 0.86):
        sign = placed(side, 0.8, -0.6, yaw=np.sign(side) * np.pi / 2.0)
        stage.put(shapes.panel(1.8, 0.8), materials.poster(rng), paths.attached(pose, sign))
    wheel = shapes.merged((shapes.torus(0.24, 0.12, 20), placed(x) @ WHEEL) for x in (-0.78, 0.78))
    rubber = materials.paint(rng, (0.06, 0.06, 0.06), 0.2)
    for z_axle in (-1.1, 1.2):
        stage.put(wheel, rubber, paths.attached(pose, placed(0, 0.36, z_axle)))


def _van_body(rng: Rng) -> Mesh:
    tall = rng.uniform(1.3, 1.8)
    box, hood, floor = shapes.box(1.7, tall, 2.6), shapes.box(1.66, 0.7, 1.3), shapes.box(1.6, 0.15, 4.1)
    return shapes.merged([(box, placed(0, 0.4, -0.6)), (hood, placed(0, 0.4, 1.2)), (floor, placed(0, 0.3))])


def _van_glass() -> Mesh:
    return shapes.merged([(shapes.box(1.5, 0.5, 0.7), placed(0, 1.1, 0.95))])


def _drone(rng: Rng, stage: Stage, dark: bool) -> None:
    home = (rng.uniform(-1.5, 1.5), rng.uniform(1.2, 2.8), rng.uniform(-2.5, 1.5))
    path = paths.circuit(rng, home, (rng.uniform(1.5, 4), 1.2), rng.uniform(3.0, 9.0))
    shake = paths.drift(rng, 0.15, 1.0)
    pose = paths.attached(paths.headed(paths.together(path, shake)), placed(size=rng.uniform(0.8, 1.6)))
    arms = [shapes.tube([(0, 0, 0), (x, 0.05, z)], 0.02, 6) for x in (-0.3, 0.3) for z in (-0.3, 0.3)]
    body, eye = shapes.box(0.22, 0.12, 0.34), shapes.ball(0.08, 8)
    stage.put([*arms, (body, placed(0, -0.06)), (eye, placed(0, -0.08, 0.12))], materials.paint(rng), pose)
    blade, black = shapes.box(0.36, 0.01, 0.03), materials.paint(rng, (0.1, 0.1, 0.1))
    for x in (-0.3, 0.3):
        for z in (-0.3, 0.3):
            spin = paths.spinning(placed(x, 0.06, z), (0, 1, 0), rng.uniform(25.0, 60.0))
            stage.put(blade, black, paths.attached(pose, spin))
    pulsing = lighting.pulse(rng, "strobe")
    color = lighting.tint(rng, rng.uniform(3, 7) * (1.0 if dark else 2.0))
    below = paths.together(path, shake, (0.0, -0.2, 0.0))
    stage.points.append(lighting.lamp(below, color, reach=5.0, pulsing=pulsing))


def _lights(rng: Rng, stage: Stage, dark: bool) -> None:
    """Add a light that sweeps over the street or drives along it, and street lamps."""
    color = lighting.tint(rng, rng.uniform(140.0, 260.0) * (1.0 if dark else 2.2), 0.2)
    pulsing = lighting.maybe(rng, 0.6, lighting.nervous)
    if rng.random() < 0.5:
        sweep = paths.swing(rng, (-5.0, 0.0, -4.0), (5.0, 1.5, -6.0), rng.uniform(4.0, 16.0))
        mast = (rng.uniform(-3, 3), 6.0, 2.5)
        stage.spot = lighting.spotlight(mast, sweep, color, outer=24.0, reach=24.0, pulsing=pulsing)
    else:  # headlights that come round a corner: behind what they meet shadows run over the fronts
        place = paths.swing(rng, (-9.0, 0.9, 6.0), (9.0, 0.9, 7.0), rng.uniform(4.0, 14.0))
        ahead = paths.swing(rng, (-4.0, 1.0, -6.0), (4.0, 1.0, -6.0), rng.uniform(2.0, 8.0))
        stage.spot = lighting.spotlight(place, ahead, color, outer=30.0, reach=28.0, pulsing=pulsing)
    for x in (-6.0, 0.0, 6.0):
        flickers = lighting.maybe(rng, 0.5, lighting.pulse, "flicker")
        head, glow = (x, 3.7, -5.0), lighting.tint(rng, 10.0 if dark else 16.0, 0.6)
        bulb(stage, head, glow, size=0.14, reach=9.0, pulsing=flickers)
        stage.put(shapes.cylinder(0.05, 3.6, 8), materials.paint(rng, (0.15, 0.15, 0.16)), placed(x, 0, -5.0))
