"""Family of the test shots: a market street with awnings, fruit, bunting, lanterns and walking people."""

import numpy as np

from supersampler_model.data.scenes.procedural import lighting, materials, paths, shapes
from supersampler_model.data.scenes.procedural.fixtures import bulb, bunting, skyline
from supersampler_model.data.scenes.procedural.particles import dust, smoke
from supersampler_model.data.scenes.procedural.stage import Stage
from supersampler_model.data.scenes.procedural.textures import color
from supersampler_model.data.scenes.procedural.transforms import placed, turned_by
from supersampler_model.data.scenes.scene import Material
from supersampler_model.data.values import Matrix, Rng


def market(rng: Rng) -> Stage:
    """Build the street on a dusty afternoon."""
    sky = lighting.outdoors(rng, (0.18, 0.3, 0.55), (0.75, 0.62, 0.45), (0.2, 0.16, 0.11), clouds=0.7)
    stage = Stage(environment=sky, exposure=0.7)
    clouds = lighting.maybe(rng, 0.5, lighting.pulse, "fade")
    stage.sun = lighting.sunlight(
        rng, 5.5, 11.0, elevation=(35, 60), pulsing=clouds, warmth=0.45, center=(0, 0, -3)
    )
    stage.put(shapes.plane(60.0, 60.0, 0.7), _paving(rng))
    skyline(rng, stage)
    _houses(rng, stage)
    woods = [materials.planks(rng) for _ in range(3)]
    for side in (-1.0, 1.0):
        for z in (-8.0, -5.0, -2.0, 1.0):
            _stall(rng, stage, side, z, woods[int(rng.integers(3))])
    for z in (-6.0, -3.0, 0.5):
        left, right = (-3.4, rng.uniform(3.6, 4.6), z), (3.4, rng.uniform(3.6, 4.6), z)
        bunting(rng, stage, left, right, sag=0.5, cord=(0.008, 0.1), flags=18, margin=0.05, gap=0.11)
    for _ in range(int(rng.integers(5, 8))):
        _walker(rng, stage)
    _lanterns(rng, stage)
    stage.particles.append(
        dust(rng, (-2, 0, -8), (2, 3, 3), 110, size=0.015, color=(1.0, 0.85, 0.6), opacity=0.4)
    )
    if rng.random() < 0.6:
        stage.particles.append(smoke(rng, (float(rng.choice([-1.9, 1.9])), 1.1, -2.0), grey=0.5))
    stage.vantages += [
        paths.Vantage(position=(0.4, 1.65, 4.0), target=(-0.2, 1.4, -4.0), room=0.8),
        paths.Vantage(position=(-0.8, 2.6, 3.2), target=(0.8, 1.0, -3.0), room=0.7),
        paths.Vantage(position=(0.8, 1.4, 1.0), target=(-1.8, 1.2, -3.5), room=0.5),
    ]
    return stage


def _paving(rng: Rng) -> Material:
    return materials.brick(rng, 16) if rng.random() < 0.5 else materials.tiles(rng, 8, 0.1, 0.35)


def _houses(rng: Rng, stage: Stage) -> None:
    boards, shutter = materials.planks(rng, 16), shapes.box(0.1, 1.1, 0.4)
    for side in (-1.0, 1.0):
        z = 5.0
        while z > -16.0:
            width, height = rng.uniform(2.8, 5.0), rng.uniform(4.0, 7.0)
            plaster = materials.plaster(rng, color(rng, 0.3, 0.7))
            middle = z - width / 2.0
            stage.put(shapes.box(3.0, height, width, 0.3), plaster, placed(side * 5.0, 0, middle))
            shutters = []
            for y in np.arange(2.9, height - 1.2, 1.8):
                for k in (-0.25, 0.25):
                    shutters.append((shutter, placed(side * 3.5, y, middle + k * width)))
            if shutters:
                stage.put(shutters, boards)
            z -= width
    stage.put(shapes.box(10.0, 9.0, 2.0, 0.4), materials.brick(rng), placed(0, 0, -18.0))


def _stall(rng: Rng, stage: Stage, side: float, z: float, wood: Material) -> None:
    x = side * 2.5
    frame = [(shapes.box(1.2, 0.08, 2.2, 0.8), placed(x, 0.8, z))]
    leg = shapes.box(0.06, 2.1, 0.06)
    frame += [(leg, placed(x + a, 0, z + b)) for a in (-0.6, 0.6) for b in (-1.0, 1.0)]
    stage.put(frame, wood)
    awning = placed(x - side * 0.1, 2.15, z) @ turned_by(2, -side * 0.3)
    stage.put(shapes.plane(1.7, 2.5, 0.5), materials.striped(rng, 6), awning)
    fringe = shapes.merged([(shapes.wall(2.5, 0.25, 0.5), placed(yaw=np.pi / 2.0))])
    stage.put(fringe, materials.striped(rng, 8), placed(x - side * 0.9, 1.68, z))
    for k in (-0.7, 0.0, 0.7):
        crate = shapes.box(0.9, 0.18, 0.6, 1.0)
        stage.put(crate, wood, placed(x, 0.88, z + k))
        _heap(rng, stage, x, z + k)


def _heap(rng: Rng, stage: Stage, x: float, z: float) -> None:
    fruit, kind = shapes.ball(0.075, 4), rng.random()
    spots = [
        (a + rng.normal(0, 0.01), b + rng.normal(0, 0.01)) for a in np.arange(-0.36, 0.37, 0.16)
        for b in np.arange(-0.2, 0.21, 0.14)
    ]  # fmt: skip
    parts = [(fruit, placed(x + a, 1.1 - 0.25 * a * np.sign(x), z + b)) for a, b in spots]
    hue = ((0.8, 0.25, 0.1), (0.85, 0.6, 0.1), (0.35, 0.6, 0.15), (0.6, 0.1, 0.2))[int(kind * 4)]
    stage.put(parts, materials.ground(rng, hue, 0.8, 0.5))


def _walker(rng: Rng, stage: Stage) -> None:
    lane, speed = rng.uniform(-1.3, 1.3), rng.uniform(1.2, 4.0)
    way = paths.swing(rng, (lane, 0.0, -9.0), (lane, 0.0, 2.0), speed)
    pose = paths.headed(paths.bounces(rng, way, 0.025, 0.0))
    coat = shapes.lathe(
        [(0.2, 0.35), (0.23, 0.6), (0.17, 1.05), (0.23, 1.35), (0.1, 1.5), (0.07, 1.52)], 16, smooth=True
    )
    stage.put(coat, materials.cloth(rng), pose)
    skin = ((0.75, 0.55, 0.42), (0.5, 0.34, 0.24), (0.85, 0.68, 0.56))[int(rng.integers(3))]
    stage.put([(shapes.ball(0.12, 10), placed(0, 1.63, 0))], materials.plaster(rng, skin), pose)
    hat = shapes.lathe([(0.0, 1.69), (0.2, 1.69), (0.2, 1.7), (0.12, 1.71), (0.11, 1.82), (0.0, 1.83)], 16)
    stage.put(hat, materials.cloth(rng), pose)
    stride = 2.0 * speed
    leg, trousers = shapes.tube([(0, -0.75, 0), (0, 0, 0)], 0.075, 8), materials.cloth(rng, (0.2, 0.2, 0.28))
    for side in (-1.0, 1.0):

        def step(t: float, side: float = side) -> Matrix:
            return placed(0.1 * side, 0.78, 0) @ turned_by(0, 0.5 * side * float(np.sin(stride * t)))

        stage.put(leg, trousers, paths.attached(pose, step))


def _lanterns(rng: Rng, stage: Stage) -> None:
    cart = paths.swing(rng, (-1.4, 2.6, -6.0), (1.4, 2.9, 1.0), rng.uniform(1.5, 4.0))
    for z in (-5.0, -1.0):
        for side in (-1.6, 1.6):
            pulsing = lighting.pulse(rng)
            bulb(stage, (side, 1.85, z), lighting.tint(rng, 5.0, 0.8), size=0.1, reach=4.0, pulsing=pulsing)
    bulb(stage, cart, lighting.tint(rng, 8.0), size=0.09, reach=6.0, pulsing=lighting.pulse(rng, "strobe"))
    door = (float(rng.choice([-3.2, 3.2])), 3.0, rng.uniform(-6, -1))
    stage.spot = lighting.spotlight(
        door, paths.swing(rng, (-1, 0, -6), (1, 0, 0), 4.0), lighting.tint(rng, 60.0, 0.5),
        outer=35.0, pulsing=lighting.pulse(rng),
    )  # fmt: skip
