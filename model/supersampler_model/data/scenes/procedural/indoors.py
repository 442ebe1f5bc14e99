"""Indoor training families: floors, metals, flicker, station."""

import numpy as np

from supersampler_model.data.scenes.procedural import lighting, materials, particles, paths, shapes
from supersampler_model.data.scenes.procedural.materials import sign
from supersampler_model.data.scenes.procedural.paths import Pose, placed, turned_by
from supersampler_model.data.scenes.procedural.stage import Stage, bulb, caster, fan, glowing_ball
from supersampler_model.data.scenes.scene import Material, Matrix, Mesh, Rng, Values


def floors(rng: Rng) -> Stage:
    """Build a hall of columns: balls roll over its finely patterned, polished floor, lit or in the dark."""
    dark = rng.random() < 0.27
    ambient = 0.016 if dark else 0.1 * rng.uniform(0.25, 0.9)
    grey = (ambient, 1.1 * ambient, 1.4 * ambient)
    room = lighting.indoors(rng, grey, 5 if dark else 14, 0.8 if dark else 3.0)
    stage = Stage(environment=room, exposure=rng.uniform(*((1.3, 1.8) if dark else (0.8, 1.2))))
    stage.put(shapes.plane(60.0, 60.0, rng.uniform(0.3, 0.6)), _floor(rng))
    _architecture(rng, stage)
    _movers(rng, stage)
    _hall_lights(rng, stage, dark)
    if rng.random() < 0.5:
        stage.particles.append(particles.dust(rng, (-5, 0.2, -8), (5, 3, 4)))
    low = rng.uniform(0.5, 1.3)
    stage.add_vantages(
        ((0.6, low, 5.5), (0.0, 0.6, -6.0), 1.3), ((-3.0, low + 0.3, 4.0), (2.0, 0.5, -5.0), 1.2),
        ((2.8, 1.7, 3.0), (-1.0, 0.0, -4.0), 1.2), ((-6.2, 1.6, -3.5), (4.0, 0.2, -4.5), 0.6),
        ((0.8, low + 0.4, -13.5), (-0.4, 0.5, 0.0), 1.2), ((5.6, 3.8, 1.0), (-1.0, 0.0, -4.5), 0.9),
        ((1.4, 0.3, 1.6), (-0.8, 0.5, -6.0), 0.8),
        brisk=True,
    )  # fmt: skip
    return stage


def _floor(rng: Rng) -> Material:
    gloss = rng.uniform(0.2, 1.0)
    if rng.random() < 0.25:
        return materials.planks(rng, 8, gloss)
    return materials.tiles(rng, int(rng.choice([4, 8, 12, 16])), gloss, rng.uniform(0.3, 0.8))


def _architecture(rng: Rng, stage: Stage) -> None:
    stone = materials.concrete(rng) if rng.random() < 0.5 else materials.brick(rng)
    spacing, radius = rng.uniform(2.6, 3.6), rng.uniform(0.22, 0.4)
    column = shapes.lathe(
        [(radius * 1.5, 0), (radius * 1.5, 0.2), (radius, 0.4), (radius * 0.85, 3.9), (radius * 1.4, 4.1),
         (radius * 1.4, 4.4)], 20,
    )  # fmt: skip
    rows = [placed(side * 4.2, 0, z) for side in (-1, 1) for z in np.arange(2.0, -16.0, -spacing)]
    stage.put([(column, at) for at in rows], stone)
    plaster = materials.plaster(rng, (0.62, 0.58, 0.52))
    for side in (-1, 1):
        stage.put(shapes.wall(44.0, 6.0, 0.3), plaster, placed(side * 7.0, 0, -4.0, yaw=-side * np.pi / 2.0))
        for z in (-9.0, -5.0, -1.0):
            at = placed(side * 6.95, 1.2, z, yaw=-side * np.pi / 2.0)
            stage.put(shapes.panel(1.8, 1.8), materials.poster(rng), at)
    stage.put(shapes.wall(16.0, 6.0, 0.3), plaster, placed(0, 0, -18.0))
    stage.put(shapes.wall(16.0, 6.0, 0.3), plaster, placed(0, 0, 9.0, yaw=np.pi))
    beams = [(shapes.box(14.2, 0.4, 0.35, 0.4), placed(0, 4.4, z)) for z in np.arange(2.0, -16.0, -spacing)]
    stage.put(beams, plaster)
    plinth = shapes.box(0.7, 0.8, 0.7, 0.6)
    stage.put([(plinth, placed(x, 0, z)) for x, z in rng.uniform((-3, -9), (3, -2), (4, 2))], stone)


def _movers(rng: Rng, stage: Stage) -> None:
    for _ in range(int(rng.integers(3, 6))):
        radius = rng.uniform(0.14, 0.4)
        middle = (rng.uniform(-1, 1), 0, rng.uniform(-5, -1))
        extent = (rng.uniform(1, 2.6), rng.uniform(1, 3))
        path = paths.circuit(rng, middle, extent, rng.uniform(1.0, 5.0))
        hops = paths.bounces(rng, path, rng.uniform(0.02, 0.5), radius)
        cover = materials.paint(rng) if rng.random() < 0.6 else materials.any_metal(rng, 0.2)
        stage.put(shapes.ball(radius), cover, paths.spinning(hops, rng.normal(size=3), rng.uniform(2, 8)))
    trolley = paths.swing(rng, (-3.0, 0, -6.0), (3.0, 0, -6.5), rng.uniform(1.5, 4.0))
    load: list[shapes.Part] = [
        (shapes.box(1.2, 0.08, 0.7), placed(0, 0.25, 0)),
        (shapes.box(0.5, 0.6, 0.5), placed(-0.25, 0.33, 0, yaw=0.2)),
        (shapes.cylinder(0.2, 0.9), placed(0.35, 0.33, 0)),
        shapes.tube([(-0.6, 0.3, 0.3), (-0.6, 1.1, 0.3), (-0.6, 1.1, -0.3), (-0.6, 0.3, -0.3)], 0.02),
    ]
    stage.put(load, materials.paint(rng), paths.upright(trolley))


def _hall_lights(rng: Rng, stage: Stage, dark: bool) -> None:
    """Add a light with shadows, the sun through the open roof by day, and lamps that drift and flicker."""
    _ceiling_light(rng, stage, (1.1 if dark else 1.2) * rng.uniform(0.8, 1.3))
    if not dark and rng.random() < 0.65:
        clouds = lighting.maybe(rng, 0.6, lighting.clouds)
        stage.sun = lighting.sunlight(rng, 6.0, 13.0, elevation=(35, 60), center=(0, 0, -4), pulsing=clouds)
        if rng.random() < 0.6:
            caster(rng, stage, stage.sun)
    for x, z in rng.uniform((-3.5, -9.0), (3.5, 1.0), (6, 2)):
        path = paths.together((x, rng.uniform(0.6, 2.2), z), paths.drift(rng, 1.2, rng.uniform(0.4, 1.0)))
        color = lighting.tint(rng, rng.uniform(6, 16) * (1.0 if dark else 1.5))
        pulsing = lighting.maybe(rng, 0.6, lighting.nervous)
        bulb(stage, path, color, size=0.07, reach=7.0, pulsing=pulsing)


def _ceiling_light(rng: Rng, stage: Stage, strength: float) -> None:
    """Add a spot that wanders over the floor, a lamp that swings, or one behind the blades of a fan."""
    x, kind = rng.uniform(-2, 2), int(rng.integers(3))
    color, top = lighting.tint(rng, 130.0 * strength, 0.2), (x, 4.3, -2.5)
    pulsing = lighting.maybe(rng, 0.4, lighting.nervous)
    if kind == 0:
        sweep = paths.swing(rng, (-3.5, 0.0, -6.0), (3.5, 0.0, 0.5), rng.uniform(3.0, 14.0))
        stage.spot = lighting.spotlight(top, sweep, color, outer=rng.uniform(22, 40), pulsing=pulsing)
    elif kind == 1:
        extent = rng.uniform(0.3, 0.9)
        place, stage.spot = lighting.hanging(rng, (x, 5.2, -2.5), 1.8, extent, color, pulsing=pulsing)
        glowing_ball(stage, place, 0.12, (1.0, 0.9, 0.7), 12.0)
    else:
        stage.spot = lighting.spotlight(top, (x, 0.0, -2.5), color, outer=60.0, pulsing=pulsing)
        fan(rng, stage, (x, 3.3, -2.5), 1.0, 0.24, (1.5, 6.0))


TABLE = 0.85  # metres high


def metals(rng: Rng) -> Stage:
    """Build a workshop or a show room of mirrors and metals under coloured lights that circle and pulse."""
    dark, show_room = rng.random() < 0.27, rng.random() < 0.45
    ambient = 0.014 if dark else 0.1 * rng.uniform(0.4, 1.0)
    panels = int(rng.integers(*((3, 6) if dark else (6, 14))))
    strength, grey = rng.uniform(*((0.8, 1.6) if dark else (3, 7))), (ambient, 1.1 * ambient, 1.3 * ambient)
    room = lighting.indoors(rng, grey, panels, strength)
    stage = Stage(environment=room, exposure=rng.uniform(1.0, 1.5) * (1.25 if dark else 1.0))
    _room(rng, stage)
    if show_room:
        _goods(rng, stage, _plinths(rng, stage))
    else:
        wooden = rng.random() < 0.5
        top = materials.planks(rng, 6, 0.6) if wooden else materials.brushed(rng, (0.6, 0.6, 0.62))
        legs = [(shapes.box(0.1, TABLE, 0.1), placed(x, 0, z)) for x in (-1.7, 1.7) for z in (-0.7, 0.7)]
        stage.put([(shapes.box(3.6, 0.08, 1.7, 0.8), placed(0, TABLE - 0.08, 0)), *legs], top)
        _goods(rng, stage, [(x, TABLE, z) for x in np.linspace(-1.4, 1.4, 6).tolist() for z in (-0.45, 0.35)])
    _engine(rng, stage)
    _workshop_lights(rng, stage, (1.4 if dark else 1.1) * rng.uniform(0.7, 1.4))
    if rng.random() < 0.5:
        stage.particles.append(particles.sparks(rng, (rng.uniform(-1, 1), TABLE + 0.2, -0.3)))
    stage.add_vantages(
        ((0.3, 1.65, 2.4), (0.0, 1.05, 0.0), 0.8), ((-1.7, 1.35, 1.3), (0.3, 1.05, -0.2), 0.6),
        ((1.6, 1.9, 1.9), (-0.2, 0.9, -0.3), 0.7), ((3.1, 1.6, -0.5), (-0.6, 0.9, -0.1), 0.5),
        ((0.3, 2.9, 1.3), (0.0, 0.7, -0.3), 0.6), ((-3.0, 1.5, -1.7), (1.6, 0.9, 1.2), 0.5),
        ((-0.6, 1.3, 1.15), (0.5, 1.05, -0.5), 0.3),
        brisk=True,
    )  # fmt: skip
    return stage


def _room(rng: Rng, stage: Stage) -> None:
    metallic = rng.random() < 0.4
    smooth = materials.metal(rng, (0.5, 0.5, 0.52), 0.4) if metallic else materials.tiles(rng, 6, 0.8)
    stage.put(shapes.plane(14.0, 14.0, 0.5), materials.concrete(rng) if rng.random() < 0.5 else smooth)
    plates, kind = materials.plates(rng, (0.5, 0.53, 0.56)), rng.random()
    plain = materials.plaster(rng, materials.color(rng, 0.25, 0.6)) if kind < 0.65 else plates
    back = materials.brick(rng) if kind < 0.35 else plain
    for x, z, yaw in ((0, 5.0, np.pi), (0, -2.6, 0), (-4.5, 0, np.pi / 2.0), (4.5, 0, -np.pi / 2.0)):
        stage.put(shapes.wall(14.0, 4.5, 0.5), back, placed(x, 0, z, yaw=yaw))
    shelf = [(shapes.box(3.4, 0.05, 0.35, 0.8), placed(0, y, -2.4)) for y in (1.3, 1.8, 2.3)]
    stage.put(shelf, materials.planks(rng))
    for y in (1.35, 1.85):
        for x in np.linspace(-1.4, 1.4, 6):
            can = shapes.cylinder(0.1, rng.uniform(0.15, 0.4))
            cover = materials.paint(rng) if rng.random() < 0.4 else materials.any_metal(rng, 0.3)
            stage.put(can, cover, placed(float(x + rng.uniform(-0.1, 0.1)), y, -2.4))


def _plinths(rng: Rng, stage: Stage) -> list[tuple[float, float, float]]:
    """Add plinths of all heights in a rough grid, and return the middles of their tops."""
    stone = materials.plaster(rng, materials.color(rng, 0.2, 0.75))
    tops = [
        (x + rng.uniform(-0.3, 0.3), rng.uniform(0.35, 1.05), z)
        for x in (-2.1, -0.7, 0.7, 2.1)
        for z in (-1.5, -0.3, 0.8)
    ]
    stage.put([(shapes.box(0.5, height, 0.5, 0.8), placed(x, 0.0, z)) for x, height, z in tops], stone)
    return tops


def _goods(rng: Rng, stage: Stage, slots: list[tuple[float, float, float]]) -> None:
    for x, y, z in slots:
        size, turn = rng.uniform(0.13, 0.2), rng.normal(0.0, 2.0)
        place = placed(x + rng.uniform(-0.08, 0.08), y, z + rng.uniform(-0.08, 0.08))
        kind = int(rng.integers(5))
        pose: Matrix | Pose = paths.spinning(place, (0, 1, 0), turn)
        if kind == 0:
            mesh, pose = shapes.ball(size), place @ placed(0, size, 0)
        elif kind == 1:
            mesh, tilted = shapes.torus(size, size / 3.0), placed(0, size * 1.2, 0) @ turned_by(0, 1.2)
            pose = paths.spinning(place @ tilted, (1, 0.3, 0), turn)
        elif kind == 2:
            heights, swell = np.linspace(0.0, 3.0 * size, 17), rng.uniform(1.2, 2.4)
            radii = size * (0.75 + 0.35 * np.sin(heights / size * swell + rng.uniform(0.0, 3.0)))
            profile = list(zip(radii.tolist(), heights.tolist(), strict=True))
            mesh = shapes.lathe(profile, 28, smooth=True)
        elif kind == 3:
            mesh, pose = _gear(rng, size), paths.spinning(place @ placed(0, 0.02, 0), (0, 1, 0), 2.0 * turn)
        else:
            mesh = shapes.box(size * 1.4, size * 1.4, size * 1.4, 2.0)
        stage.put(mesh, _surface(rng), pose)


def _surface(rng: Rng) -> Material:
    kind = rng.random()
    if kind < 0.25:
        return materials.metal(rng, (0.92, 0.92, 0.93), 0.06, 0.05)  # a mirror
    if kind < 0.45:
        return materials.brushed(rng, (0.7, 0.68, 0.66))
    if kind < 0.6:
        return materials.paint(rng, gloss=0.95)
    return materials.any_metal(rng, rng.uniform(0.08, 0.4))


def _gear(rng: Rng, size: float) -> Mesh:
    count, height = int(rng.integers(10, 18)), size * 0.35
    tooth = shapes.box(size * 0.22, height, size * 0.25)
    angles = np.linspace(0.0, 2.0 * np.pi, count, endpoint=False)
    teeth = [(tooth, placed(yaw=angle) @ placed(0, 0, size)) for angle in angles]
    profile = [(0, 0), (1, 0), (1, 0.35), (0.8, 0.35), (0.75, 0.2), (0.35, 0.2), (0.3, 0.5), (0, 0.5)]
    hub = shapes.lathe([(size * radius, size * level) for radius, level in profile], 32)
    return shapes.merged([hub, *teeth])


def _engine(rng: Rng, stage: Stage) -> None:
    """Add an arm that swings over the table with a chrome ball in its hand."""
    path = paths.swing(rng, (-1.2, TABLE + 0.6, -0.1), (1.2, TABLE + 0.75, 0.1), rng.uniform(0.8, 3.0))
    stage.put(shapes.ball(0.14), materials.metal(rng, (0.95, 0.95, 0.95), 0.05, 0.04), paths.upright(path))
    cable = shapes.tube([(0.0, 0.12, 0.0), (0.0, 2.4, 0.0)], 0.008)
    stage.put(cable, materials.paint(rng, (0.1, 0.1, 0.1)), paths.upright(path))


def _workshop_lights(rng: Rng, stage: Stage, strength: float) -> None:
    """Add a lamp with shadows that hangs still or swings, and coloured ones that circle and flicker."""
    pulsing = lighting.maybe(rng, 0.3, lighting.nervous)
    color = lighting.tint(rng, 45.0 * strength, 0.25)
    if rng.random() < 0.5:
        pivot, extent = (rng.uniform(-0.8, 0.8), 3.6, rng.uniform(-0.3, 0.6)), rng.uniform(0.3, 0.8)
        place, stage.spot = lighting.hanging(rng, pivot, 1.1, extent, color, pulsing=pulsing)
        glowing_ball(stage, place, 0.07, (1.0, 0.9, 0.7), 14.0)
    else:
        place = paths.together((0.3, 3.2, 0.9), paths.drift(rng, 0.7, 0.5))
        stage.spot = lighting.spotlight(place, (0.0, TABLE, 0.0), color, outer=42.0, pulsing=pulsing)
    for _ in range(int(rng.integers(3, 6))):
        middle = (rng.uniform(-0.6, 0.6), rng.uniform(1.3, 2.2), 0.2)
        axes = (rng.uniform(0.8, 1.8), rng.uniform(0.5, 1.0))
        path = paths.circuit(rng, middle, axes, rng.uniform(1.5, 7.0))
        lamp = lighting.tint(rng, strength * rng.uniform(1.5, 5.0))
        flickers = lighting.maybe(rng, 0.6, lighting.nervous)
        bulb(stage, path, lamp, size=0.035, glow=6.0, reach=5.0, pulsing=flickers)


HEIGHT = 3.0


def flicker(rng: Rng) -> Stage:
    """Build a cellar corridor with a swinging lamp, a fan and flickering tubes; shadows move."""
    ambient = 0.035 if rng.random() < 0.65 else 0.004
    room = lighting.indoors(rng, (ambient, 1.15 * ambient, 1.4 * ambient), 3, 11.0 * ambient)
    stage = Stage(environment=room, exposure=rng.uniform(1.6, 2.3))
    _walls(rng, stage)
    _furniture(rng, stage)
    _swinging_lamp(rng, stage)
    _tubes(rng, stage)
    _corridor_screens(rng, stage)
    if rng.random() < 0.5:
        stage.particles.append(particles.sparks(rng, (rng.uniform(-1.5, 1.5), 2.4, -2.9)))
    if rng.random() < 0.5:
        stage.particles.append(particles.dust(rng, (-2, 0.3, -6), (2, 2.6, 2)))
    stage.add_vantages(
        ((0.4, 1.55, 3.4), (-0.1, 1.2, -3.0), 0.7), ((-1.6, 1.3, 2.2), (0.9, 1.0, -2.5), 0.5),
        ((1.5, 1.9, 2.6), (-0.6, 0.8, -2.5), 0.5), ((0.3, 1.6, -7.0), (-0.2, 1.1, 1.0), 0.6),
        ((-1.9, 1.5, 0.6), (2.0, 1.0, -3.0), 0.4), ((0.2, 0.5, 1.6), (-0.1, 1.5, -4.0), 0.5),
        brisk=True,
    )  # fmt: skip
    return stage


def _walls(rng: Rng, stage: Stage) -> None:
    kind = rng.random()
    rough = materials.brick(rng) if kind < 0.4 else materials.tiles(rng, 12, 0.5, 0.3)
    sides = rough if kind < 0.7 else materials.plaster(rng, materials.color(rng, 0.25, 0.6))
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
            size, wood = rng.uniform(0.5, 0.8), materials.planks(rng)
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

    pulsing, color = lighting.pulse(rng, "throb", "flicker", "fade"), lighting.tint(rng, 16.0, 0.5)
    stage.spot = lighting.spotlight(lamp, below, color, outer=62.0, reach=12.0, pulsing=pulsing)
    shade = shapes.lathe([(0.28, -0.02), (0.12, 0.14), (0.03, 0.2)], 20)
    stage.put(shade, materials.paint(rng, gloss=0.8), paths.upright(lamp), shadow=False)
    glowing_ball(stage, lamp, 0.06, (1.0, 0.85, 0.6), 14.0, pulsing)
    if rng.random() < 0.5:
        fan(rng, stage, (0.0, 1.45, z), 0.9, 0.16, (2.0, 7.0))


def _tubes(rng: Rng, stage: Stage) -> None:
    for z in (-6.5, -4.0, 0.5):
        color, pulsing = lighting.tint(rng, 1.0, rng.uniform(-0.5, 0.3)), lighting.pulse(rng, "flicker")
        if z == -4.0:
            pulsing = lighting.pulse(rng)
        x = float(rng.choice([-1.2, 1.2]))
        tube = shapes.merged([(shapes.tube([(-0.6, 0, 0), (0.6, 0, 0)], 0.025), turned_by(1, np.pi / 2.0))])
        stage.put(tube, materials.glow(color, 6.0), placed(x, 2.85, z), emission=pulsing, shadow=False)
        bright = paths.vector(np.multiply(color, rng.uniform(2.0, 4.0)))
        stage.points.append(lighting.lamp((x, 2.7, z), bright, reach=6.0, pulsing=pulsing))


def _corridor_screens(rng: Rng, stage: Stage) -> None:
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


TRACK = -6.0  # z of the track, behind the platform
WALL = -9.0  # z of the wall behind it


def station(rng: Rng) -> Stage:
    """Build a platform by day or by night: boards, hanging signs, screens, and a passing train."""
    night = rng.random() < 0.45
    ambient = 0.03 if night else 0.2 * rng.uniform(0.6, 1.4)
    grey = (ambient, 1.1 * ambient, 1.3 * ambient)
    panorama = lighting.indoors(rng, grey, 6 if night else 12, 1.0 if night else 3.0)
    stage = Stage(environment=panorama, exposure=rng.uniform(*((1.2, 1.8) if night else (0.7, 1.1))))
    _hall(rng, stage)
    _boards(rng, stage)
    _hanging_signs(rng, stage)
    _platform_screens(rng, stage)
    _train(rng, stage)
    _platform_lights(rng, stage, night)
    stage.particles.append(particles.smoke(rng, (rng.uniform(-3, 3), 0.3, TRACK), grey=rng.uniform(0.2, 0.8)))
    if rng.random() < 0.5:
        stage.particles.append(particles.dust(rng, (-5, 0.3, -7), (5, 3.5, 2)))
    stage.add_vantages(
        ((0.5, 1.6, 2.0), (-0.5, 1.7, WALL), 1.0), ((-3.5, 1.7, 0.5), (2.5, 1.5, WALL), 0.8),
        ((3.8, 1.5, -0.5), (-2.0, 1.8, WALL), 0.7), ((-5.5, 1.6, -1.6), (5.0, 1.6, -3.4), 0.5),
        ((1.5, 2.4, -2.0), (0.5, 2.2, WALL), 0.5),
        brisk=True,
    )  # fmt: skip
    return stage


def _hall(rng: Rng, stage: Stage) -> None:
    floor = materials.tiles(rng, int(rng.choice([8, 12])), rng.uniform(0.1, 0.8), 0.4)
    stage.put(shapes.box(30.0, 0.6, 9.0, 0.5), floor, placed(0, -0.6, 0.0))
    stage.put(shapes.plane(60.0, 30.0, 0.4), materials.concrete(rng), placed(0, -1.2, 0))
    lining = materials.tiles(rng, 16, 0.6, 0.2) if rng.random() < 0.5 else materials.brick(rng)
    stage.put(shapes.wall(40.0, 7.0, 0.5), lining, placed(0, -1.2, WALL))
    plaster = materials.plaster(rng, (0.6, 0.6, 0.55))
    stage.put(shapes.wall(30.0, 6.0, 0.4), plaster, placed(0, 0, 4.4, yaw=np.pi))
    rails = [shapes.tube([(-20, -1.0, z), (20, -1.0, z)], 0.05) for z in (TRACK - 0.7, TRACK + 0.7)]
    stage.put(rails, materials.any_metal(rng, 0.25))
    post = shapes.cylinder(0.09, 4.2, 12)
    stage.put([(post, placed(x, 0, -3.0)) for x in np.arange(-9.0, 10.0, 3.0)], materials.paint(rng))
    stage.put(shapes.box(24.0, 0.15, 4.0, 0.4), materials.plates(rng, (0.6, 0.6, 0.6)), placed(0, 4.2, -2.0))


def _boards(rng: Rng, stage: Stage) -> None:
    """Put boards with small and large lettering on both walls."""
    for side, z, yaw in ((1, WALL + 0.06, 0.0), (-1, 4.3, np.pi)):
        for x in np.arange(-7.0, 8.0, 2.4):
            width, height = rng.uniform(1.0, 2.1), rng.uniform(0.5, 1.9)
            rows = int(rng.choice([2, 4, 8, 16, 28]))
            board = sign(rng, rows) if rng.random() < 0.8 else materials.poster(rng)
            at = placed(side * (x + rng.uniform(-0.2, 0.2)), rng.uniform(0.7, 1.6), z, yaw=yaw)
            stage.put(shapes.panel(width, height), board, at)


def _hanging_signs(rng: Rng, stage: Stage) -> None:
    """Hang signs on thin rods below the roof; some sway."""
    for x in rng.uniform(-6.0, 6.0, 4):
        pivot = (float(x), 4.1, float(rng.uniform(-3.0, -0.8)))
        sway = paths.pendulum(rng, pivot, rng.uniform(1.0, 1.6), rng.uniform(0.0, 0.25))
        side = shapes.panel(1.5, 0.45)
        board = [(side, placed(0, 0, 0.02)), (side, placed(0, 0, -0.02, yaw=np.pi))]
        shine = rng.uniform(0.8, 2.0) if rng.random() < 0.5 else 0.0
        stage.put(board, sign(rng, int(rng.choice([1, 2, 3])), shine), paths.upright(sway))
        rods = [shapes.tube([(dx, 0.45, 0), (dx, 1.7, 0)], 0.008, 6) for dx in (-0.6, 0.6)]
        stage.put(rods, materials.paint(rng, (0.1, 0.1, 0.1)), paths.upright(sway))


def _platform_screens(rng: Rng, stage: Stage) -> None:
    """Put up screens: some steady, some that fade and flicker."""
    for place in (-4.2, -0.6, 3.4):
        x, y, shine = place + rng.uniform(-0.5, 0.5), rng.uniform(1.2, 2.4), rng.uniform(0.7, 2.5)
        pulsing = lighting.maybe(rng, 0.4, lighting.pulse, "fade", "flicker", "throb")
        case = materials.paint(rng, (0.06, 0.06, 0.06))
        stage.put(shapes.box(1.7, 1.05, 0.08), case, placed(x, y - 0.03, -3.2))
        lit = materials.screen(rng, shine)
        stage.put(shapes.panel(1.6, 0.95), lit, placed(x, y, -3.15), emission=pulsing)


def _train(rng: Rng, stage: Stage) -> None:
    """Let a train of lettered cars pass, or stand."""
    speed = rng.uniform(1.0, 8.0) if rng.random() < 0.7 else 0.01
    way = paths.swing(rng, (-7.0, -0.9, TRACK), (7.0, -0.9, TRACK), speed)
    hull, trim = materials.paint(rng), sign(rng, int(rng.choice([2, 3, 6])))
    glass = materials.metal(rng, (0.2, 0.25, 0.3), 0.08)
    for car in (-6.4, 0.0, 6.4):
        ahead = paths.together((car, 0.0, 0.0), way)
        stage.put(shapes.box(6.0, 2.7, 2.2, 0.4), hull, paths.upright(ahead))
        panes = [(shapes.panel(0.9, 0.8), placed(x, 1.4, 1.12)) for x in (-2.2, -0.9, 0.9, 2.2)]
        stage.put(panes, glass, paths.upright(ahead))
        stage.put(shapes.panel(3.0, 0.5), trim, paths.attached(paths.upright(ahead), placed(0, 0.6, 1.13)))


def _platform_lights(rng: Rng, stage: Stage, night: bool) -> None:
    if not night:
        stage.sun = lighting.sunlight(rng, 6.0, 12.0, elevation=(30.0, 60.0), center=(0, 0, -3))
    for x in (-5.0, -1.5, 2.0, 5.5):
        color = lighting.tint(rng, rng.uniform(4.0, 10.0))
        pulsing = lighting.maybe(rng, 0.3, lighting.nervous)
        bulb(stage, (x, 3.9, rng.uniform(-2.5, -1.0)), color, size=0.05, reach=8.0, pulsing=pulsing)
    color = paths.vector(8.0 * np.array(materials.color(rng, 0.2, 1.0)))
    lamp = paths.circuit(rng, (0.0, 3.2, -4.5), (2.5, 0.6), rng.uniform(1.0, 4.0))
    bulb(stage, lamp, color, size=0.08, reach=9.0)
