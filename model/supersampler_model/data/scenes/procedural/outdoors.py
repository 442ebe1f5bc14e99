"""Outdoor training families: fences, movers, foliage."""

import numpy as np

from supersampler_model.data.scenes.procedural import lighting, materials, particles, paths, shapes
from supersampler_model.data.scenes.procedural.materials import one_of
from supersampler_model.data.scenes.procedural.paths import placed, turned_by
from supersampler_model.data.scenes.procedural.stage import (
    CASTERS,
    WHEEL,
    Stage,
    bulb,
    caster,
    glowing_ball,
    hills,
    skyline,
)
from supersampler_model.data.scenes.scene import Color, Material, Rng, Values

FENCE_HEIGHT = 2.2


def fences(rng: Rng) -> Stage:
    """Build a yard under power lines, at any hour: wires, poles, and a moving cart behind chain-link."""
    weather = lighting.weather(rng, 14.0)
    stage = Stage(environment=weather.environment, exposure=weather.exposure, sun=weather.sun)
    stage.put(shapes.plane(50.0, 50.0, 0.4), _yard(rng))
    _buildings(rng, stage)
    skyline(rng, stage)
    _fence(rng, stage)
    _power_lines(rng, stage)
    _cargo(rng, stage)
    _cart(rng, stage, weather.dark)
    _yard_lights(rng, stage, weather.dark)
    if not weather.dark and rng.random() < 0.85:
        caster(rng, stage, weather.sun)
    if rng.random() < 0.4:
        stage.particles.append(particles.dust(rng, (-6, 0, -5), (6, 3, 4)))
    side = rng.uniform(2.0, 4.5)
    stage.add_vantages(
        ((side, 1.6, 5.0), (-0.5, 1.3, -2.0), 1.3), ((-4.5, 1.2, 2.6), (1.0, 1.4, -2.5), 1.0),
        ((0.5, 1.0, 4.0), (0.0, 3.2, -4.0), 1.0), ((-6.8, 1.7, -1.2), (3.0, 0.7, -3.4), 0.7),
        ((2.5, 3.4, 3.6), (-0.5, 0.3, -2.5), 1.2), ((-1.0, 1.4, 1.7), (0.6, 0.9, -4.5), 0.6),
        brisk=True,
    )  # fmt: skip
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
    pole, arm = shapes.cylinder(0.11, tall + 0.4, 10), shapes.box(0.1, 0.12, 1.8)
    poles, wires = [], []
    for x in (-10.0, -2.5, 5.0, 12.0):
        poles += [(pole, placed(x, 0, z)), (arm, placed(x, tall - 0.1, z))]
    for x in (-10.0, -2.5, 5.0):
        sag = rng.uniform(0.25, 0.6)
        wires += [shapes.wire((x, tall, z + k), (x + 7.5, tall, z + k), sag, 0.012) for k in (-0.8, 0, 0.8)]
    aerial = [shapes.tube([(x, 5.5, -9.0), (x + 0.02, 8.0, -9.0)], 0.015) for x in rng.uniform(-8, 8, 5)]
    stage.put(poles, wood)
    stage.put(wires + aerial, cable)


def _cargo(rng: Rng, stage: Stage) -> None:
    wood = materials.planks(rng)
    for size in (rng.uniform(0.5, 1.1) for _ in range(6)):
        at = placed(rng.uniform(-6, 6), 0, rng.uniform(-6, -3), yaw=rng.uniform(0, 3))
        stage.put(shapes.box(size, size, size, 0.8), wood, at)
    drum = shapes.lathe([(0, 0), (0.3, 0), (0.3, 0.4), (0.32, 0.42), (0.3, 0.44), (0.3, 0.88), (0, 0.88)], 20)
    for _ in range(4):
        stage.put(drum, materials.paint(rng), placed(rng.uniform(-6, 6), 0, rng.uniform(-2.5, -1)))


def _cart(rng: Rng, stage: Stage, dark: bool) -> None:
    """Add a cart that drives back and forth behind the fence, its headlights and the lamp on its roof."""
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


def _yard_lights(rng: Rng, stage: Stage, dark: bool) -> None:
    """Add lamps on the fence and over the yard; every other time a lamp swings there, with shadows."""
    strength = 9.0 if dark else 20.0
    for x, z in ((rng.uniform(-6, 6), 0.0), (-3.0, -5.6), (3.6, -5.6)):
        pulsing = lighting.maybe(rng, 0.7, lighting.nervous)
        color = lighting.tint(rng, strength * rng.uniform(0.6, 1.5), rng.uniform(-0.3, 0.7))
        bulb(stage, (x, 2.9, z), color, size=0.1, reach=10.0, pulsing=pulsing)
    if rng.random() < 0.5:
        pivot = (rng.uniform(-2.5, 2.5), 5.0, rng.uniform(-4.5, -3.2))
        color = lighting.tint(rng, strength * 9.0, 0.4)
        pulsing = lighting.maybe(rng, 0.4, lighting.nervous)
        place, stage.spot = lighting.hanging(rng, pivot, 1.6, rng.uniform(0.3, 0.9), color, pulsing=pulsing)
        glowing_ball(stage, place, 0.14, (1.0, 0.85, 0.6), 12.0)


def movers(rng: Rng) -> Stage:
    """Build a street, at any hour, where vans and drones rush past and disocclude the background."""
    weather = lighting.weather(rng, 13.0, (0.0, 0.0, -3.0))
    stage = Stage(environment=weather.environment, exposure=weather.exposure, sun=weather.sun)
    _street(rng, stage, 1.5 if weather.dark else 0.4)
    skyline(rng, stage)
    for _ in range(int(rng.integers(2, 4))):
        _van(rng, stage)
    for _ in range(int(rng.integers(2, 5))):
        _drone(rng, stage, weather.dark)
    _street_lights(rng, stage, weather.dark)
    if not weather.dark and rng.random() < 0.6:
        caster(rng, stage, weather.sun)
    if rng.random() < 0.4:
        stage.particles.append(particles.smoke(rng, (rng.uniform(-4, 4), 0.0, -4.8)))
    if rng.random() < 0.3:
        stage.particles.append(particles.dust(rng, (-5, 0, -4), (5, 2, 3)))
    stage.add_vantages(
        ((-1.0, 1.6, 5.2), (0.5, 1.5, -5.0), 1.2), ((-5.5, 1.9, 3.0), (2.5, 1.2, -4.0), 1.2),
        ((5.0, 1.1, 4.2), (-1.0, 1.6, -4.5), 1.0), ((-7.5, 1.7, -5.9), (4.0, 1.3, -4.2), 0.6),
        ((3.0, 4.4, 4.0), (-0.8, 0.4, -3.5), 1.2), ((0.8, 0.6, 3.4), (-1.5, 1.4, -5.0), 0.8),
        brisk=True,
    )  # fmt: skip
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
        stage.put(shapes.box(width, height, 5.0, 0.5), _wall(rng), placed(x + width / 2.0, 0, -10.1))
        _front(rng, stage, x + width / 2.0, width, height, shine)
        x += width + float(rng.choice([0.0, 0.0, 1.5]))
    rails = [shapes.tube([(-12, y, -4.8), (12, y, -4.8)], 0.02, 6) for y in (0.5, 0.95)]
    posts = [(shapes.cylinder(0.03, 1.1, 8), placed(x, 0, -4.8)) for x in np.arange(-12.0, 12.1, 1.5)]
    stage.put([*rails, *posts], materials.paint(rng))


def _wall(rng: Rng) -> Material:
    kind = rng.random()
    if kind < 0.4:
        return materials.brick(rng)
    return materials.planks(rng) if kind < 0.6 else materials.plaster(rng, materials.color(rng, 0.3, 0.6))


def _front(rng: Rng, stage: Stage, x: float, width: float, height: float, shine: float) -> None:
    columns = np.arange(x - width / 2.0 + 0.9, x + width / 2.0 - 0.5, 1.5)
    windows = [(k, y) for y in np.arange(0.9, height - 1.5, 2.1) for k in columns]
    frame, pane = shapes.box(1.0, 1.35, 0.12), shapes.wall(0.8, 1.15)
    if windows:
        white, glass = (0.85, 0.83, 0.78), (0.25, 0.28, 0.32)
        stage.put([(frame, placed(k, y, -7.6)) for k, y in windows], materials.paint(rng, white, 0.3))
        stage.put([(pane, placed(k, y + 0.1, -7.53)) for k, y in windows], materials.metal(rng, glass, 0.08))
    if rng.random() < 0.6:
        sign = materials.poster(rng, shine if rng.random() < 0.6 else 0.0)
        pulsing = lighting.maybe(rng, 0.4, lighting.pulse)
        stage.put(shapes.panel(1.6, 0.8), sign, placed(x, rng.uniform(1.9, 2.6), -7.42), emission=pulsing)


def _van(rng: Rng, stage: Stage) -> None:
    z, speed = rng.uniform(-3.5, 1.2), rng.uniform(4.0, 12.0)
    pose = paths.headed(paths.swing(rng, (-9.0, 0.0, z), (9.0, 0.0, z), speed))
    body = [(shapes.box(1.7, rng.uniform(1.3, 1.8), 2.6), placed(0, 0.4, -0.6))]
    body += [(shapes.box(1.66, 0.7, 1.3), placed(0, 0.4, 1.2)), (shapes.box(1.6, 0.15, 4.1), placed(0, 0.3))]
    stage.put(body, materials.paint(rng, gloss=0.9), pose)
    glass = [(shapes.box(1.5, 0.5, 0.7), placed(0, 1.1, 0.95))]
    stage.put(glass, materials.metal(rng, (0.2, 0.22, 0.25), 0.08), pose)
    for side in (-0.86, 0.86):
        sign = placed(side, 0.8, -0.6, yaw=np.sign(side) * np.pi / 2.0)
        stage.put(shapes.panel(1.8, 0.8), materials.poster(rng), paths.attached(pose, sign))
    wheel = shapes.merged((shapes.torus(0.24, 0.12, 20), placed(x) @ WHEEL) for x in (-0.78, 0.78))
    rubber = materials.paint(rng, (0.06, 0.06, 0.06), 0.2)
    for z_axle in (-1.1, 1.2):
        stage.put(wheel, rubber, paths.attached(pose, placed(0, 0.36, z_axle)))


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


def _street_lights(rng: Rng, stage: Stage, dark: bool) -> None:
    """Add a light that sweeps over the street or drives along it, and street lamps."""
    color = lighting.tint(rng, rng.uniform(140.0, 260.0) * (1.0 if dark else 2.2), 0.2)
    pulsing = lighting.maybe(rng, 0.6, lighting.nervous)
    if rng.random() < 0.5:
        sweep = paths.swing(rng, (-5.0, 0.0, -4.0), (5.0, 1.5, -6.0), rng.uniform(4.0, 16.0))
        mast = (rng.uniform(-3, 3), 6.0, 2.5)
        stage.spot = lighting.spotlight(mast, sweep, color, outer=24.0, reach=24.0, pulsing=pulsing)
    else:  # headlights that turn a corner: shadows of the objects in front of them run over the house fronts
        place = paths.swing(rng, (-9.0, 0.9, 6.0), (9.0, 0.9, 7.0), rng.uniform(4.0, 14.0))
        ahead = paths.swing(rng, (-4.0, 1.0, -6.0), (4.0, 1.0, -6.0), rng.uniform(2.0, 8.0))
        stage.spot = lighting.spotlight(place, ahead, color, outer=30.0, reach=28.0, pulsing=pulsing)
    for x in (-6.0, 0.0, 6.0):
        flickers = lighting.maybe(rng, 0.5, lighting.pulse, "flicker")
        head, glow = (x, 3.7, -5.0), lighting.tint(rng, 10.0 if dark else 16.0, 0.6)
        bulb(stage, head, glow, size=0.14, reach=9.0, pulsing=flickers)
        stage.put(shapes.cylinder(0.05, 3.6, 8), materials.paint(rng, (0.15, 0.15, 0.16)), placed(x, 0, -5.0))


GREENS: tuple[Color, ...] = ((0.3, 0.45, 0.13), (0.42, 0.45, 0.14), (0.2, 0.38, 0.16), (0.55, 0.45, 0.16))


def foliage(rng: Rng) -> Stage:
    """Build a meadow with trees and bushes in the wind, under fast clouds, or lit by lanterns at night."""
    weather = lighting.weather(rng, 11.0, (0.0, 0.0, -2.0))
    stage = Stage(environment=weather.environment, exposure=weather.exposure, sun=weather.sun)
    green = one_of(rng, *GREENS)
    soil = (green[0] * 0.6 + 0.1, green[1] * 0.55 + 0.06, green[2] * 0.5 + 0.05)
    stage.put(shapes.plane(70.0, 70.0, 0.35), materials.ground(rng, soil, 0.7))
    _grass_about_a_path(rng, stage, green)
    strength = rng.uniform(0.05, 0.16)
    for x in (-4.2, -1.6, 2.2, 4.8):
        tree(rng, stage, (x + rng.uniform(-0.6, 0.6), rng.uniform(-7.0, -3.5)), green, strength)
    for _ in range(4):
        bush(rng, stage, (rng.uniform(-5, 5), rng.uniform(-3.0, 0.5)), strength)
    hills(rng, stage, (0.8 * green[0], 0.8 * green[1], green[2]))
    _ruins(rng, stage)
    if rng.random() < 0.75:
        _cottage(rng, stage)
    for _ in range(6):
        _butterfly(rng, stage)
    if weather.dark:
        stage.particles.append(particles.fireflies(rng, (-4, 0.3, -4), (4, 1.6, 3)))
    elif rng.random() < 0.5:
        motes = particles.dust(rng, (-5, 0, -4), (5, 2.5, 4), 120, size=0.018, color=(1.0, 1.0, 0.9))
        stage.particles.append(motes)
    _meadow_lights(rng, stage, weather.dark)
    if not weather.dark and rng.random() < 0.85:
        caster(rng, stage, weather.sun, str(rng.choice(CASTERS, p=(0.2, 0.1, 0.35, 0.35))))
    stage.add_vantages(
        ((0.3, 1.3, 4.6), (0.0, 1.1, -3.0), 1.0), ((-3.2, 0.8, 3.2), (1.0, 1.0, -3.0), 0.8),
        ((3.0, 2.2, 4.2), (-0.6, 0.5, -2.0), 1.2), ((-0.6, 1.6, -0.6), (0.8, 1.0, -7.0), 0.6),
        ((4.8, 1.5, -0.4), (-2.5, 0.7, -5.5), 0.8), ((-1.5, 3.6, 4.4), (0.6, 0.0, -2.0), 1.0),
        brisk=True,
    )  # fmt: skip
    return stage


def _grass_about_a_path(rng: Rng, stage: Stage, green: Color) -> None:
    """Add the meadow; in most seeds a path of sand or slabs leads through it."""
    if rng.random() < 0.2:
        meadow(rng, stage, green, (-5.0, -6.0), (5.0, 4.0), 2600)
        return
    middle, width = rng.uniform(-1.2, 1.2), rng.uniform(1.4, 3.6)
    left, right = middle - 0.5 * width, middle + 0.5 * width
    meadow(rng, stage, green, (-5.0, -6.0), (left, 4.0), int(260 * (left + 5.0)))
    meadow(rng, stage, green, (right, -6.0), (5.0, 4.0), int(260 * (5.0 - right)))
    sand, slabs = materials.plaster(rng, (0.55, 0.48, 0.36)), materials.tiles(rng, 4, 0.3, 0.2)
    cover = sand if rng.random() < 0.6 else slabs
    stage.put(shapes.plane(width, 13.0, 0.5), cover, placed(middle, 0.01, 0.0))


def meadow(
    rng: Rng, stage: Stage, green: Color, low: tuple[float, float], high: tuple[float, float], count: int
) -> None:
    """Add grass on a rectangle of x and z, denser towards its near side."""
    depth = rng.random(count) ** 0.7
    x, z = rng.uniform(low[0], high[0], count), low[1] + (high[1] - low[1]) * depth
    roots = np.stack([x, 0.0 * x, z], axis=1)
    columns, rows = 10, 9
    column = np.clip((x - low[0]) / (high[0] - low[0]) * columns, 0, columns - 1).astype(np.int64)
    group = column + np.clip(depth * rows, 0, rows - 1).astype(np.int64) * columns
    anchors = np.zeros((columns * rows, 3))
    np.add.at(anchors, group, roots)
    anchors /= np.maximum(np.bincount(group, minlength=columns * rows), 1)[:, None]
    height = rng.uniform(0.22, 0.5)
    sway = paths.wind(rng, anchors, 0.5 * height)
    grass = shapes.blades(rng, roots, group, height, 0.035)
    stage.put(grass, materials.grass(rng, green), palette=sway, shadow=False)


def tree(rng: Rng, stage: Stage, at: tuple[float, float], green: Color, strength: float) -> None:
    """Add a tree whose twigs sway by `strength` metres at (x, z)."""
    tall, bark = rng.uniform(2.0, 3.2), materials.ground(rng, (0.32, 0.25, 0.19), 0.7, 6.0)
    root = np.array([at[0], 0.0, at[1]])
    lean = rng.normal(0.0, 0.2, 3) * (1.0, 0.0, 1.0)
    trunk = root + np.array([0.0, 0.5, 1.0])[:, None] * (lean + np.array([0.0, tall, 0.0]))
    crown, count = trunk[-1], int(rng.integers(18, 30))
    tips = crown + rng.normal((0.0, 1.0, 0.0), 1.0, (count, 3)) * (0.75, 0.5, 0.75)
    branches = (np.stack([trunk[1] + 0.3 * lean, 0.5 * (crown + tip), tip]) for tip in tips)
    stage.put([shapes.tube(trunk, 0.13, 9), *(shapes.tube(branch, 0.03, 5) for branch in branches)], bark)
    _crown(rng, stage, tips, crown, materials.foliage(rng, green), strength, 0.34)


def bush(rng: Rng, stage: Stage, at: tuple[float, float], strength: float) -> None:
    """Add a bush at (x, z); some are in flower."""
    tips = np.array([at[0], 0.35, at[1]]) + rng.normal(0.0, 1.0, (14, 3)) * (0.35, 0.14, 0.35)
    hue = one_of(rng, *GREENS) if rng.random() < 0.7 else (0.7, 0.3, 0.35)
    leaves, root = materials.foliage(rng, hue, 5), np.array([at[0], 0.0, at[1]])
    _crown(rng, stage, tips, root, leaves, 0.5 * strength, 0.22)


def _crown(
    rng: Rng, stage: Stage, tips: Values, middle: Values, leaves: Material, strength: float, size: float
) -> None:
    groups = np.repeat(np.arange(len(tips)), 12)
    centers = tips[groups] + rng.normal(0.0, 0.55 * size, (len(groups), 3))
    centers[:, 1] = np.maximum(centers[:, 1], 0.4 * size)
    mesh = shapes.cards(rng, centers, groups, size, middle)
    stage.put(mesh, leaves, palette=paths.wind(rng, tips, strength))


def _ruins(rng: Rng, stage: Stage) -> None:
    stone = materials.brick(rng) if rng.random() < 0.6 else materials.concrete(rng)
    for x in rng.uniform(-5.0, 5.0, 3):
        wall = shapes.box(rng.uniform(1, 3), rng.uniform(0.5, 1.8), 0.4, 0.6)
        stage.put(wall, stone, placed(x, 0, rng.uniform(-8.5, -5), yaw=rng.normal(0, 0.4)))
    for x, z in rng.uniform((-4, -4), (4, 2), (5, 2)):
        size = rng.uniform(0.15, 0.45)
        stage.put(shapes.rock(rng, size), materials.ground(rng, (0.5, 0.48, 0.45)), placed(x, 0.2 * size, z))
    rails = [(shapes.box(12.0, 0.1, 0.05, 0.8), placed(0, y, -4.4)) for y in (0.35, 0.75)]
    posts = [(shapes.box(0.12, 1.0, 0.12, 0.8), placed(x, 0, -4.45)) for x in np.arange(-6.0, 6.1, 1.2)]
    stage.put(rails + posts, materials.planks(rng))


def _cottage(rng: Rng, stage: Stage) -> None:
    """Add a plastered house or a garden wall behind the trees, for their shadows to fall on."""
    plaster = materials.plaster(rng, (0.78, 0.74, 0.66))
    x, width, tall = rng.uniform(-3, 3), rng.uniform(4.0, 9.0), rng.uniform(1.8, 3.2)
    at = placed(x, 0.0, rng.uniform(-9.5, -8.0), yaw=rng.normal(0.0, 0.15))
    stage.put(shapes.box(width, tall, 2.0, 0.4), plaster, at)
    if tall > 2.4:
        stage.put(shapes.box(width + 0.5, 0.25, 2.6, 0.6), materials.planks(rng), at @ placed(0.0, tall))
        panes = [(shapes.box(0.7, 0.9, 0.06), placed(k, 1.0, 1.0)) for k in np.arange(-0.3, 0.4, 0.3) * width]
        stage.put(panes, materials.metal(rng, (0.3, 0.34, 0.38), 0.08), at)


def _meadow_lights(rng: Rng, stage: Stage, dark: bool) -> None:
    """Add lanterns that wander, and at night the headlights of a car that passes behind the camera."""
    for _ in range(int(rng.integers(3, 6)) if dark else int(rng.integers(1, 3))):
        home = (rng.uniform(-4, 4), rng.uniform(0.9, 1.9), rng.uniform(-6.5, 0))
        lantern = paths.together(home, paths.drift(rng, 1.2, 0.9))
        color = lighting.tint(rng, 6.0 if dark else 20.0, 0.7)
        pulsing = lighting.maybe(rng, 0.85, lighting.nervous)
        bulb(stage, lantern, color, size=0.08, reach=8.0, pulsing=pulsing)
    if dark:
        car = paths.swing(rng, (-6.0, 1.2, 6.5), (6.0, 1.2, 7.0), rng.uniform(3.0, 9.0))
        beam = paths.swing(rng, (-5.0, 0.8, -6.0), (5.0, 0.8, -6.0), rng.uniform(5.0, 16.0))
        color = lighting.tint(rng, rng.uniform(150.0, 350.0), 0.15)
        stage.spot = lighting.spotlight(car, beam, color, outer=26.0, reach=26.0)


def _butterfly(rng: Rng, stage: Stage) -> None:
    home = (rng.uniform(-2, 2), rng.uniform(0.7, 1.7), rng.uniform(-2, 2.5))
    path = paths.circuit(rng, home, (rng.uniform(0.5, 1.5), 0.8), 2.0)
    pose, beat = paths.headed(paths.together(path, paths.drift(rng, 0.15, 2.0))), rng.uniform(20, 35)
    wing, cover = shapes.plane(0.16, 0.1), materials.striped(rng, 4)

    def flap(side: float) -> paths.Pose:
        return lambda t: turned_by(2, side * (0.3 + 0.8 * np.sin(beat * t))) @ placed(0.08 * side)

    for side in (-1.0, 1.0):
        stage.put(wing, cover, paths.attached(pose, flap(side)))
