"""Analytic scenes in numpy: exact references at any resolution and exact motion, without a renderer.

A scene is a function of the frame index and of positions on a screen of 64 x 36 units (16:9), rendered at any
image size: at 128 x 72, 1 unit is 2 pixels.

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
    depth_before: Values  # (...) reversed, of the same point in the previous frame
    normal: Values  # (..., 3) unit length, x right, y up, z to the camera; without the normal map
    normal_mapped: Values  # (..., 3) with the normal map


class AnalyticScene:
    """Base of the scenes: subclasses define surfaces, and this class samples them."""

    def surface(self, index: int, x: Values, y: Values) -> SurfaceSample:
        """Return the surfaces at (x, y) units in frame `index`."""
        raise NotImplementedError

    def cut(self, index: int) -> bool:
        """Return True where frame `index` is the first after a cut."""
        return index == 0

    def visible_before(self, index: int, x: Values, y: Values) -> Mask:
        """Return where the surfaces of frame `index` were visible in the previous frame."""
        motion = self.surface(index, x, y).motion
        x, y = x + motion[..., 0], y + motion[..., 1]
        inside = (x > 0) & (x < EXTENT[0]) & (y > 0) & (y < EXTENT[1])
        return np.asarray(inside & (not self.cut(index)))

    def frame(self, index: int, size: Size, jitter: Vector = (0.0, 0.0)) -> Frame:
        """Sample the scene once per pixel, at centre + jitter, in the conventions of `Frame`."""
        surface = self.surface(index, *places(size, jitter))
        motion = surface.motion * np.array(size) / EXTENT
        color, depth, motion = (a.astype(np.float32) for a in (surface.color, surface.depth, motion))
        reset = self.cut(index)
        return Frame(color=color, depth=depth, motion=motion, jitter=jitter, reset=reset, exposure=1.0)

    def truth(self, index: int, size: Size, samples: int = 16) -> Float32:
        """Average samples x samples regular samples of each pixel: (H, W, 3) linear RGB."""
        total = np.zeros((size[1], size[0], 3))
        for x, y in grids(size, samples):
            total += self.surface(index, x, y).color
        return (total / samples**2).astype(np.float32)

    def disoccluded(self, index: int, size: Size) -> Mask:
        """Return where the surface at a pixel's centre was occluded or off screen in the previous frame."""
        return ~self.visible_before(index, *places(size))


def places(size: Size, offset: Vector = (0.0, 0.0)) -> tuple[Values, Values]:
    """Return x and y, (H, W) each, in units, of all pixel centres + offset (pixels)."""
    width, height = size
    x = (np.arange(width) + 0.5 + offset[0]) * EXTENT[0] / width
    y = (np.arange(height) + 0.5 + offset[1]) * EXTENT[1] / height
    return tuple(np.meshgrid(x, y))  # type: ignore[return-value]


def grids(size: Size, samples: int) -> Iterator[tuple[Values, Values]]:
    """Yield the places of samples x samples regular samples per pixel, one sample of all pixels at a time."""
    offsets = (np.arange(samples) + 0.5) / samples - 0.5
    for dy in offsets:
        for dx in offsets:
            yield places(size, (dx, dy))


def plain(x: Values, y: Values) -> Values:
    """Uniform grey: only depth and motion vary."""
    return np.broadcast_to(0.5, (*np.broadcast(x, y).shape, 3))


def zone_plate(x: Values, y: Values) -> Values:
    """Rings that become finer outwards, up to one ring per unit in the corners."""
    dx, dy = x - EXTENT[0] / 2, y - EXTENT[1] / 2
    finest = np.hypot(*EXTENT) / 2  # distance of the corners, where the phase grows by 2 pi per unit
    return grey(0.5 + 0.5 * np.cos(np.pi / finest * (dx * dx + dy * dy)))


def checker(x: Values, y: Values) -> Values:
    """Orange and blue squares of 3.7 units, turned by 20 degrees so that their edges alias."""
    return np.where(_odd_squares(x, y, 3.7)[..., None], (0.9, 0.5, 0.1), (0.05, 0.1, 0.3))


def _odd_squares(x: Values, y: Values, side: float) -> Mask:
    turned = np.cos(0.35) * x + np.sin(0.35) * y, np.cos(0.35) * y - np.sin(0.35) * x
    return np.asarray(sum(np.floor(v / side).astype(int) for v in turned) % 2 == 1)


def frontal(x: Values, y: Values) -> Values:
    """Normals that face the camera."""
    return np.broadcast_to((0.0, 0.0, 1.0), (*np.broadcast(x, y).shape, 3))


def from_spokes(x: Values, y: Values) -> Values:
    """Return the distance to the nearest of twelve lines through the screen's middle, units."""
    dx, dy = x - EXTENT[0] / 2, y - EXTENT[1] / 2
    angles = np.pi * (np.arange(12) + 0.3) / 12  # +0.3: none along an axis
    return np.asarray(np.abs(dx[..., None] * np.sin(angles) - dy[..., None] * np.cos(angles)).min(axis=-1))


def grey(values: Values) -> Values:
    """Repeat values (...) to (..., 3)."""
    return np.repeat(values[..., None], 3, axis=-1)


@dataclass(frozen=True)
class Plane(AnalyticScene):
    """A pattern that fills the screen and pans."""

    pattern: Pattern
    velocity: Vector = (0.0, 0.0)  # units a frame
    bumps: Pattern = frontal  # normal map, which pans with the pattern

    def surface(self, index: int, x: Values, y: Values) -> SurfaceSample:
        """Return the moved pattern."""
        there = x - index * self.velocity[0], y - index * self.velocity[1]
        depth = np.full(x.shape, FAR)
        motion = np.broadcast_to(-np.array(self.velocity), (*x.shape, 2))  # previous minus current
        return SurfaceSample(self.pattern(*there), depth, motion, depth, frontal(x, y), self.bumps(*there))


@dataclass(frozen=True)
class WiresOverPlane(AnalyticScene):
    """Static white wires near the camera, in front of a static plane."""

    background: Plane = Plane(plain)

    def surface(self, index: int, x: Values, y: Values) -> SurfaceSample:
        """Return the wires, and the plane between them."""
        behind, wires = self.background.surface(index, x, y), from_spokes(x, y) < 0.2
        color, depth = np.where(wires[..., None], 1.0, behind.color), np.where(wires, NEAR, FAR)
        return behind._replace(color=color, depth=depth, depth_before=depth)


@dataclass(frozen=True)
class DiscOverPlane(AnalyticScene):
    """A near disc with rings over a panning background: it occludes at its front and disoccludes at its back.

    The rings move with the disc. `start` and `radius` are in units, velocities in units a frame.
    """

    velocity: Vector = (1.0, 0.5)
    background_velocity: Vector = (-0.5, 0.0)
    start: Vector = (20.0, 14.0)
    radius: float = 8.0
    pattern: Pattern = checker

    def surface(self, index: int, x: Values, y: Values) -> SurfaceSample:
        """Return the disc, and the background around it."""
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
        """Return where the surface was on screen and not behind the disc."""
        x_before, y_before = x - self.background_velocity[0], y - self.background_velocity[1]
        occluded = ~self.contains(index, x, y) & self.contains(index - 1, x_before, y_before)
        return super().visible_before(index, x, y) & ~occluded


WAVES_END, RINGS_END, CHECKS_END = 18.0, 46.0, 18.0
"""Ends of the waves on the left, of the rings, and of the checks above the line on the right, units."""
WAVELENGTH = 1.1
RING_MIDDLE, RINGS_FINEST = (32.0, 18.0), 0.75  # units; distance between rings 20 units from the middle
CHECK_SIDE = 6.0
LINE_HALF_WIDTH = 0.1
_DIRECTIONS = ((0.9, 0.4, 0.0), (0.3, 0.9, 1.0), (-0.6, 0.8, 2.0))


def still_life(x: Values, y: Values) -> Values:
    """Return the colours of the scene of `bench still`: fine waves, rings, a check pattern, a thin line.

    One frame at ratio 2 undersamples the waves and rings. They are smooth: one jitter period resolves them.
    """
    phases = [2.0 * np.pi * (a * x + b * y) / WAVELENGTH + start for a, b, start in _DIRECTIONS]
    waves = 0.45 + 0.35 * np.sin(np.stack(phases, axis=-1))
    dx, dy = x - RING_MIDDLE[0], y - RING_MIDDLE[1]
    rings = grey(0.5 + 0.45 * np.cos(np.pi * (dx * dx + dy * dy) / (20.0 * RINGS_FINEST)))
    left = np.where((x < WAVES_END)[..., None], waves, rings)
    checks = np.where(_odd_squares(x, y, CHECK_SIDE)[..., None], (0.55, 0.4, 0.15), (0.2, 0.2, 0.25))
    away = np.abs(np.sin(0.3) * (x - 55.0) - np.cos(0.3) * (y - 27.0))
    behind = grey(0.2 + 0.1 * np.sin(x / 5.0))
    line = np.where((away < LINE_HALF_WIDTH)[..., None], (1.0, 0.9, 0.7), behind)
    right = np.where((y < CHECKS_END)[..., None], checks, line)
    return np.where((x < RINGS_END)[..., None], left, right)


def still_scene() -> Plane:
    """Return `still_life` under a static camera."""
    return Plane(still_life)


def still_scene_with_mover() -> DiscOverPlane:
    """Return the same scene with a disc that crosses its upper half from left to right."""
    return DiscOverPlane(
        velocity=(0.5, 0.0), background_velocity=(0.0, 0.0), start=(-4.0, 8.0), radius=4.0, pattern=still_life
    )
