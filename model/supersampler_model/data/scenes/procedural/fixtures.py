"""Objects that several families share: light bulbs, fans, bunting, skylines, hills."""

import numpy as np

from supersampler_model.data.scenes.procedural import lighting, materials, shapes
from supersampler_model.data.scenes.procedural.lighting import Pulse, steady
from supersampler_model.data.scenes.procedural.paths import (
    Place,
    Point3,
    place_of,
    spinning,
    upright,
    vector,
    wind,
)
from supersampler_model.data.scenes.procedural.stage import Stage
from supersampler_model.data.scenes.procedural.transforms import placed
from supersampler_model.data.values import Color, Rng, Vector

WHEEL = np.eye(4)[[1, 0, 2, 3]] * np.array([1.0, 1.0, -1.0, 1.0])
"""Turns y to x: a level ring becomes a wheel that rolls along z."""


def bulb(
    stage: Stage, path: Place | Point3, color: Color, *, size: float = 0.06, glow: float = 5.0,
    reach: float = 6.0, pulsing: Pulse = steady,
) -> None:  # fmt: skip
    """Add a point light and a glowing ball of radius `size`, at a point or moving along a path."""
    stage.points.append(lighting.lamp(path, color, reach=reach, pulsing=pulsing))
    glowing_ball(stage, path, size, vector(np.divide(color, max(color))), glow, pulsing)


def glowing_ball(
    stage: Stage, path: Place | Point3, size: float, color: Color, glow: float, pulsing: Pulse = steady
) -> None:
    """Add a glowing ball without a light source, at a point or moving along a path."""
    shine, pose = materials.glow(color, glow), upright(place_of(path))
    stage.put(shapes.ball(size, 8), shine, pose, emission=pulsing, shadow=False)


def fan(rng: Rng, stage: Stage, at: Vector, length: float, depth: float, speeds: tuple[float, float]) -> None:
    """Add a fan of four horizontal blades, whose shadows turn."""
    blade, turns = shapes.box(length, 0.02, depth), [k * np.pi / 2.0 for k in range(4)]
    blades = [(blade, placed(yaw=turn) @ placed(0.5 * length + 0.05)) for turn in turns]
    turning = spinning(placed(*at), (0, 1, 0), rng.uniform(*speeds))
    stage.put(blades, materials.paint(rng), turning)


def skyline(rng: Rng, stage: Stage) -> None:
    """Add a ring of buildings far away."""
    blocks = []
    for angle in np.linspace(0.0, 2.0 * np.pi, 44, endpoint=False):
        away, width = rng.uniform(28.0, 45.0), rng.uniform(3.0, 8.0)
        block = shapes.box(width, float(rng.gamma(5.0, 1.3)), width, 0.07)
        blocks.append((block, placed(away * np.sin(angle), 0, away * np.cos(angle), yaw=angle)))
    stage.put(blocks, materials.facade(rng), shadow=False)


def bunting(
    rng: Rng, stage: Stage, left: Point3, right: Point3, *, sag: float, cord: tuple[float, float], flags: int,
    margin: float, gap: float,
) -> None:  # fmt: skip
    """Add flags in the wind on a cord that hangs through by `sag` metres.

    `cord` is its radius in metres and its grey, `margin` the fraction without flags at each end, and `gap` is
    the distance from the cord to the middle of a flag, metres.
    """
    stage.put(shapes.wire(left, right, sag, cord[0]), materials.paint(rng, (cord[1],) * 3))
    t = np.linspace(margin, 1.0 - margin, flags)[:, None]
    middles = (1.0 - t) * np.array(left) + t * np.array(right)
    middles[:, 1] -= (4.0 * sag * t * (1.0 - t))[:, 0] + gap
    mesh = shapes.cards(rng, middles, np.arange(flags), 0.24, np.array([0.0, 30.0, float(left[2])]))
    stage.put(mesh, materials.striped(rng, 3), palette=wind(rng, middles, 0.09))


def hills(rng: Rng, stage: Stage, hue: Color) -> None:
    """Add hills and far trees around; `hue` is sRGB."""
    lumps = []
    for angle in np.linspace(0.0, 2.0 * np.pi, 26, endpoint=False):
        away, size = rng.uniform(38.0, 55.0), rng.uniform(6.0, 13.0)
        form = placed(away * np.sin(angle), -1.5, away * np.cos(angle), size=(size, 0.45 * size, size))
        lumps.append((shapes.rock(rng, 1.0, 6), form))
    for angle in rng.uniform(0.0, 2.0 * np.pi, 60):
        away, size = rng.uniform(18.0, 34.0), rng.uniform(0.8, 2.2)
        form = placed(away * np.sin(angle), size, away * np.cos(angle), size=size)
        lumps.append((shapes.rock(rng, 1.0, 6), form))
    far = materials.ground(rng, hue, 0.6, 8.0)
    stage.put(lumps, far, shadow=False)
