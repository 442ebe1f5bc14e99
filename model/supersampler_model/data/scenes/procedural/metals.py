"""Training family: mirrors, gold and brushed steel under coloured lights that circle and pulse."""

import numpy as np

from supersampler_model.data.scenes.mesh import Mesh
from supersampler_model.data.scenes.procedural import lighting, materials, paths, shapes, textures
from supersampler_model.data.scenes.procedural.fixtures import bulb, glowing_ball
from supersampler_model.data.scenes.procedural.particles import sparks
from supersampler_model.data.scenes.procedural.stage import Stage
from supersampler_model.data.scenes.procedural.transforms import placed, turned_by
from supersampler_model.data.scenes.scene import Material
from supersampler_model.data.values import Rng

TABLE = 0.85  # metres high


def metals(rng: Rng) -> Stage:
    """Build the workshop with its table, or a show room with plinths, lit or in the dark."""
    dark, show_room = rng.random() < 0.27, rng.random() < 0.45
    ambient = 0.014 if dark else 0.1 * rng.uniform(0.4, 1.0)
    panels = int(rng.integers(3, 6)) if dark else int(rng.integers(6, 14))
    stage = Stage(
        environment=lighting.indoors(
            rng, (ambient, 1.1 * ambient, 1.3 * ambient), panels,
            float(rng.uniform(0.8, 1.6) if dark else rng.uniform(3, 7)),
        ),
        exposure=rng.uniform(1.0, 1.5) * (1.25 if dark else 1.0),
    )  # fmt: skip
    _room(rng, stage)
    if show_room:
        _goods(rng, stage, _plinths(rng, stage))
    else:
        _table(rng, stage)
        _goods(rng, stage, [(x, TABLE, z) for x in np.linspace(-1.4, 1.4, 6).tolist() for z in (-0.45, 0.35)])
    _engine(rng, stage)
    _lights(rng, stage, (1.4 if dark else 1.1) * rng.uniform(0.7, 1.4))
    if rng.random() < 0.5:
        stage.particles.append(sparks(rng, (rng.uniform(-1, 1), TABLE + 0.2, -0.3)))
    stage.vantages += [
        paths.Vantage(position=(0.3, 1.65, 2.4), target=(0.0, 1.05, 0.0), room=0.8, brisk=True),
        paths.Vantage(position=(-1.7, 1.35, 1.3), target=(0.3, 1.05, -0.2), room=0.6, brisk=True),
        paths.Vantage(position=(1.6, 1.9, 1.9), target=(-0.2, 0.9, -0.3), room=0.7, brisk=True),
        paths.Vantage(position=(3.1, 1.6, -0.5), target=(-0.6, 0.9, -0.1), room=0.5, brisk=True),
        paths.Vantage(position=(0.3, 2.9, 1.3), target=(0.0, 0.7, -0.3), room=0.6, brisk=True),
        paths.Vantage(position=(-3.0, 1.5, -1.7), target=(1.6, 0.9, 1.2), room=0.5, brisk=True),
        paths.Vantage(position=(-0.6, 1.3, 1.15), target=(0.5, 1.05, -0.5), room=0.3, brisk=True),
    ]
    return stage


def _room(rng: Rng, stage: Stage) -> None:
    smooth = (
        materials.metal(rng, (0.5, 0.5, 0.52), 0.4) if rng.random() < 0.4 else materials.tiles(rng, 6, 0.8)
    )
    stage.put(shapes.plane(14.0, 14.0, 0.5), materials.concrete(rng) if rng.random() < 0.5 else smooth)
    plates, kind = materials.plates(rng, (0.5, 0.53, 0.56)), rng.random()
    plain = materials.plaster(rng, textures.color(rng, 0.25, 0.6)) if kind < 0.65 else plates
    back = materials.brick(rng) if kind < 0.35 else plain
    stage.put(shapes.wall(14.0, 4.5, 0.5), back, placed(0, 0, 5.0, yaw=np.pi))
    stage.put(shapes.wall(14.0, 4.5, 0.5), back, placed(0, 0, -2.6))
    stage.put(shapes.wall(14.0, 4.5, 0.5), back, placed(-4.5, 0, 0, yaw=np.pi / 2.0))
    stage.put(shapes.wall(14.0, 4.5, 0.5), back, placed(4.5, 0, 0, yaw=-np.pi / 2.0))
    shelf = [(shapes.box(3.4, 0.05, 0.35, 0.8), placed(0, y, -2.4)) for y in (1.3, 1.8, 2.3)]
    stage.put(shelf, materials.planks(rng))
    for y in (1.35, 1.85):
        for x in np.linspace(-1.4, 1.4, 6):
            can = shapes.cylinder(0.1, rng.uniform(0.15, 0.4))
            cover = materials.paint(rng) if rng.random() < 0.4 else materials.any_metal(rng, 0.3)
            stage.put(can, cover, placed(float(x + rng.uniform(-0.1, 0.1)), y, -2.4))


def _table(rng: Rng, stage: Stage) -> None:
    top = materials.planks(rng, 6, 0.6) if rng.random() < 0.5 else materials.brushed(rng, (0.6, 0.6, 0.62))
    legs = [(shapes.box(0.1, TABLE, 0.1), placed(x, 0, z)) for x in (-1.7, 1.7) for z in (-0.7, 0.7)]
    stage.put([(shapes.box(3.6, 0.08, 1.7, 0.8), placed(0, TABLE - 0.08, 0)), *legs], top)


def _plinths(rng: Rng, stage: Stage) -> list[tuple[float, float, float]]:
    """Add plinths of all heights in a rough grid, and return the middles of their tops."""
    stone, tops = materials.plaster(rng, textures.color(rng, 0.2, 0.75)), []
    blocks = []
    for x in (-2.1, -0.7, 0.7, 2.1):
        for z in (-1.5, -0.3, 0.8):
            at = (x + rng.uniform(-0.3, 0.3), rng.uniform(0.35, 1.05), z)
            blocks.append((shapes.box(0.5, at[1], 0.5, 0.8), placed(at[0], 0.0, z)))
            tops.append(at)
    stage.put(blocks, stone)
    return tops


def _goods(rng: Rng, stage: Stage, slots: list[tuple[float, float, float]]) -> None:
    for x, y, z in slots:
        size, turn = rng.uniform(0.13, 0.2), rng.normal(0.0, 2.0)
        place = placed(x + rng.uniform(-0.08, 0.08), y, z + rng.uniform(-0.08, 0.08))
        kind = int(rng.integers(5))
        if kind == 0:
            stage.put(shapes.ball(size), _surface(rng), place @ placed(0, size, 0))
        elif kind == 1:
            tilted = placed(0, size * 1.2, 0) @ turned_by(0, 1.2)
            spin = paths.spinning(place @ tilted, (1, 0.3, 0), turn)
            stage.put(shapes.torus(size, size / 3.0), _surface(rng), spin)
        elif kind == 2:
            stage.put(_vase(rng, size), _surface(rng), paths.spinning(place, (0, 1, 0), turn))
        elif kind == 3:
            spin = paths.spinning(place @ placed(0, 0.02, 0), (0, 1, 0), 2.0 * turn)
            stage.put(_gear(rng, size), _surface(rng), spin)
        else:
            box = shapes.box(size * 1.4, size * 1.4, size * 1.4, 2.0)
            stage.put(box, _surface(rng), paths.spinning(place, (0, 1, 0), turn))


def _surface(rng: Rng) -> Material:
    kind = rng.random()
    if kind < 0.25:
        return materials.metal(rng, (0.92, 0.92, 0.93), 0.06, 0.05)  # a mirror
    if kind < 0.45:
        return materials.brushed(rng, (0.7, 0.68, 0.66))
    if kind < 0.6:
        return materials.paint(rng, gloss=0.95)
    return materials.any_metal(rng, rng.uniform(0.08, 0.4))


def _vase(rng: Rng, size: float) -> Mesh:
    heights = np.linspace(0.0, 3.0 * size, 17)
    radii = size * (0.75 + 0.35 * np.sin(heights / size * rng.uniform(1.2, 2.4) + rng.uniform(0.0, 3.0)))
    return shapes.lathe(list(zip(radii.tolist(), heights.tolist(), strict=True)), 28, smooth=True)


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


def _lights(rng: Rng, stage: Stage, strength: float) -> None:
    """Add a lamp with shadows that hangs still or swings, and coloured ones that circle and flicker."""
    pulsing = lighting.maybe(rng, 0.3, lighting.nervous)
    color = lighting.tint(rng, 45.0 * strength, 0.25)
    if rng.random() < 0.5:
        pivot = (rng.uniform(-0.8, 0.8), 3.6, rng.uniform(-0.3, 0.6))
        extent = rng.uniform(0.3, 0.8)
        place, stage.spot = lighting.hanging(rng, pivot, 1.1, extent, color, pulsing=pulsing)
        glowing_ball(stage, place, 0.07, (1.0, 0.9, 0.7), 14.0)
    else:
        place = paths.together((0.3, 3.2, 0.9), paths.drift(rng, 0.7, 0.5))
        table = (0.0, TABLE, 0.0)
        stage.spot = lighting.spotlight(place, table, color, outer=42.0, pulsing=pulsing)
    for _ in range(int(rng.integers(3, 6))):
        middle = (rng.uniform(-0.6, 0.6), rng.uniform(1.3, 2.2), 0.2)
        axes = (rng.uniform(0.8, 1.8), rng.uniform(0.5, 1.0))
        path = paths.circuit(rng, middle, axes, rng.uniform(1.5, 7.0))
        lamp = lighting.tint(rng, strength * rng.uniform(1.5, 5.0))
        flickers = lighting.maybe(rng, 0.6, lighting.nervous)
        bulb(stage, path, lamp, size=0.035, glow=6.0, reach=5.0, pulsing=flickers)
