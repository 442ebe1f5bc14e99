"""Pass 5, second part: luma that flickers with the jitter, and the history clamped to this frame's box."""

from typing import NamedTuple

import numpy as np

from supersampler.frame import Array
from supersampler_bench.fsr2.buffers import View, lerp, saturate
from supersampler_bench.fsr2.upsample import Box

_STEP = 1.0 / 255.0  # of the lumas, which FSR2 keeps in 8 bits


class Instability(NamedTuple):
    """Whether the luma flickers, (H, W), and the lumas of four frames, (H, W, 4), the latest first."""

    factor: Array
    lumas: Array


def luma_instability(box: Box, lumas: Array, reactive: Array, mask: Array) -> Instability:
    """Find pixels whose luma is nearer to that of an older frame than to the last one's.

    Args:
        box: of this frame.
        lumas: (H, W, 4) of the previous frames, reprojected; 0 where they are not known.
        reactive: (H, W).
        mask: (H, W), of diverging motion.
    """
    bright = box.centre[..., 0]
    luma = np.rint(bright / (1.0 + np.maximum(bright, 0.0)) * 255.0).astype(np.float32) / np.float32(255.0)
    differences = luma[..., None] - lumas
    last, older = differences[..., 0], differences[..., 1:]
    same_side = np.sign(older) == np.sign(last)[..., None]
    closest = np.where(same_side, np.abs(older), np.float32(np.inf)).min(axis=-1)
    size = saturate(box.deviation[..., 0] / np.float32(0.1)) ** 6
    flickers = (np.abs(last) >= _STEP) & (closest < np.abs(last)) & (size > _STEP)
    trusted = 1.0 - np.maximum(mask, np.power(reactive, np.float32(1.0 / 6.0)))
    known = lumas[..., 2] != 0.0  # the oldest of the four lumas that are stored below
    shifted = np.concatenate([luma[..., None], lumas[..., :3]], axis=-1)
    return Instability(np.where(flickers & known, trusted, np.float32(0.0)), shifted)


def rectify(
    history: Array,
    accumulation: Array,
    box: Box,
    kept: Array,
    view: View,
    *,
    untrusted: Array,
    speed: Array,
) -> tuple[Array, Array]:
    """Clamp the history to the box, and shorten its accumulation where it was outside.

    Args:
        history: (H, W, 3) YCoCg.
        accumulation: (H, W), weight of the history.
        box: of this frame.
        kept: (H, W), how far locks and flicker keep the history as it is.
        view: of the frame.
        untrusted: (H, W), the larger of disocclusion and diverging motion.
        speed: (H, W) display pixels.
    """
    widest = min(20.0, float(view.upscale[0] * view.upscale[1]) ** 3)
    scale = lerp(widest, 1.0, np.maximum(untrusted, saturate(speed / np.float32(20.0))))[..., None]
    low = np.maximum(box.least, box.centre - scale * box.deviation)
    high = np.minimum(box.most, box.centre + scale * box.deviation)
    outside = np.asarray(((history < low) | (history > high)).any(axis=-1))
    clamped = np.where(outside[..., None], np.clip(history, low, high), history)
    shortened = np.where(outside, np.minimum(accumulation, 0.1), accumulation)
    kept = saturate(kept)
    return lerp(clamped, history, kept[..., None]), lerp(shortened, accumulation, kept)
