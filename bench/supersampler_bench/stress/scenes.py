"""Frames for scenarios: a static scene, and a moving one that repeats."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache
from math import lcm

import numpy as np

from supersampler import Frame, halton_jitter
from supersampler.conventions import jitter_phase_count
from supersampler.frame import Float32, Size
from supersampler_model.data.scenes import analytic

RATIO = 2.0
PERIOD = jitter_phase_count(RATIO)
LAP = 40  # frames after which the moving scene repeats
LOOP = lcm(PERIOD, LAP)
"""Frames after which scene and jitter repeat, and images must repeat, too."""
STILL: analytic.AnalyticScene = analytic.WiresOverPlane(analytic.Plane(analytic.checker))


@dataclass(frozen=True)
class Orbit(analytic.AnalyticScene):
    """A near, ringed disc that circles in front of a swinging plane; the scene repeats after `LAP` frames."""

    def surface(self, index: int, x: analytic.Values, y: analytic.Values) -> analytic.SurfaceSample:
        """See `AnalyticScene.surface`."""
        plane, plane_before = _swing(index), _swing(index - 1)
        disc, disc_before = _round(index), _round(index - 1)
        distance = np.hypot(x - disc[0], y - disc[1])
        inside = distance < 9.0
        depth = np.where(inside, analytic.NEAR, analytic.FAR)
        color = np.where(
            inside[..., None],
            analytic.grey(0.5 + 0.5 * np.cos(2.0 * distance)),
            analytic.checker(x - plane[0], y - plane[1]),
        )
        motion = np.where(inside[..., None], disc_before - disc, plane_before - plane)
        return analytic.SurfaceSample(
            color, depth, motion, depth, analytic.frontal(x, y), analytic.frontal(x, y)
        )


def _swing(index: int) -> analytic.Values:
    angle = 2.0 * np.pi * index / LAP
    return np.array([6.0 * np.sin(angle), 2.0 * np.cos(angle)])


def _round(index: int) -> analytic.Values:
    angle = 2.0 * np.pi * index / LAP
    return np.array([32.0 + 14.0 * np.cos(angle), 18.0 + 8.0 * np.sin(angle)])


@cache
def still(render: Size, every: int = 1) -> Sequence[Frame]:
    """Return one jitter period of the static scene; `every`: see `scene_frames`."""
    return scene_frames(STILL, render, PERIOD * every, every)


@cache
def moving(render: Size, every: int = 1) -> Sequence[Frame]:
    """Return one loop of the moving scene; `every`: see `scene_frames`."""
    return scene_frames(Orbit(), render, lcm(PERIOD * every, LAP), every)


def scene_frames(scene: analytic.AnalyticScene, render: Size, count: int, every: int = 1) -> Sequence[Frame]:
    """Return frames of a scene without a reset; `every` consecutive frames have the same jitter."""
    frames = (scene.frame(i, render, halton_jitter(i // every, RATIO)) for i in range(count))
    return [replace(frame, reset=False) for frame in frames]


@cache
def truth(scene: analytic.AnalyticScene, index: int, display: Size) -> Float32:
    """Return the exact image of a frame."""
    return scene.truth(index, display, 8)
