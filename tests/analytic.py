"""Scenes with exact truth at any resolution and exact motion, in numpy: no file, no renderer, no licence.

A scene is a function of a frame's index and of places on a screen of 64 x 36 units (16:9). A frame samples it
at pixel centre + jitter; the truth averages it over each pixel's area. The size of a picture in pixels is
chosen when it is drawn, so 1 unit is 1 pixel at 64 x 36 and 2 pixels at 128 x 72.

>>> scene = Plane(zone_plate)
>>> frames = [scene.frame(i, (64, 36), jitter) for i, jitter in enumerate(jitters)]
>>> truth = scene.truth(0, (128, 72))
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from supersampler import Frame

Values = NDArray[np.float64]
Float32 = NDArray[np.float32]
Size = tuple[int, int]
Vector = tuple[float, float]
Pattern = Callable[[Values, Values], Values]
"""(x, y) in units to (..., 3) linear RGB in [0, 1]."""

EXTENT = (64.0, 36.0)
FAR, NEAR = 0.01, 0.1  # reversed depth of the background and of what is before it


class Surface(NamedTuple):
    """What is seen at some places: linear RGB (..., 3), depth (...), motion (..., 2) in units."""

    color: Values
    depth: Values
    motion: Values


class Scene:
    """Base of the scenes: they say what is seen where, and this draws it."""

    def surface(self, index: int, x: Values, y: Values) -> Surface:
        """Return what is seen at (x, y) units in frame `index`."""
        raise NotImplementedError

    def cut(self, index: int) -> bool:
        """Return True where frame `index` starts anew."""
        return index == 0

    def visible_before(self, index: int, x: Values, y: Values) -> NDArray[np.bool_]:
        """Return where what is seen in frame `index` was in sight one frame ago, at its motion's end."""
        motion = self.surface(index, x, y).motion
        x, y = x + motion[..., 0], y + motion[..., 1]
        inside = (x >= 0) & (x <= EXTENT[0]) & (y >= 0) & (y <= EXTENT[1])
        return np.asarray(inside & (not self.cut(index)))

    def frame(self, index: int, size: Size, jitter: Vector = (0.0, 0.0)) -> Frame:
        """Sample the scene once a pixel, at centre + jitter: conventions of DESIGN.md section 3."""
        surface = self.surface(index, *places(size, jitter))
        motion = surface.motion * np.array(size) / EXTENT
        return Frame(
            color=surface.color.astype(np.float32),
            depth=surface.depth.astype(np.float32),
            motion=motion.astype(np.float32),
            jitter=jitter,
            reset=self.cut(index),
            exposure=1.0,
        )

    def truth(self, index: int, size: Size, samples: int = 16) -> Float32:
        """Average the scene over each pixel by samples x samples regular ones: (H, W, 3) linear RGB."""
        offsets = (np.arange(samples) + 0.5) / samples - 0.5
        total = np.zeros((size[1], size[0], 3))
        for dy in offsets:  # sample by sample, so that memory does not grow with their number
            for dx in offsets:
                total += self.surface(index, *places(size, (dx, dy))).color
        return (total / samples**2).astype(np.float32)

    def disoccluded(self, index: int, size: Size) -> NDArray[np.bool_]:
        """(H, W), True where a pixel's centre sees what was hidden or off screen one frame ago."""
        return ~self.visible_before(index, *places(size))


def places(size: Size, offset: Vector = (0.0, 0.0)) -> tuple[Values, Values]:
    """Return x and y, (H, W) each, in units, of all pixel centres + offset (pixels)."""
    width, height = size
    x = (np.arange(width) + 0.5 + offset[0]) * EXTENT[0] / width
    y = (np.arange(height) + 0.5 + offset[1]) * EXTENT[1] / height
    return tuple(np.meshgrid(x, y))  # type: ignore[return-value]


# --- patterns: all are hard to sample, and all but the zone plate have hard edges ---


def zone_plate(x: Values, y: Values) -> Values:
    """Rings ever finer from the middle outwards, to one a unit in the corners."""
    dx, dy = x - EXTENT[0] / 2, y - EXTENT[1] / 2
    finest = np.hypot(*EXTENT) / 2  # units from the middle, where the phase grows by 2 pi a unit
    return grey(0.5 + 0.5 * np.cos(np.pi / finest * (dx * dx + dy * dy)))


def thin_lines(x: Values, y: Values) -> Values:
    """Bright lines, 0.4 units wide, as spokes at twelve angles, on dark."""
    dx, dy = x - EXTENT[0] / 2, y - EXTENT[1] / 2
    angles = np.pi * (np.arange(12) + 0.3) / 12  # +0.3: none along an axis
    distance = np.abs(dx[..., None] * np.sin(angles) - dy[..., None] * np.cos(angles)).min(axis=-1)
    return on_dark(distance < 0.2)


def dots(x: Values, y: Values) -> Values:
    """Bright discs of 0.35 units radius, smaller than a pixel at 64 x 36, 4.3 units apart, on dark."""
    spacing = 4.3  # no multiple of a pixel: the dots fall on pixels in all ways
    return on_dark(np.hypot(*((v + spacing / 2) % spacing - spacing / 2 for v in (x, y))) < 0.35)


def checker(x: Values, y: Values) -> Values:
    """Squares of 3.7 units, turned by 20 degrees so that their edges alias, orange and blue."""
    turned = np.cos(0.35) * x + np.sin(0.35) * y, np.cos(0.35) * y - np.sin(0.35) * x
    odd = sum(np.floor(v / 3.7).astype(int) for v in turned) % 2
    return np.where(odd[..., None] == 1, (0.9, 0.5, 0.1), (0.05, 0.1, 0.3))


def grey(values: Values) -> Values:
    """(...) to (..., 3)."""
    return np.repeat(values[..., None], 3, axis=-1)


def on_dark(bright: NDArray[np.bool_]) -> Values:
    """Return white where `bright`, dark grey elsewhere."""
    return grey(np.where(bright, 1.0, 0.05))


# --- scenes ---


@dataclass(frozen=True)
class Plane(Scene):
    """A pattern that fills the screen and pans by `velocity`, units a frame; (0, 0) is a still camera."""

    pattern: Pattern
    velocity: Vector = (0.0, 0.0)

    def surface(self, index: int, x: Values, y: Values) -> Surface:
        color = self.pattern(x - index * self.velocity[0], y - index * self.velocity[1])
        motion = np.broadcast_to(-np.array(self.velocity), (*x.shape, 2))  # previous minus current
        return Surface(color, np.full(x.shape, FAR), motion)


@dataclass(frozen=True)
class DiscOverPlane(Scene):
    """A near, ringed disc that crosses a panning checker: it hides at its front and reveals at its back.

    Its rings move with it. `start` and `radius` in units, velocities in units a frame.
    """

    velocity: Vector = (1.0, 0.5)
    background_velocity: Vector = (-0.5, 0.0)
    start: Vector = (20.0, 14.0)
    radius: float = 8.0

    def surface(self, index: int, x: Values, y: Values) -> Surface:
        behind = Plane(checker, self.background_velocity).surface(index, x, y)
        inside = self.covers(index, x, y)
        rings = 0.5 + 0.5 * np.cos(2.0 * self.distance(index, x, y))
        return Surface(
            np.where(inside[..., None], grey(rings), behind.color),
            np.where(inside, NEAR, behind.depth),
            np.where(inside[..., None], -np.array(self.velocity), behind.motion),
        )

    def distance(self, index: int, x: Values, y: Values) -> Values:
        """Return the distance from the disc's middle in frame `index`, units."""
        middle = np.array(self.start) + index * np.array(self.velocity)
        return np.asarray(np.hypot(x - middle[0], y - middle[1]))

    def covers(self, index: int, x: Values, y: Values) -> NDArray[np.bool_]:
        """Return where the disc is in frame `index`."""
        return self.distance(index, x, y) < self.radius

    def visible_before(self, index: int, x: Values, y: Values) -> NDArray[np.bool_]:
        x_before, y_before = x - self.background_velocity[0], y - self.background_velocity[1]
        hidden = ~self.covers(index, x, y) & self.covers(index - 1, x_before, y_before)
        return super().visible_before(index, x, y) & ~hidden


@dataclass(frozen=True)
class ShadingStep(Scene):
    """A scene whose light changes by `gain` at frame `at`, without any motion to tell of it."""

    scene: Scene
    at: int
    gain: float = 0.25

    def surface(self, index: int, x: Values, y: Values) -> Surface:
        surface = self.scene.surface(index, x, y)
        return surface._replace(color=surface.color * (self.gain if index >= self.at else 1.0))


@dataclass(frozen=True)
class Cut(Scene):
    """One scene until frame `at`, another from then on, which starts with a reset."""

    before: Scene
    after: Scene
    at: int

    def surface(self, index: int, x: Values, y: Values) -> Surface:
        return (self.before if index < self.at else self.after).surface(index, x, y)

    def cut(self, index: int) -> bool:
        return index in (0, self.at)
