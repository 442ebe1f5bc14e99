"""Noise of path tracers in training crops: few samples a pixel, the reference without noise.

A sample of a pixel brings light in two parts. One is certain: light from large sources that no path misses.
The other comes along random paths: none at all with some probability, else light of a logarithmic normal
distribution, whose tail are fireflies. A pixel is the mean of its samples. Where less light arrives, less of
it is certain. `python bench/studies/noise_model.py` compares the quantiles with those of Mitsuba 3.
"""

from typing import NamedTuple, Self

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from supersampler_model.ops.color import MAX_HALF, luminance

CHANCE = 0.06  # fraction of the crops with noise
SAMPLES = 1, 2, 4, 8, 16
LEAST_SPREAD, MOST_SPREAD = 0.6, 1.3
MOST_CERTAIN, MOST_MISSED = 0.8, 0.3


class PathNoise(NamedTuple):
    """Noise of a path tracer; the same in all frames of a crop.

    Attributes:
        samples: of a pixel.
        certain: share of the light that every path brings, where a surface is bright.
        missed: probability that a path brings nothing else.
        spread: standard deviation of the logarithm of what else it brings.
    """

    samples: int
    certain: float
    missed: float
    spread: float

    @classmethod
    def draw(cls, random: np.random.Generator) -> Self | None:
        """Draw that of a crop; None for most: no noise."""
        if random.random() >= CHANCE:
            return None
        return cls(
            samples=int(random.choice(SAMPLES)),
            certain=float(random.uniform(0.0, MOST_CERTAIN)),
            missed=float(max(random.uniform(-MOST_MISSED, MOST_MISSED), 0.0)),
            spread=float(random.uniform(LEAST_SPREAD, MOST_SPREAD)),
        )

    def factors(self, certain: NDArray[np.float32], random: np.random.Generator) -> NDArray[np.float32]:
        """Return what pixels are multiplied by, of mean 1, given the share of each that is certain."""
        shape = self.samples, *certain.shape
        logarithm = self.spread * random.standard_normal(shape, np.float32) - 0.5 * self.spread**2
        found = random.random(shape, np.float32) >= self.missed
        uncertain = (np.exp(logarithm) * found).mean(axis=0, dtype=np.float32) / np.float32(1.0 - self.missed)
        factors: NDArray[np.float32] = certain + (1.0 - certain) * uncertain
        return factors

    def on(self, color: Tensor, random: np.random.Generator) -> Tensor:
        """Return colour (1, 3, h, w), linear RGB, with the noise of one frame."""
        luma = luminance(color.clamp(min=0.0))
        certain = self.certain * luma / (luma + luma.mean() + 1e-12)
        return (color * torch.from_numpy(self.factors(certain.numpy(), random))).clamp(max=MAX_HALF)
