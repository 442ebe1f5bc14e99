"""Analytic scenes in numpy: exact references at any resolution and exact motion, without a renderer.

A scene is a function of the frame index and of positions on a screen of 64 x 36 units (16:9); the image size
is an argument: 1 unit is 2 pixels at 128 x 72.

>>> scene = Plane(zone_plate)
>>> frames = [scene.frame(i, (64, 36), jitter) for i, jitter in enumerate(jitters)]
>>> truth = scene.truth(0, (128, 72))
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from supersampler import Frame
from supersampler.frame import Float32, Size

Values = NDArray[np.float64]
Mask = NDArray[np.bool_]
Vector = tuple[float, float]
Pattern = Callable[[Values, Values], Values]
"""(x, y), (...) units each, to (..., 3): linear RGB in [0, 1], or unit normals."""

EXTENT = (64.0, 36.0)
FAR, NEAR = 0.01, 0.1  # reversed depth of background and foreground


class SurfaceSample(NamedTuple):
    """Surfaces at some positions."""

    color: Values  # (..., 3) linear RGB
    depth: Values  # (...) reversed
    motion: Values  # (..., 2) units, previous minus current
    depth_before: Values  # (...) reversed, of the same point one frame ago
    normal: Values  # (..., 3) unit length, x right, y up, z to the camera; without the normal map
    normal_mapped: Values  # (..., 3) with it


class AnalyticScene:
    """Base of the scenes: subclasses define surfaces, this class samples them."""

    def surface(self, index: int, x: Values, y: Values) -> SurfaceSample:
        """Return the surfaces at (x, y) units in frame `index`."""
        raise NotImplementedError

    def cut(self, index: int) -> bool:
        """Return True where frame `index` is the first after a cut."""
        return index == 0

    def visible_before(self, index: int, x: Values, y: Values) -> Mask:
        """Return where the surfaces of frame `index` were visible one frame ago."""
        motion = self.surface(index, x, y).motion
        x, y = x + motion[..., 0], y + motion[..., 1]
        inside = (x > 0) & (x < EXTENT[0]) & (y > 0) & (y < EXTENT[1])
        return np.asarray(inside & (not self.cut(index)))

    def frame(self, index: int, size: Size, jitter: Vector = (0.0, 0.0)) -> Frame:
        """Sample the scene once a pixel, at centre + jitter, in the conventions of `Frame`."""
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
        total = np.zeros((size[1], size[0], 3))
        for x, y in grids(size, samples):
            total += self.surface(index, x, y).color
        return (total / samples**2).astype(np.float32)

    def disoccluded(self, index: int, size: Size) -> Mask:
        """Return where the surface at a pixel's centre was occluded or off screen one frame ago."""
        return ~self.visible_before(index, *places(size))


def places(size: Size, offset: Vector = (0.0, 0.0)) -> tuple[Values, Values]:
    """Return x and y, (H, W) each, in units, of all pixel centres + offset (pixels)."""
    width, height = size
    x = (np.arange(width) + 0.5 + offset[0]) * EXTENT[0] / width
    y = (np.arange(height) + 0.5 + offset[1]) * EXTENT[1] / height
    return tuple(np.meshgrid(x, y))  # type: ignore[return-value]


def grids(size: Size, samples: int) -> Iterator[tuple[Values, Values]]:
    """Yield the places of one sample of each pixel after another, samples x samples regular ones in all."""
    offsets = (np.arange(samples) + 0.5) / samples - 0.5
    for dy in offsets:  # sample by sample, so that memory does not grow with their number
        for dx in offsets:
            yield places(size, (dx, dy))


# --- patterns: colours that are hard to sample (except `plain`), and normals ---


def plain(x: Values, y: Values) -> Values:
    """Uniform grey: only depth and motion vary."""
    return np.broadcast_to(0.5, (*np.broadcast(x, y).shape, 3))


def zone_plate(x: Values, y: Values) -> Values:
    """Rings ever finer from the middle outwards, to one a unit in the corners."""
    dx, dy = x - EXTENT[0] / 2, y - EXTENT[1] / 2
    finest = np.hypot(*EXTENT) / 2  # units from the middle, where the phase grows by 2 pi a unit
    return grey(0.5 + 0.5 * np.cos(np.pi / finest * (dx * dx + dy * dy)))


def checker(x: Values, y: Values) -> Values:
    """Squares of 3.7 units, turned by 20 degrees so that their edges alias, orange and blue."""
    turned = np.cos(0.35) * x + np.sin(0.35) * y, np.cos(0.35) * y - np.sin(0.35) * x
    odd = sum(np.floor(v / 3.7).astype(int) for v in turned) % 2
    return np.where(odd[..., None] == 1, (0.9, 0.5, 0.1), (0.05, 0.1, 0.3))


def frontal(x: Values, y: Values) -> Values:
    """Normals that face the camera."""
    return np.broadcast_to((0.0, 0.0, 1.0), (*np.broadcast(x, y).shape, 3))


def from_spokes(x: Values, y: Values) -> Values:
    """Return the distance, units, from the nearest of twelve lines through the screen's middle."""
    dx, dy = x - EXTENT[0] / 2, y - EXTENT[1] / 2
    angles = np.pi * (np.arange(12) + 0.3) / 12  # +0.3: none along an axis
    return np.asarray(np.abs(dx[..., None] * np.sin(angles) - dy[..., None] * np.cos(angles)).min(axis=-1))


def grey(values: Values) -> Values:
    """Repeat values (...) to (..., 3)."""
    return np.repeat(values[..., None], 3, axis=-1)


# --- scenes ---


@dataclass(frozen=True)
class Plane(AnalyticScene):
    """A pattern that fills the screen and pans by `velocity`, units a frame; (0, 0) is a still camera.

    `bumps` is its normal map, and pans with it.
    """

    pattern: Pattern
    velocity: Vector = (0.0, 0.0)
    bumps: Pattern = frontal

    def surface(self, index: int, x: Values, y: Values) -> SurfaceSample:
        """Return the pattern, moved."""
        there = x - index * self.velocity[0], y - index * self.velocity[1]
        depth = np.full(x.shape, FAR)
        motion = np.broadcast_to(-np.array(self.velocity), (*x.shape, 2))  # previous minus current
        return SurfaceSample(self.pattern(*there), depth, motion, depth, frontal(x, y), self.bumps(*there))


@dataclass(frozen=True)
class WiresOverPlane(AnalyticScene):
    """White wires near the camera, before a plane; all stand still. `half_width` in units."""

    background: Plane = Plane(plain)
    half_width: float = 0.2

    def surface(self, index: int, x: Values, y: Values) -> SurfaceSample:
        """Return wires, white, and between them the plane."""
        behind, wires = self.background.surface(index, x, y), from_spokes(x, y) < self.half_width
        color, depth = np.where(wires[..., None], 1.0, behind.color), np.where(wires, NEAR, FAR)
        return behind._replace(color=color, depth=depth, depth_before=depth)


@dataclass(frozen=True)
class DiscOverPlane(AnalyticScene):
    """A near, ringed disc over a panning background: it occludes at its front and disoccludes at its back.

    Its rings move with it. `start` and `radius` in units, velocities in units a frame.
    """

    velocity: Vector = (1.0, 0.5)
    background_velocity: Vector = (-0.5, 0.0)
    start: Vector = (20.0, 14.0)
    radius: float = 8.0
    pattern: Pattern = checker

    def surface(self, index: int, x: Values, y: Values) -> SurfaceSample:
        """Return the disc where it is, else the background."""
        behind = Plane(self.pattern, self.background_velocity).surface(index, x, y)
        inside = self.contains(index, x, y)
        rings = 0.5 + 0.5 * np.cos(2.0 * self.distance(index, x, y))
        depth = np.where(inside, NEAR, FAR)
        return behind._replace(
            color=np.where(inside[..., None], grey(rings), behind.color),
            depth=depth,
            motion=np.where(inside[..., None], -np.array(self.velocity), behind.motion),
            depth_before=depth,
        )

    def distance(self, index: int, x: Values, y: Values) -> Values:
        """Return the distance from the disc's middle in frame `index`, units."""
        middle = np.array(self.start) + index * np.array(self.velocity)
        return np.asarray(np.hypot(x - middle[0], y - middle[1]))

    def contains(self, index: int, x: Values, y: Values) -> Mask:
        """Return where the disc is in frame `index`."""
        return self.distance(index, x, y) < self.radius

    def visible_before(self, index: int, x: Values, y: Values) -> Mask:
        """Return where neither the disc nor the screen's border occluded the surface."""
        x_before, y_before = x - self.background_velocity[0], y - self.background_velocity[1]
        occluded = ~self.contains(index, x, y) & self.contains(index - 1, x_before, y_before)
        return super().visible_before(index, x, y) & ~occluded


WAVES_END, RINGS_END, CHECKS_END = 18.0, 46.0, 18.0
"""Units: waves are left of the first, rings between the two; right of them checks above the last, a line
below."""
WAVELENGTH = 1.1
RING_MIDDLE, RINGS_FINEST = (32.0, 18.0), 0.75
CHECK_SIDE = 6.0
LINE_HALF_WIDTH = 0.1
_DIRECTIONS = ((0.9, 0.4, 0.0), (0.3, 0.9, 1.0), (-0.6, 0.8, 2.0))


def still_life(x: Values, y: Values) -> Values:
    """Return the colours of the scene of `bench still`: fine waves, rings, a check pattern, a thin line.

    One frame at ratio 2 undersamples its waves and rings, so a method needs several jittered frames to
    resolve them; one jitter period suffices, as the patterns are smooth.
    """
    left = np.where((x < WAVES_END)[..., None], _waves(x, y), _rings(x, y))
    right = np.where((y < CHECKS_END)[..., None], _checks(x, y), _line(x, y))
    return np.where((x < RINGS_END)[..., None], left, right)


def still_scene() -> Plane:
    """Return the pattern under a static camera."""
    return Plane(still_life)


def still_scene_with_mover() -> DiscOverPlane:
    """Return the same scene with a disc that crosses its upper half from left to right."""
    return DiscOverPlane(
        velocity=(0.5, 0.0), background_velocity=(0.0, 0.0), start=(-4.0, 8.0), radius=4.0, pattern=still_life
    )


def _waves(x: Values, y: Values) -> Values:
    phases = [2.0 * np.pi * (a * x + b * y) / WAVELENGTH + start for a, b, start in _DIRECTIONS]
    return 0.45 + 0.35 * np.sin(np.stack(phases, axis=-1))


def _rings(x: Values, y: Values) -> Values:
    """Rings that are ever finer outwards, RINGS_FINEST apart 20 units from the middle."""
    dx, dy = x - RING_MIDDLE[0], y - RING_MIDDLE[1]
    return grey(0.5 + 0.45 * np.cos(np.pi * (dx * dx + dy * dy) / (20.0 * RINGS_FINEST)))


def _checks(x: Values, y: Values) -> Values:
    turned = np.cos(0.35) * x + np.sin(0.35) * y, np.cos(0.35) * y - np.sin(0.35) * x
    odd = sum(np.floor(v / CHECK_SIDE).astype(int) for v in turned) % 2
    return np.where(odd[..., None] == 1, (0.55, 0.4, 0.15), (0.2, 0.2, 0.25))


def _line(x: Values, y: Values) -> Values:
    away = np.abs(np.sin(0.3) * (x - 55.0) - np.cos(0.3) * (y - 27.0))
    behind = grey(0.2 + 0.1 * np.sin(x / 5.0))
    return np.where((away < LINE_HALF_WIDTH)[..., None], (1.0, 0.9, 0.7), behind)
