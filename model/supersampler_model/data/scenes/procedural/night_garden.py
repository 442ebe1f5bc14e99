"""Family of the test shots: a garden at night with hedges, a pond, lanterns in the wind and fireflies."""

import numpy as np

from supersampler_model.data.scenes.procedural import lighting, materials, paths, shapes
from supersampler_model.data.scenes.procedural.fixtures import bulb, hills
from supersampler_model.data.scenes.procedural.foliage import bush, meadow, tree
from supersampler_model.data.scenes.procedural.particles import fireflies, smoke
from supersampler_model.data.scenes.procedural.stage import Stage
from supersampler_model.data.scenes.procedural.transforms import placed
from supersampler_model.data.values import Rng


def night_garden(rng: Rng) -> Stage:
    """Build the garden."""
    sky = lighting.outdoors(rng, (0.008, 0.012, 0.035), (0.03, 0.035, 0.06), (0.01, 0.012, 0.008), clouds=0.6)
    stage = Stage(environment=sky, exposure=rng.uniform(1.7, 2.4))
    stage.sun = lighting.sunlight(rng, 0.22, 11.0, elevation=(25, 50), warmth=-0.7, center=(0, 0, -2))
    green = ((0.2, 0.36, 0.16), (0.24, 0.32, 0.2), (0.3, 0.36, 0.12))[int(rng.integers(3))]
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
    _lights(rng, stage)
    stage.particles.append(fireflies(rng, (-4, 0.2, -5), (4, 1.8, 3), 35))
    if rng.random() < 0.5:
        stage.particles.append(smoke(rng, (0.0, 0.1, -1.6), 18, grey=0.04, rise=0.4))
    stage.vantages += [
        paths.Vantage(position=(0.6, 1.6, 4.2), target=(0.0, 0.9, -3.0), room=0.9),
        paths.Vantage(position=(-2.6, 1.2, 2.6), target=(1.0, 0.9, -3.0), room=0.7),
        paths.Vantage(position=(1.8, 2.2, 3.0), target=(-0.6, 0.6, -2.5), room=0.8),
    ]
    return stage


def _paths_and_pond(rng: Rng, stage: Stage) -> None:
    stage.put(shapes.plane(1.3, 14.0, 0.8), materials.tiles(rng, 6, 0.3, 0.3), placed(0, 0.02, 1.0))
    water = materials.metal(rng, (0.12, 0.15, 0.17), 0.06, 0.03)
    disc = shapes.lathe([(1.5, 0.0), (0.0, 0.001)], 40)
    stage.put(disc, water, placed(0, 0.05, -2.6))
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
    parts = [(column, placed(1.5 * np.sin(a), 0.2, -6.0 + 1.5 * np.cos(a))) for a in around]
    parts.append((shapes.cylinder(1.9, 0.2, 32), placed(0, 0, -6.0)))
    parts.append((shapes.torus(1.5, 0.12, 32), placed(0, 2.5, -6.0)))
    stage.put(parts, stone)
    stage.put(shapes.lathe([(1.9, 2.5), (1.0, 3.1), (0.15, 3.4), (0.0, 3.7)], 24), roof, placed(0, 0, -6.0))
    lattice = materials.grille(rng, 8, 8, 0.22, (0.75, 0.73, 0.68))
    for side in (-1.0, 1.0):
        stage.put(shapes.wall(1.6, 1.6, 0.8), lattice, placed(side * 2.6, 0, -4.9, yaw=-0.5 * side))


def _lights(rng: Rng, stage: Stage) -> None:
    for x, z in ((-1.0, 1.4), (1.0, 0.0), (-1.0, -4.6), (1.2, -4.4)):
        pole = shapes.tube([(x, 0, z), (x, 1.7, z), (0.75 * x, 1.8, z)], 0.025, 8)
        stage.put(pole, materials.paint(rng, (0.08, 0.09, 0.08)))
        sway = paths.together((0.75 * x, 1.55, z), paths.drift(rng, 0.06, 1.2))
        kind = str(rng.choice(["throb", "flicker", "fade"]))
        bulb(
            stage,
            sway,
            lighting.tint(rng, rng.uniform(3, 6), 0.8),
            size=0.09,
            pulsing=lighting.pulse(rng, kind),
        )
    for hue in (None, None, 0.9):
        path = paths.circuit(
            rng, (0, rng.uniform(0.5, 1.6), -2.6), (rng.uniform(1.5, 2.6), 1.6), rng.uniform(1.5, 4)
        )
        bulb(stage, path, lighting.tint(rng, 3.0, hue), size=0.05, pulsing=lighting.pulse(rng, "throb"))
    bulb(stage, (0.0, 2.0, -6.0), lighting.tint(rng, 7.0, 0.7), size=0.12, reach=7.0)
    torch = paths.swing(rng, (-2.5, 1.5, 2.5), (2.5, 1.6, 2.0), rng.uniform(1.0, 3.0))
    aim = paths.swing(rng, (-3.0, 0.4, -4.0), (3.0, 0.8, -4.0), rng.uniform(2.0, 6.0))
    stage.spot = lighting.spotlight(torch, aim, lighting.tint(rng, 45.0, -0.1), outer=26.0)
    moth = shapes.ball(0.03, 6)
    for _ in range(4):
        home = (rng.uniform(-1.2, 1.2), 1.5, rng.uniform(-4.5, 1.0))
        stage.put(moth, materials.cloth(rng), paths.upright(paths.together(home, paths.drift(rng, 0.5, 1.5))))
