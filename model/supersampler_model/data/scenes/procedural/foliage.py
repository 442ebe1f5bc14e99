"""Training family: a meadow with trees and bushes in the wind: thin blades and cut-out leaves that move."""

import numpy as np

from supersampler_model.data.scenes.procedural import lighting, materials, paths, shapes
from supersampler_model.data.scenes.procedural.casters import CASTERS, caster
from supersampler_model.data.scenes.procedural.fixtures import bulb, hills
from supersampler_model.data.scenes.procedural.particles import dust, fireflies
from supersampler_model.data.scenes.procedural.stage import Stage
from supersampler_model.data.scenes.procedural.transforms import placed, turned_by
from supersampler_model.data.scenes.scene import Material
from supersampler_model.data.values import Color, Rng, Values

GREENS: tuple[Color, ...] = ((0.3, 0.45, 0.13), (0.42, 0.45, 0.14), (0.2, 0.38, 0.16), (0.55, 0.45, 0.16))


def foliage(rng: Rng) -> Stage:
    """Build the meadow at any hour, on a windy day with fast clouds or by lanterns at night."""
    weather = lighting.weather(rng, 11.0, (0.0, 0.0, -2.0))
    stage = Stage(environment=weather.environment, exposure=weather.exposure, sun=weather.sun)
    green = GREENS[int(rng.integers(len(GREENS)))]
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
    _wildlife(rng, stage, weather.dark)
    _lights(rng, stage, weather.dark)
    if not weather.dark and rng.random() < 0.85:
        caster(rng, stage, weather.sun, str(rng.choice(CASTERS, p=(0.2, 0.1, 0.35, 0.35))))
    stage.vantages += [
        paths.Vantage(position=(0.3, 1.3, 4.6), target=(0.0, 1.1, -3.0), room=1.0, brisk=True),
        paths.Vantage(position=(-3.2, 0.8, 3.2), target=(1.0, 1.0, -3.0), room=0.8, brisk=True),
        paths.Vantage(position=(3.0, 2.2, 4.2), target=(-0.6, 0.5, -2.0), room=1.2, brisk=True),
        paths.Vantage(position=(-0.6, 1.6, -0.6), target=(0.8, 1.0, -7.0), room=0.6, brisk=True),
        paths.Vantage(position=(4.8, 1.5, -0.4), target=(-2.5, 0.7, -5.5), room=0.8, brisk=True),
        paths.Vantage(position=(-1.5, 3.6, 4.4), target=(0.6, 0.0, -2.0), room=1.0, brisk=True),
    ]
    return stage


def _grass_about_a_path(rng: Rng, stage: Stage, green: Color) -> None:
    """Add the meadow; in most seeds a trodden path or one of slabs leads through it."""
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
    group = (
        np.clip((x - low[0]) / (high[0] - low[0]) * columns, 0, columns - 1).astype(np.int64)
        + np.clip(depth * rows, 0, rows - 1).astype(np.int64) * columns
    )
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
    limbs = [shapes.tube(trunk, 0.13, 9)]
    for tip in tips:
        branch = np.stack([trunk[1] + 0.3 * lean, 0.5 * (crown + tip), tip])
        limbs.append(shapes.tube(branch, 0.03, 5))
    stage.put(limbs, bark)
    _crown(rng, stage, tips, crown, materials.foliage(rng, green), strength, 0.34)


def bush(rng: Rng, stage: Stage, at: tuple[float, float], strength: float) -> None:
    """Add a bush at (x, z), some with flowers' colours."""
    tips = np.array([at[0], 0.35, at[1]]) + rng.normal(0.0, 1.0, (14, 3)) * (0.35, 0.14, 0.35)
    hue = GREENS[int(rng.integers(len(GREENS)))] if rng.random() < 0.7 else (0.7, 0.3, 0.35)
    leaves, root = materials.foliage(rng, hue, 5), np.array([at[0], 0.0, at[1]])
    _crown(rng, stage, tips, root, leaves, 0.5 * strength, 0.22)


def _crown(
    rng: Rng, stage: Stage, tips: Values, middle: Values, leaves: Material, strength: float, size: float
) -> None:
    each = 12
    centers = np.repeat(tips, each, axis=0) + rng.normal(0.0, 0.55 * size, (each * len(tips), 3))
    centers[:, 1] = np.maximum(centers[:, 1], 0.4 * size)
    mesh = shapes.cards(rng, centers, np.repeat(np.arange(len(tips)), each), size, middle)
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
    """Add a plastered house or a garden wall behind the trees, on which their shadows play."""
    plaster = materials.plaster(rng, (0.78, 0.74, 0.66))
    x, width, tall = rng.uniform(-3, 3), rng.uniform(4.0, 9.0), rng.uniform(1.8, 3.2)
    at = placed(x, 0.0, rng.uniform(-9.5, -8.0), yaw=rng.normal(0.0, 0.15))
    stage.put(shapes.box(width, tall, 2.0, 0.4), plaster, at)
    if tall > 2.4:
        stage.put(shapes.box(width + 0.5, 0.25, 2.6, 0.6), materials.planks(rng), at @ placed(0.0, tall))
        panes = [(shapes.box(0.7, 0.9, 0.06), placed(k, 1.0, 1.0)) for k in np.arange(-0.3, 0.4, 0.3) * width]
        stage.put(panes, materials.metal(rng, (0.3, 0.34, 0.38), 0.08), at)


def _wildlife(rng: Rng, stage: Stage, dark: bool) -> None:
    for _ in range(6):
        _butterfly(rng, stage)
    if dark:
        stage.particles.append(fireflies(rng, (-4, 0.3, -4), (4, 1.6, 3)))
    elif rng.random() < 0.5:
        stage.particles.append(dust(rng, (-5, 0, -4), (5, 2.5, 4), 120, size=0.018, color=(1.0, 1.0, 0.9)))


def _lights(rng: Rng, stage: Stage, dark: bool) -> None:
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
