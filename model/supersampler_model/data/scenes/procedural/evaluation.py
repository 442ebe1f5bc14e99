"""Families of the test shots: machine_hall, market, night_garden, gallery, court."""

from itertools import pairwise

import numpy as np

from supersampler_model.data.scenes.procedural import lighting, materials, particles, paths, shapes
from supersampler_model.data.scenes.procedural.materials import one_of
from supersampler_model.data.scenes.procedural.outdoors import bush, meadow, tree
from supersampler_model.data.scenes.procedural.paths import placed, turned_by
from supersampler_model.data.scenes.procedural.stage import Stage, bulb, bunting, hills, skyline
from supersampler_model.data.scenes.scene import Material, Matrix, Rng


def machine_hall(rng: Rng) -> Stage:
    """Build a machine hall of pipes, grilles, pistons and beacons, in steam."""
    room = lighting.indoors(rng, (0.1, 0.09, 0.075), 10, 2.0)
    stage = Stage(environment=room, exposure=rng.uniform(1.3, 1.8))
    _shell(rng, stage)
    _pipes(rng, stage)
    _catwalk(rng, stage)
    for x in (-3.0, 0.2, 3.2):
        _machine(rng, stage, x + rng.uniform(-0.4, 0.4), rng.uniform(-4.0, -2.6))
    _machine_lights(rng, stage)
    stage.particles.append(particles.smoke(rng, (rng.uniform(-3, 3), 0.3, -4.0), grey=0.25))
    if rng.random() < 0.6:
        stage.particles.append(particles.sparks(rng, (rng.uniform(-3, 3), 1.6, -2.4), 90))
    stage.add_vantages(
        ((0.5, 1.7, 3.4), (0.0, 1.5, -3.0), 0.9), ((-4.0, 2.9, 2.0), (1.0, 1.0, -3.5), 0.8),
        ((3.6, 1.2, 1.6), (-1.5, 1.8, -4.0), 0.8),
    )  # fmt: skip
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
    gauge, pulsing = materials.poster(rng, 1.0), lighting.pulse(rng)
    stage.put(shapes.panel(0.5, 0.35), gauge, placed(x + 0.2, 0.45, z + 0.61), emission=pulsing)


def _machine_lights(rng: Rng, stage: Stage) -> None:
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


def market(rng: Rng) -> Stage:
    """Build a market street with awnings, fruit, bunting, lanterns and people, on a dusty afternoon."""
    sky = lighting.outdoors(rng, (0.18, 0.3, 0.55), (0.75, 0.62, 0.45), (0.2, 0.16, 0.11), clouds=0.7)
    stage = Stage(environment=sky, exposure=0.7)
    clouds = lighting.maybe(rng, 0.5, lighting.pulse, "fade")
    stage.sun = lighting.sunlight(
        rng, 5.5, 11.0, elevation=(35, 60), pulsing=clouds, warmth=0.45, center=(0, 0, -3)
    )
    paving = materials.brick(rng, 16) if rng.random() < 0.5 else materials.tiles(rng, 8, 0.1, 0.35)
    stage.put(shapes.plane(60.0, 60.0, 0.7), paving)
    skyline(rng, stage)
    _houses(rng, stage)
    woods = [materials.planks(rng) for _ in range(3)]
    for side in (-1.0, 1.0):
        for z in (-8.0, -5.0, -2.0, 1.0):
            _stall(rng, stage, side, z, one_of(rng, *woods))
    for z in (-6.0, -3.0, 0.5):
        left, right = (-3.4, rng.uniform(3.6, 4.6), z), (3.4, rng.uniform(3.6, 4.6), z)
        bunting(rng, stage, left, right, sag=0.5, cord=(0.008, 0.1), flags=18, margin=0.05, gap=0.11)
    for _ in range(int(rng.integers(5, 8))):
        _walker(rng, stage)
    _lanterns(rng, stage)
    motes = particles.dust(rng, (-2, 0, -8), (2, 3, 3), 110, size=0.015, color=(1.0, 0.85, 0.6), opacity=0.4)
    stage.particles.append(motes)
    if rng.random() < 0.6:
        stage.particles.append(particles.smoke(rng, (float(rng.choice([-1.9, 1.9])), 1.1, -2.0), grey=0.5))
    stage.add_vantages(
        ((0.4, 1.65, 4.0), (-0.2, 1.4, -4.0), 0.8), ((-0.8, 2.6, 3.2), (0.8, 1.0, -3.0), 0.7),
        ((0.8, 1.4, 1.0), (-1.8, 1.2, -3.5), 0.5),
    )  # fmt: skip
    return stage


def _houses(rng: Rng, stage: Stage) -> None:
    boards, shutter = materials.planks(rng, 16), shapes.box(0.1, 1.1, 0.4)
    for side in (-1.0, 1.0):
        z = 5.0
        while z > -16.0:
            width, height = rng.uniform(2.8, 5.0), rng.uniform(4.0, 7.0)
            plaster = materials.plaster(rng, materials.color(rng, 0.3, 0.7))
            middle = z - width / 2.0
            stage.put(shapes.box(3.0, height, width, 0.3), plaster, placed(side * 5.0, 0, middle))
            levels = np.arange(2.9, height - 1.2, 1.8)
            places = [placed(side * 3.5, y, middle + k * width) for y in levels for k in (-0.25, 0.25)]
            if places:
                stage.put([(shutter, at) for at in places], boards)
            z -= width
    stage.put(shapes.box(10.0, 9.0, 2.0, 0.4), materials.brick(rng), placed(0, 0, -18.0))


def _stall(rng: Rng, stage: Stage, side: float, z: float, wood: Material) -> None:
    x = side * 2.5
    leg = shapes.box(0.06, 2.1, 0.06)
    legs = [(leg, placed(x + a, 0, z + b)) for a in (-0.6, 0.6) for b in (-1.0, 1.0)]
    stage.put([(shapes.box(1.2, 0.08, 2.2, 0.8), placed(x, 0.8, z)), *legs], wood)
    awning = placed(x - side * 0.1, 2.15, z) @ turned_by(2, -side * 0.3)
    stage.put(shapes.plane(1.7, 2.5, 0.5), materials.striped(rng, 6), awning)
    fringe = shapes.merged([(shapes.wall(2.5, 0.25, 0.5), placed(yaw=np.pi / 2.0))])
    stage.put(fringe, materials.striped(rng, 8), placed(x - side * 0.9, 1.68, z))
    for k in (-0.7, 0.0, 0.7):
        stage.put(shapes.box(0.9, 0.18, 0.6, 1.0), wood, placed(x, 0.88, z + k))
        _heap(rng, stage, x, z + k)


def _heap(rng: Rng, stage: Stage, x: float, z: float) -> None:
    fruit, kind = shapes.ball(0.075, 4), rng.random()
    grid = np.array([(a, b) for a in np.arange(-0.36, 0.37, 0.16) for b in np.arange(-0.2, 0.21, 0.14)])
    spots = grid + rng.normal(0, 0.01, grid.shape)
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
    skin = one_of(rng, (0.75, 0.55, 0.42), (0.5, 0.34, 0.24), (0.85, 0.68, 0.56))
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


def night_garden(rng: Rng) -> Stage:
    """Build a garden at night with hedges, a pond, lanterns in the wind and fireflies."""
    sky = lighting.outdoors(rng, (0.008, 0.012, 0.035), (0.03, 0.035, 0.06), (0.01, 0.012, 0.008), clouds=0.6)
    stage = Stage(environment=sky, exposure=rng.uniform(1.7, 2.4))
    stage.sun = lighting.sunlight(rng, 0.22, 11.0, elevation=(25, 50), warmth=-0.7, center=(0, 0, -2))
    green = one_of(rng, (0.2, 0.36, 0.16), (0.24, 0.32, 0.2), (0.3, 0.36, 0.12))
    stage.put(shapes.plane(70.0, 70.0, 0.5), materials.ground(rng, (0.24, 0.26, 0.16), 0.7))
    hills(rng, stage, (0.16, 0.2, 0.14))
    _paths_and_pond(rng, stage)
    for side in (-1.0, 1.0):
        low = (side * 3.0 - 1.4, -6.0)
        meadow(rng, stage, green, low, (low[0] + 2.8, 2.5), 900)
        tree(rng, stage, (side * rng.uniform(3.2, 4.5), rng.uniform(-6, -3)), green, 0.08)
    for x, z in ((-1.8, -3.8), (1.9, -4.6), (-3.4, 0.2), (3.2, -0.8)):
        bush(rng, stage, (x + rng.normal(0, 0.2), z), 0.12)
    _hedge(rng, stage)
    _pavilion(rng, stage)
    _garden_lights(rng, stage)
    stage.particles.append(particles.fireflies(rng, (-4, 0.2, -5), (4, 1.8, 3), 35))
    if rng.random() < 0.5:
        stage.particles.append(particles.smoke(rng, (0.0, 0.1, -1.6), 18, grey=0.04, rise=0.4))
    stage.add_vantages(
        ((0.6, 1.6, 4.2), (0.0, 0.9, -3.0), 0.9), ((-2.6, 1.2, 2.6), (1.0, 0.9, -3.0), 0.7),
        ((1.8, 2.2, 3.0), (-0.6, 0.6, -2.5), 0.8),
    )  # fmt: skip
    return stage


def _paths_and_pond(rng: Rng, stage: Stage) -> None:
    stage.put(shapes.plane(1.3, 14.0, 0.8), materials.tiles(rng, 6, 0.3, 0.3), placed(0, 0.02, 1.0))
    water = materials.metal(rng, (0.12, 0.15, 0.17), 0.06, 0.03)
    stage.put(shapes.lathe([(1.5, 0.0), (0.0, 0.001)], 40), water, placed(0, 0.05, -2.6))
    stage.put(shapes.torus(1.55, 0.12, 40), materials.concrete(rng), placed(0, 0.04, -2.6))
    lily = shapes.lathe([(0.14, 0.0), (0.0, 0.004)], 12)
    pads = [(lily, placed(x, 0.06, z)) for x, z in rng.uniform((-1, -3.5), (1, -1.8), (7, 2))]
    stage.put(pads, materials.ground(rng, (0.25, 0.45, 0.2), 1.0))


def _hedge(rng: Rng, stage: Stage) -> None:
    leaves = materials.foliage(rng, (0.18, 0.34, 0.16), 9)
    for side in (-1.0, 1.0):
        tips = np.stack([np.full(24, side * 5.0), rng.uniform(0.3, 1.3, 24), np.linspace(-7.0, 2.0, 24)], 1)
        groups = np.repeat(np.arange(24), 16)
        centers = tips[groups] + rng.normal(0.0, 1.0, (len(groups), 3)) * (0.2, 0.35, 0.2)
        mesh = shapes.cards(rng, centers, groups, 0.3, np.array([side * 5.6, 0.0, -2.5]))
        stage.put(mesh, leaves, palette=paths.wind(rng, tips, 0.05))


def _pavilion(rng: Rng, stage: Stage) -> None:
    stone, roof = materials.concrete(rng), materials.planks(rng)
    column = shapes.lathe([(0.16, 0), (0.16, 0.1), (0.1, 0.2), (0.085, 2.0), (0.15, 2.15), (0.15, 2.25)], 16)
    around = [0.5 + k * np.pi / 3.0 for k in range(6)]
    columns = [(column, placed(1.5 * np.sin(a), 0.2, -6.0 + 1.5 * np.cos(a))) for a in around]
    base, ring = shapes.cylinder(1.9, 0.2, 32), shapes.torus(1.5, 0.12, 32)
    stage.put([*columns, (base, placed(0, 0, -6.0)), (ring, placed(0, 2.5, -6.0))], stone)
    stage.put(shapes.lathe([(1.9, 2.5), (1.0, 3.1), (0.15, 3.4), (0.0, 3.7)], 24), roof, placed(0, 0, -6.0))
    lattice = materials.grille(rng, 8, 8, 0.22, (0.75, 0.73, 0.68))
    for side in (-1.0, 1.0):
        stage.put(shapes.wall(1.6, 1.6, 0.8), lattice, placed(side * 2.6, 0, -4.9, yaw=-0.5 * side))


def _garden_lights(rng: Rng, stage: Stage) -> None:
    for x, z in ((-1.0, 1.4), (1.0, 0.0), (-1.0, -4.6), (1.2, -4.4)):
        pole = shapes.tube([(x, 0, z), (x, 1.7, z), (0.75 * x, 1.8, z)], 0.025, 8)
        stage.put(pole, materials.paint(rng, (0.08, 0.09, 0.08)))
        sway = paths.together((0.75 * x, 1.55, z), paths.drift(rng, 0.06, 1.2))
        kind = str(rng.choice(["throb", "flicker", "fade"]))
        light = lighting.tint(rng, rng.uniform(3, 6), 0.8)
        bulb(stage, sway, light, size=0.09, pulsing=lighting.pulse(rng, kind))
    for hue in (None, None, 0.9):
        middle, width = (0, rng.uniform(0.5, 1.6), -2.6), rng.uniform(1.5, 2.6)
        path = paths.circuit(rng, middle, (width, 1.6), rng.uniform(1.5, 4))
        bulb(stage, path, lighting.tint(rng, 3.0, hue), size=0.05, pulsing=lighting.pulse(rng, "throb"))
    bulb(stage, (0.0, 2.0, -6.0), lighting.tint(rng, 7.0, 0.7), size=0.12, reach=7.0)
    torch = paths.swing(rng, (-2.5, 1.5, 2.5), (2.5, 1.6, 2.0), rng.uniform(1.0, 3.0))
    aim = paths.swing(rng, (-3.0, 0.4, -4.0), (3.0, 0.8, -4.0), rng.uniform(2.0, 6.0))
    stage.spot = lighting.spotlight(torch, aim, lighting.tint(rng, 45.0, -0.1), outer=26.0)
    moth = shapes.ball(0.03, 6)
    for _ in range(4):
        home = (rng.uniform(-1.2, 1.2), 1.5, rng.uniform(-4.5, 1.0))
        stage.put(moth, materials.cloth(rng), paths.upright(paths.together(home, paths.drift(rng, 0.5, 1.5))))


def gallery(rng: Rng) -> Stage:
    """Build a gallery with a polished floor, sculptures, paintings and mobiles that turn."""
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
    _gallery_lights(rng, stage)
    if rng.random() < 0.4:
        stage.particles.append(particles.dust(rng, (-3, 0.5, -6), (3, 3, 2), opacity=0.25))
    stage.add_vantages(
        ((0.3, 1.6, 3.6), (-0.1, 1.2, -3.0), 0.9), ((-3.2, 1.3, 1.8), (1.5, 1.0, -3.6), 0.8),
        ((3.2, 0.8, 1.2), (-1.2, 1.2, -3.6), 0.7),
    )  # fmt: skip
    return stage


def _rooms(rng: Rng, stage: Stage, bright: bool) -> None:
    marble = materials.tiles(rng, 4, 1.0, 0.2) if rng.random() < 0.6 else materials.planks(rng, 12, 1.0)
    stage.put(shapes.plane(14.0, 24.0, 0.5), marble, placed(0, 0, -3))
    plaster = materials.plaster(rng, (0.82, 0.81, 0.78) if bright else (0.3, 0.16, 0.16))
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
    bar, cord = (
        shapes.tube([(-1.1, 0, 0), (1.1, 0, 0)], 0.01, 6),
        shapes.tube([(0, 0, 0), (0, 1.4, 0)], 0.006, 5),
    )
    stage.put([bar, cord], materials.paint(rng, (0.08, 0.08, 0.08)), turning)
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


def _gallery_lights(rng: Rng, stage: Stage) -> None:
    sweep = paths.swing(rng, (-2.5, 0.8, -5.0), (2.5, 0.8, -1.0), rng.uniform(1.5, 5.0))
    head, pulsing = (rng.uniform(-2, 2), 4.0, 0.5), lighting.pulse(rng, "throb", "fade")
    stage.spot = lighting.spotlight(head, sweep, lighting.tint(rng, 85.0, 0.25), outer=28.0, pulsing=pulsing)
    for x, z in ((-3.4, -1.0), (3.4, -2.0), (0.0, -4.5), (-3.4, -6.0), (3.4, -6.5)):
        pulsing = lighting.maybe(rng, 0.5, lighting.pulse)
        bulb(stage, (x, 3.95, z), lighting.tint(rng, 9.0, 0.3), reach=7.0, pulsing=pulsing)
    orb = paths.circuit(rng, (0, 1.3, -3.0), (1.6, 2.0), rng.uniform(1.5, 5.0))
    bulb(stage, orb, lighting.tint(rng, 4.0), size=0.09, pulsing=lighting.pulse(rng))


def court(rng: Rng) -> Stage:
    """Build a sports court with nets, fast balls and dummies of players, by day or under floodlights."""
    night = rng.random() < 0.5
    if night:
        sky = lighting.outdoors(rng, (0.01, 0.015, 0.04), (0.05, 0.05, 0.09), (0.02, 0.02, 0.02))
        stage = Stage(environment=sky, exposure=1.5)
    else:
        sky = lighting.outdoors(rng, (0.14, 0.3, 0.7), (0.5, 0.62, 0.8), (0.12, 0.13, 0.12), clouds=1.1)
        stage = Stage(environment=sky, exposure=0.7)
        clouds = lighting.maybe(rng, 0.5, lighting.pulse, "fade")
        stage.sun = lighting.sunlight(rng, 5.2, 12.0, elevation=(30, 60), pulsing=clouds, center=(0, 0, -3))
    skyline(rng, stage)
    _ground(rng, stage)
    _nets(rng, stage)
    _stands(rng, stage)
    _balls(rng, stage)
    _players(rng, stage)
    _floodlights(rng, stage, night)
    if rng.random() < 0.4:
        stage.particles.append(particles.dust(rng, (-4, 0, -6), (4, 2, 3)))
    stage.add_vantages(
        ((0.8, 1.7, 4.6), (0.0, 1.0, -3.0), 1.2), ((-4.4, 1.3, 2.0), (1.0, 0.9, -3.5), 1.0),
        ((3.8, 2.8, 3.6), (-0.8, 0.4, -3.0), 1.2),
    )  # fmt: skip
    return stage


def _ground(rng: Rng, stage: Stage) -> None:
    one = one_of(rng, (0.2, 0.35, 0.55), (0.55, 0.25, 0.18), (0.22, 0.42, 0.3))
    other = (one[2], one[0], one[1])
    stage.put(shapes.plane(60.0, 60.0, 0.5), materials.ground(rng, (0.33, 0.33, 0.33), 0.6))
    stage.put(shapes.box(13.0, 0.03, 15.0, 0.6), materials.ground(rng, other, 0.5, 1.0), placed(0, 0, -3))
    stage.put(shapes.box(8.0, 0.02, 11.0, 0.6), materials.ground(rng, one, 0.5, 1.0), placed(0, 0.03, -3))
    lines = [(shapes.plane(0.06, 11.0), placed(x, 0.062, -3)) for x in (-4.0, -3.0, 0.0, 3.0, 4.0)]
    lines += [(shapes.plane(8.0, 0.06), placed(0, 0.061, z)) for z in (-8.5, -6.0, 0.0, 2.5)]
    lines.append((shapes.lathe([(1.26, 0.0), (1.2, 0.0005)], 48), placed(0, 0.06, -3.0)))
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
    stage.put(shapes.wall(16.0, 3.2, 0.6), materials.fence(rng, 10), placed(0, 0, -10.2))
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


def _floodlights(rng: Rng, stage: Stage, night: bool) -> None:
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
