"""Frames of a path tracer: a texture that moves over a wall, with noise that changes from frame to frame."""

from typing import Any

import numpy as np

from supersampler import Frame
from supersampler.frame import Float32

SIZE = (48, 30)
VELOCITY = (1.3, -0.7)  # pixels a frame


def truth(index: int, size: tuple[int, int] = SIZE) -> Float32:
    width, height = size
    y, x = np.mgrid[:height, :width]
    x, y = x - VELOCITY[0] * index, y - VELOCITY[1] * index
    waves = np.stack([np.sin(0.5 * x + 0.2 * y), np.cos(0.3 * x - 0.4 * y), np.sin(0.1 * x + 0.6 * y)], -1)
    return np.exp(0.5 * waves).astype(np.float32)


def noisy(index: int, *, noise: float = 0.05, size: tuple[int, int] = SIZE, **overrides: Any) -> Frame:
    """Return a frame; `noise` is the standard deviation over the colour."""
    width, height = size
    generator = np.random.default_rng(index)
    clean = truth(index, size)
    color = clean * (1.0 + noise * generator.standard_normal((height, width, 1)))
    motion = np.broadcast_to(np.array([-v for v in VELOCITY], np.float32), (height, width, 2))
    normal = np.broadcast_to(np.array([0.0, 0.0, 1.0], np.float32), (height, width, 3))
    fields: dict[str, Any] = {
        "color": np.clip(color, 0.0, None).astype(np.float32),
        "depth": np.full((height, width), 0.5, np.float32),
        "motion": motion.copy(),
        "jitter": (0.0, 0.0),
        "reset": index == 0,
        "gbuffer": {"base_color": np.full((height, width, 3), 0.5, np.float32), "normal": normal.copy()},
    }
    return Frame(**{**fields, **overrides})


def decibels(image: Float32, index: int) -> float:
    """Return the PSNR of an image of a frame, without two pixels at each edge."""
    height, width, _ = image.shape
    error = (image - truth(index, (width, height)))[2:-2, 2:-2]
    return float(-10.0 * np.log10(np.square(error, dtype=np.float64).mean()))
