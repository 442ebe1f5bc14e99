"""Training family: a station of signs, timetables and screens, with lettered trains and blown smoke."""

import numpy as np

from supersampler_model.data.scenes.procedural import lighting, materials, paths, shapes, textures
from supersampler_model.data.scenes.procedural.fixtures import bulb
from supersampler_model.data.scenes.procedural.lettering import screen, sign
from supersampler_model.data.scenes.procedural.particles import dust, smoke
from supersampler_model.data.scenes.procedural.stage import Stage
from supersampler_model.data.scenes.procedural.transforms import placed
from supersampler_model.data.values import Rng

TRACK = -6.0  # z of the track, behind the platform
WALL = -9.0  # z of the wall behind it


def station(rng: Rng) -> Stage:
    """Build a platform by day or by night: boards, hanging signs, screens, and a passing train."""
    night = rng.random() < 0.45
    ambient = 0.03 if night else 0.2 * rng.uniform(0.6, 1.4)
    stage = Stage(
        environment=lighting.indoors(
            rng, (ambient, 1.1 * ambient, 1.3 * ambient), 6 if night else 12, 1.0 if night else 3.0
        ),
        exposure=float(rng.uniform(1.2, 1.8) if night else rng.uniform(0.7, 1.1)),
    )
    _hall(rng, stage)
    _boards(rng, stage)
    _hanging_signs(rng, stage)
    _screens(rng, stage)
    _train(rng, stage)
    _lights(rng, stage, night)
    stage.particles.append(smoke(rng, (rng.uniform(-3, 3), 0.3, TRACK), grey=rng.uniform(0.2, 0.8)))
    if rng.random() < 0.5:
        stage.particles.append(dust(rng, (-5, 0.3, -7), (5, 3.5, 2)))
    stage.vantages += [
        paths.Vantage(position=(0.5, 1.6, 2.0), target=(-0.5, 1.7, WALL), room=1.0, brisk=True),
        paths.Vantage(position=(-3.5, 1.7, 0.5), target=(2.5, 1.5, WALL), room=0.8, brisk=True),
        paths.Vantage(position=(3.8, 1.5, -0.5), target=(-2.0, 1.8, WALL), room=0.7, brisk=True),
        paths.Vantage(position=(-5.5, 1.6, -1.6), target=(5.0, 1.6, -3.4), room=0.5, brisk=True),
        paths.Vantage(position=(1.5, 2.4, -2.0), target=(0.5, 2.2, WALL), room=0.5, brisk=True),
    ]
    return stage


def _hall(rng: Rng, stage: Stage) -> None:
    floor = materials.tiles(rng, int(rng.choice([8, 12])), rng.uniform(0.1, 0.8), 0.4)
    stage.put(shapes.box(30.0, 0.6, 9.0, 0.5), floor, placed(0, -0.6, 0.0))
    stage.put(shapes.plane(60.0, 30.0, 0.4), materials.concrete(rng), placed(0, -1.2, 0))
    lining = materials.tiles(rng, 16, 0.6, 0.2) if rng.random() < 0.5 else materials.brick(rng)
    stage.put(shapes.wall(40.0, 7.0, 0.5), lining, placed(0, -1.2, WALL))
    stage.put(
        shapes.wall(30.0, 6.0, 0.4), materials.plaster(rng, (0.6, 0.6, 0.55)), placed(0, 0, 4.4, yaw=np.pi)
    )
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
        board = [
            (shapes.panel(1.5, 0.45), placed(0, 0, 0.02)),
            (shapes.panel(1.5, 0.45), placed(0, 0, -0.02, yaw=np.pi)),
        ]
        shine = rng.uniform(0.8, 2.0) if rng.random() < 0.5 else 0.0
        stage.put(board, sign(rng, int(rng.choice([1, 2, 3])), shine), paths.upright(sway))
        rods = [shapes.tube([(dx, 0.45, 0), (dx, 1.7, 0)], 0.008, 6) for dx in (-0.6, 0.6)]
        stage.put(rods, materials.paint(rng, (0.1, 0.1, 0.1)), paths.upright(sway))


def _screens(rng: Rng, stage: Stage) -> None:
    """Put up screens: some steady, some that fade and flicker."""
    for x in (-4.2, -0.6, 3.4):
        place = x + rng.uniform(-0.5, 0.5)
        y, shine = rng.uniform(1.2, 2.4), rng.uniform(0.7, 2.5)
        pulsing = lighting.maybe(rng, 0.4, lighting.pulse, "fade", "flicker", "throb")
        stage.put(
            shapes.box(1.7, 1.05, 0.08),
            materials.paint(rng, (0.06, 0.06, 0.06)),
            placed(place, y - 0.03, -3.2),
        )
        stage.put(shapes.panel(1.6, 0.95), screen(rng, shine), placed(place, y, -3.15), emission=pulsing)


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


def _lights(rng: Rng, stage: Stage, night: bool) -> None:
    if not night:
        stage.sun = lighting.sunlight(rng, 6.0, 12.0, elevation=(30.0, 60.0), center=(0, 0, -3))
    for x in (-5.0, -1.5, 2.0, 5.5):
        color = lighting.tint(rng, rng.uniform(4.0, 10.0))
        pulsing = lighting.maybe(rng, 0.3, lighting.nervous)
        bulb(stage, (x, 3.9, rng.uniform(-2.5, -1.0)), color, size=0.05, reach=8.0, pulsing=pulsing)
    color = textures.color(rng, 0.2, 1.0)
    lamp = paths.circuit(rng, (0.0, 3.2, -4.5), (2.5, 0.6), rng.uniform(1.0, 4.0))
    bulb(stage, lamp, paths.vector(8.0 * np.array(color)), size=0.08, reach=9.0)
