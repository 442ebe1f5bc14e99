"""What a method makes of a thin thing that moves, and of hostile depth and motion."""

from dataclasses import replace

import numpy as np
import torch

from more_scenes import Wire
from noise import Size, noise
from supersampler import Frame, Upscaler, halton_jitter
from supersampler.frame import Float32
from supersampler_model.data.scenes.analytic import EXTENT
from supersampler_model.ops.motion import occluding_depth, usable_depth, usable_motion

RENDER, DISPLAY = (96, 54), (192, 108)
FRAMES = 20


def last_image(upscaler: Upscaler, scene: Wire) -> Float32:
    """Return the image of the last of FRAMES frames."""
    for index in range(FRAMES):
        image = upscaler.step(scene.frame(index, RENDER, halton_jitter(index, 2.0)))
    return image


def trace(upscaler: Upscaler, speed: float) -> float:
    """Return how much of an upright wire is left on the wall where it was before.

    Sum of the errors, as a fraction of that of one whole wire.
    """
    scene = Wire(speed)
    to_pixels = DISPLAY[0] / EXTENT[0]
    left = (scene.middle(FRAMES - 1, np.zeros(1))[0] - 2.0) * to_pixels
    wall = last_image(upscaler, scene)[:, : int(left)].mean(axis=2)
    wire = scene.WALL * scene.WIDTH * to_pixels * DISPLAY[1]
    return float(np.abs(wall - scene.WALL).sum() / wire)


def contrast(upscaler: Upscaler, speed: float) -> float:
    """Return how dark a level wire is that moves along itself, as a fraction of its contrast."""
    scene = Wire(speed, level=True)
    rows = last_image(upscaler, scene)[:, 16:-16].mean(axis=(1, 2))
    return float(1.0 - rows.min() / scene.WALL)


def hostile(seed: int, size: Size) -> Frame:
    """Thin and broad things that move at random, and values that are not usable."""
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
