"""Path-tracing noise in the colour of training crops; references stay without noise.

The model: a pixel is the mean of a few samples. Each sample has a certain part, which every path finds, and a
random part: zero with some probability, else log-normal, with a tail of fireflies. Darker pixels have a
smaller certain part. docs/training.md compares its quantiles with those of Mitsuba 3.
"""

from typing import NamedTuple, Self

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from supersampler_model.ops.color import MAX_HALF, luminance

CHANCE = 0.06  # fraction of the crops with noise
SAMPLES = 1, 2, 4, 8, 16  # a pixel
LEAST_SPREAD, MOST_SPREAD = 0.6, 1.3  # of `PathNoise.spread`
MOST_CERTAIN, MOST_MISSED = 0.8, 0.3  # half of the crops with noise miss no path


class PathNoise(NamedTuple):
    """Parameters of the noise; the same in all frames of a crop.

    Attributes:
        samples: number of samples a pixel.
        certain: certain share of the light of the brightest pixels, [0, 1].
        missed: probability that the random part of a sample is zero, [0, 1).
        spread: standard deviation of the logarithm of the random part, > 0.
    """

    samples: int
    certain: float
    missed: float
    spread: float

    @classmethod
    def draw(cls, random: np.random.Generator) -> Self | None:
        """Draw the parameters of one crop; None for crops without noise."""
        if random.random() >= CHANCE:
            return None
        return cls(
            samples=int(random.choice(SAMPLES)),
            certain=float(random.uniform(0.0, MOST_CERTAIN)),
            missed=float(max(random.uniform(-MOST_MISSED, MOST_MISSED), 0.0)),
            spread=float(random.uniform(LEAST_SPREAD, MOST_SPREAD)),
        )

    def factors(self, certain: NDArray[np.float32], random: np.random.Generator) -> NDArray[np.float32]:
        """Return random factors of the pixels' colours, with a mean of 1.

        Args:
            certain: certain share of each pixel's light, [0, 1].
            random: of this frame.
        """
        shape = self.samples, *certain.shape
        logarithm = self.spread * random.standard_normal(shape, np.float32) - 0.5 * self.spread**2
        found = random.random(shape, np.float32) >= self.missed
        uncertain = (np.exp(logarithm) * found).mean(axis=0, dtype=np.float32) / np.float32(1.0 - self.missed)
        factors: NDArray[np.float32] = certain + (1.0 - certain) * uncertain
        return factors

    def on(self, color: Tensor, random: np.random.Generator) -> Tensor:
        """Return a frame's colour, (1, 3, h, w) linear RGB, multiplied by noise."""
        luma = luminance(color.clamp(min=0.0))
        certain = self.certain * luma / (luma + luma.mean() + 1e-12)
        return (color * torch.from_numpy(self.factors(certain.numpy(), random))).clamp(max=MAX_HALF)
