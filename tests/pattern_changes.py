"""A still pattern that is inverted at times, as bright and as fine as before: what a mean must tell."""

from collections.abc import Collection

import numpy as np

from supersampler import Frame, halton_jitter
from supersampler.frame import Size

FRAMES = 44
EARLY = (16, 17)
"""Inverted while means are of few samples: they are kept."""
ONCE, TWICE = 30, (36, 37)
"""Inverted in one frame: doubted. In the second of two the samples follow the mean a little: they confirm."""
SLOPES = {16: -1.0, 17: -1.0, ONCE: -1.0, 36: -1.0, 37: 0.15}
"""Of the samples on the pattern, in frames in which it is not 1."""


def frames(size: Size, repeated: Collection[int] = ()) -> list[Frame]:
    """Return waves of 2.5 samples, strong ones in the left half, and so faint ones that they never count.

    Args:
        size: (width, height).
        repeated: frames that have the jitter of the previous one.
    """
    width, height = size
    strength = np.where(np.arange(width) < width // 2, 0.3, 0.02)
    jitters = [halton_jitter(index - (index in repeated), 2.0) for index in range(FRAMES)]
    return [_frame(index, jitter, strength, height) for index, jitter in enumerate(jitters)]


def _frame(index: int, jitter: tuple[float, float], strength: np.ndarray, height: int) -> Frame:
    width = len(strength)
    waves = np.cos(2.0 * np.pi * (np.arange(width) + 0.5 + jitter[0]) / 2.5)
    row = 0.5 + SLOPES.get(index, 1.0) * strength * waves
    return Frame(
        color=np.broadcast_to(row[None, :, None], (height, width, 3)).astype(np.float32),
        depth=np.ones((height, width), np.float32),
        motion=np.zeros((height, width, 2), np.float32),
        jitter=jitter,
        exposure=1.0,
    )
