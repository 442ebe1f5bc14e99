"""Frames of noise on surfaces of a few kinds, and what models extrapolate from them."""

from dataclasses import replace
from typing import Any

import numpy as np

from noise import Size, noise
from supersampler import Frame
from supersampler.extrapolation import Extrapolator
from supersampler.frame import Float32

SIZES = [(32, 18), (33, 17), (61, 35), (5, 40), (16, 3), (1, 1)]
KINDS = 5
"""Surfaces that noise is of: a sample has likes, near and far."""


def surfaces(seed: int, size: Size = (32, 18), **overrides: Any) -> Frame:
    """Noise on surfaces of a few kinds; every second frame moves by far more than rings reach."""
    random = np.random.default_rng([seed, 7])
    kind = random.integers(0, KINDS, size[::-1])
    look = np.random.default_rng(1).random((KINDS, 7), dtype=np.float32)
    frame = noise(seed, size)
    gbuffer = {"base_color": look[kind, :3], "normal": 2.0 * look[kind, 3:6] - 1.0}
    motion = frame.motion * (20.0 if seed % 2 else 1.0)
    return replace(frame, depth=look[kind, 6], motion=motion, gbuffer=gbuffer, reset=False, **overrides)


def extrapolated(model: Extrapolator, frames: list[Frame], pattern: str) -> list[Float32]:
    history, images = None, []
    for frame, kind in zip(frames, pattern, strict=True):
        if kind == "s":
            history = model.after_shaded(frame, history)
            continue
        image, history = model.extrapolate(replace(frame, color=None), history)
        images.append(image)
    return images


def spoilt(image: Any, spots: Any, bad: float) -> Float32:
    copy = np.array(image, np.float32)
    copy[spots] = bad
    return copy


def spoilt_frames(bad: float, *, shaded: bool) -> list[Frame]:
    """Four frames; a tenth of the pixels of the shaded one, or of the next one, have a bad value."""
    frames = [surfaces(seed) for seed in range(4)]
    index = 0 if shaded else 1
    spots = np.random.default_rng(0).random((18, 32)) < 0.1
    gbuffer = {name: spoilt(image, spots, bad) for name, image in (frames[index].gbuffer or {}).items()}
    fields: dict[str, Any] = {n: spoilt(getattr(frames[index], n), spots, bad) for n in ("depth", "motion")}
    color = spoilt(frames[index].color, spots[::-1], bad)
    frames[index] = replace(frames[index], gbuffer=gbuffer, color=color, **fields)
    return frames
