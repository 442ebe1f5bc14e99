"""Random frames of plausible content, for tests that need no particular scene."""

from typing import Any

import numpy as np

from supersampler import Frame

Size = tuple[int, int]


def noise(seed: int, size: Size = (32, 18), **overrides: Any) -> Frame:
    """Return a frame of textured colour on sloping depth, moving by about a pixel."""
    random = np.random.default_rng(seed)
    width, height = size
    y, x = np.mgrid[:height, :width].astype(np.float32)
    waves = np.stack([np.sin(0.3 * x + 0.2 * y), np.cos(0.2 * x - 0.4 * y), np.sin(0.1 * x + 0.5 * y)], -1)
    color = np.exp(waves + 0.3 * random.standard_normal(waves.shape))
    motion = np.stack([1.1 * np.sin(0.1 * y) + 0.3, 0.7 * np.cos(0.1 * x)], -1)
    fields: dict[str, Any] = {
        "color": color.astype(np.float32),
        "depth": (0.02 + 0.01 * (waves[..., 0] > 0.3) + 1e-4 * x).astype(np.float32),
        "motion": motion.astype(np.float32),
        "jitter": tuple(random.uniform(-0.5, 0.5, 2)),
        "reset": seed == 0,
    }
    return Frame(**{**fields, **overrides})
