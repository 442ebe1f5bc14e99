"""Parts shared by families: bulbs that light their surroundings, skylines and hills."""

import numpy as np

from supersampler_model.data.scenes.procedural import lighting, materials, shapes
from supersampler_model.data.scenes.procedural.lighting import Pulse, steady
from supersampler_model.data.scenes.procedural.paths import Place, upright, vector
from supersampler_model.data.scenes.procedural.stage import Stage
from supersampler_model.data.scenes.procedural.transforms import placed
from supersampler_model.data.values import Color

Rng = np.random.Generator


def bulb(
    stage: Stage, path: Place, color: Color, *, size: float = 0.06, glow: float = 5.0, reach: float = 6.0,
    pulsing: Pulse = steady,
) -> None:  # fmt: skip
    """Add a glowing ball of radius `size` and the light of it, along `path`."""
    stage.points.append(lighting.lamp(path, color, reach=reach, pulsing=pulsing))
    shine = materials.glow(vector(np.divide(color, max(color))), glow)
    stage.put(shapes.ball(size, 8), shine, upright(path), emission=pulsing, shadow=False)


def skyline(rng: Rng, stage: Stage) -> None:
    """Add a ring of buildings far away."""
    blocks = []
    for angle in np.linspace(0.0, 2.0 * np.pi, 44, endpoint=False):
        away, width = float(rng.uniform(28.0, 45.0)), float(rng.uniform(3.0, 8.0))
        block = shapes.box(width, float(rng.gamma(5.0, 1.3)), width, 0.07)
        blocks.append((block, placed(away * np.sin(angle), 0, away * np.cos(angle), yaw=float(angle))))
    stage.put(shapes.merged(blocks), materials.facade(rng), shadow=False)


def hills(rng: Rng, stage: Stage, hue: Color) -> None:
    """Add hills and far trees around; `hue` is sRGB."""
    lumps = []
    for angle in np.linspace(0.0, 2.0 * np.pi, 26, endpoint=False):
        away, size = float(rng.uniform(38.0, 55.0)), float(rng.uniform(6.0, 13.0))
        form = placed(away * np.sin(angle), -1.5, away * np.cos(angle), size=(size, 0.45 * size, size))
        lumps.append((shapes.rock(rng, 1.0, 6), form))
    for angle in rng.uniform(0.0, 2.0 * np.pi, 60):
        away, size = float(rng.uniform(18.0, 34.0)), float(rng.uniform(0.8, 2.2))
        lumps.append(
            (shapes.rock(rng, 1.0, 6), placed(away * np.sin(angle), size, away * np.cos(angle), size=size))
        )
    far = materials.ground(rng, hue, 0.6, 8.0)
    stage.put(shapes.merged(lumps), far, shadow=False)
