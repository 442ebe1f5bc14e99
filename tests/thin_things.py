"""Hostile depth and motion, and the occluding depth that a step leaves of them."""

from dataclasses import replace

import numpy as np
import torch

from noise import Size, noise
from supersampler import Frame, Upscaler
from supersampler.frame import Float32
from supersampler_model.ops.motion import occluding_depth, usable_depth, usable_motion


def hostile(seed: int, size: Size) -> Frame:
    """Return a frame of tiny things that move at random; some depth and motion is not usable."""
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
