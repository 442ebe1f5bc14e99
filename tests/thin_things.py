"""Thin geometry: hostile depth and motion, the occluding depth of a step, and the trail of a moving wire."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch

from noise import Size, noise
from supersampler import Frame, Upscaler, halton_jitter
from supersampler.frame import Float32
from supersampler_model.data.scenes.analytic import (
    EXTENT,
    FAR,
    NEAR,
    AnalyticScene,
    SurfaceSample,
    Values,
    grey,
)
from supersampler_model.ops.motion import occluding_depth, usable_depth, usable_motion

RENDER, DISPLAY, RATIO = (96, 54), (192, 108), 2.0
FRAMES, BORDER = 20, 16


def hostile(seed: int, size: Size) -> Frame:
    """Return a frame of tiny objects that move at random; some depth and motion is not usable."""
    rng = np.random.default_rng(seed)
    shape = size[::-1]
    near = rng.random(shape) < 0.15
    depth = np.where(near, 1.0, 0.01).astype(np.float32) * rng.random(shape, np.float32)
    depth[rng.random(shape) < 0.02] = np.nan
    moves = rng.random((*shape, 1)) < 0.6
    motion = np.where(moves, rng.normal(0.0, 4.0, (*shape, 2)), 0.0).astype(np.float32)
    motion[rng.random(shape) < 0.02] = (np.inf, 3.0)
    motion[rng.random(shape) < 0.02] = (1e9, -1e9)
    return replace(noise(seed, size), depth=depth, motion=motion, reset=True)


def expected_depth(frame: Frame) -> Float32:
    """Return the occluding depth of a frame, (h, w), by the operation in torch."""
    depth, motion = (torch.from_numpy(np.array(values)) for values in (frame.depth, frame.motion))
    usable = usable_depth(depth[None, None]), usable_motion(motion.permute(2, 0, 1)[None])
    expected: Float32 = occluding_depth(*usable)[0, 0].numpy()
    return expected


def kept_depth(upscaler: Upscaler, frame: Frame) -> Float32:
    """Return the occluding depth, (h, w), that a step on a frame leaves in the history."""
    upscaler.step(frame)
    history = upscaler.save_state().history
    assert history is not None
    surface = next(name for name in history if name.endswith(("surface", "depth")))
    kept: Float32 = np.asarray(history[surface])[0, 0 if surface.endswith("surface") else 1]
    return kept


@dataclass(frozen=True)
class Wire(AnalyticScene):
    """A dark wire, 0.6 render pixels wide, in front of a static light wall.

    Attributes:
        speed: to the right, render pixels a frame.
        level: whether it is horizontal, and so moves along itself; otherwise it is nearly vertical.
    """

    speed: float
    level: bool = False

    WALL, DARK, START, LEAN = 0.9, 0.02, 8.3, 0.05
    WIDTH = 0.6 * EXTENT[0] / RENDER[0]

    @property
    def step(self) -> float:
        """Units a frame."""
        return self.speed * EXTENT[0] / RENDER[0]

    def middle(self, index: int, y: Values) -> Values:
        """Return the position of a vertical wire at these heights, units."""
        return self.START + self.step * index + self.LEAN * y

    def surface(self, index: int, x: Values, y: Values) -> SurfaceSample:
        """Return the wire where it is, else the wall."""
        off = y - 0.51 * EXTENT[1] if self.level else x - self.middle(index, y)
        is_wire = np.abs(off) < 0.5 * self.WIDTH
        depth = np.where(is_wire, NEAR, FAR)
        motion = np.where(is_wire[..., None], (-self.step, 0.0), 0.0)
        toward = np.broadcast_to((0.0, 0.0, 1.0), (*x.shape, 3))
        color = grey(np.where(is_wire, self.DARK, self.WALL))
        return SurfaceSample(color, depth, motion, depth, toward, toward)


def last_image(upscaler: Upscaler, scene: AnalyticScene) -> Float32:
    """Return the image of the last of FRAMES frames."""
    for index in range(FRAMES):
        image = upscaler.step(scene.frame(index, RENDER, halton_jitter(index, RATIO)))
    return image


def trace(upscaler: Upscaler, speed: float) -> float:
    """Return the sum of the wall's errors where an upright wire was before, as a fraction of a whole wire."""
    scene, scale = Wire(speed), DISPLAY[0] / EXTENT[0]
    left = int((scene.middle(FRAMES - 1, np.zeros(1))[0] - 2.0) * scale)
    error = np.abs(last_image(upscaler, scene)[:, :left].mean(axis=2) - scene.WALL).sum()
    whole = (scene.WALL - scene.DARK) * scene.WIDTH * scale * DISPLAY[1]
    return float(error / whole)


def contrast(upscaler: Upscaler, speed: float) -> float:
    """Return the contrast of a level wire that moves along itself: of its darkest row, 1 for a black one."""
    scene = Wire(speed, level=True)
    rows = last_image(upscaler, scene)[:, BORDER:-BORDER].mean(axis=(1, 2))
    return float((scene.WALL - rows.min()) / (scene.WALL - scene.DARK))


def upscaler_of(method: str, **options: Any) -> Upscaler:
    """Return an Upscaler at the display size of the wire."""
    return Upscaler(method, display_size=DISPLAY, validate="off", **options)
