"""Analytic scenes and patterns that only tests use: a floor, a change of light, fine patterns."""

from dataclasses import dataclass

import numpy as np

from supersampler_model.data.scenes.analytic import (
    EXTENT,
    FAR,
    NEAR,
    AnalyticScene,
    Mask,
    Pattern,
    SurfaceSample,
    Values,
    from_spokes,
    grey,
    plain,
)


def thin_lines(x: Values, y: Values) -> Values:
    """Bright lines, 0.4 units wide, as spokes at twelve angles, on dark."""
    return on_dark(from_spokes(x, y) < 0.2)


def dots(x: Values, y: Values) -> Values:
    """Bright discs of 0.35 units radius, smaller than a pixel at 64 x 36, 4.3 units apart, on dark."""
    spacing = 4.3  # no multiple of a pixel: the dots fall on pixels in all ways
    return on_dark(np.hypot(*((v + spacing / 2) % spacing - spacing / 2 for v in (x, y))) < 0.35)


def ripples(x: Values, y: Values) -> Values:
    """Normals of waves of 0.8 units, 30 degrees to either side: several a pixel at 64 x 36."""
    tilt = np.pi / 6 * np.sin(2 * np.pi * (x + 0.5 * y) / 0.8)
    return np.stack([np.sin(tilt), np.zeros_like(tilt), np.cos(tilt)], axis=-1)


def on_dark(bright: Mask) -> Values:
    """Return white where `bright`, dark grey elsewhere."""
    return grey(np.where(bright, 1.0, 0.05))


@dataclass(frozen=True)
class Floor(AnalyticScene):
    """A slanted plane, seen by a camera that goes `speed` distance units a frame towards its horizon.

    The horizon is above the screen. Distances are 1 / reversed depth, which grows evenly from FAR at the
    screen's top to NEAR at its bottom, as any plane's. The pattern lies on the floor: its x to the right, its
    y away from the first camera, distance units.
    """

    pattern: Pattern = plain
    speed: float = 0.0

    SLOPE = (NEAR - FAR) / EXTENT[1]  # reversed depth a unit of y
    FOCAL = EXTENT[0]  # units of the screen at distance 1; 53 degrees from left to right

    def surface(self, index: int, x: Values, y: Values) -> SurfaceSample:
        depth = FAR + self.SLOPE * y
        depth_before = 1.0 / (1.0 / depth + self.speed)
        aside = x - EXTENT[0] / 2
        motion = aside * (depth_before / depth - 1.0), (depth_before - depth) / self.SLOPE
        up = np.broadcast_to((0.0, 1.0, 0.0), (*x.shape, 3))
        color = self.pattern(aside / (depth * self.FOCAL), 1.0 / depth + index * self.speed)
        return SurfaceSample(color, depth, np.stack(motion, axis=-1), depth_before, up, up)


@dataclass(frozen=True)
class ShadingStep(AnalyticScene):
    """A scene whose light changes by `gain` at frame `at`, without motion."""

    scene: AnalyticScene
    at: int
    gain: float = 0.25

    def surface(self, index: int, x: Values, y: Values) -> SurfaceSample:
        surface = self.scene.surface(index, x, y)
        return surface._replace(color=surface.color * (self.gain if index >= self.at else 1.0))

    def visible_before(self, index: int, x: Values, y: Values) -> Mask:
        return self.scene.visible_before(index, x, y)

    def cut(self, index: int) -> bool:
        return self.scene.cut(index)


def near(mask: Mask) -> Mask:
    """Return the mask and the pixels that touch it."""
    padded = np.pad(mask, 1)
    height, width = mask.shape
    shifted = [padded[i : i + height, j : j + width] for i in range(3) for j in range(3)]
    return np.asarray(np.any(shifted, axis=0))
