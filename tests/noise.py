"""Random frames of plausible content, for tests that need no particular scene."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from supersampler import Frame, Shot
from supersampler.io.shot import ShotWriter

Size = tuple[int, int]
MASKED_DISPLAY = (65, 37)
"""(width, height) of the images of `masked_shot`."""


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


def full_noise(seed: int, size: Size = (32, 18), display: Size = (64, 36)) -> Frame:
    """Return a frame with every field; some arrays are halves, or do not lie in one piece."""
    random, plain = np.random.default_rng(seed), noise(seed, size)
    (width, height), (wide, high) = size, display
    return replace(
        plain,
        color=np.asarray(plain.color).astype(np.float16),
        motion=np.asfortranarray(plain.motion),
        exposure=0.7 + 0.1 * seed,
        pre_exposure=1.3 + seed,
        reactive=random.random((height, width), np.float32).astype(np.float16),
        gbuffer={"normal": random.random((height, width, 3), np.float32)},
        gbuffer_display={"depth": random.random((high, wide), np.float32)},
        aovs=random.random((height, width, 4), np.float32)[..., ::2],
        ids=random.integers(-9, 9, (height, width, 2), np.int16),
    )


def masked_shot(folder: Path) -> Shot:
    """Write four frames: one has a reactive mask, two a pre-exposure, one an exposure."""
    mask = np.linspace(0.0, 1.0, 32 * 18, dtype=np.float32).reshape(18, 32)
    changes: list[dict[str, Any]] = [{}, {"pre_exposure": 4.0}, {"reactive": mask}, {"pre_exposure": 0.25}]
    changes[3]["exposure"] = 0.5
    with ShotWriter(folder, name="masked", display_size=MASKED_DISPLAY, frame_rate=30.0) as writer:
        for index, changed in enumerate(changes):
            frame = noise(index, **changed)
            assert frame.color is not None
            frame.color[...] *= frame.pre_exposure
            writer.write(frame)
    return Shot.open(folder)
