"""Structural dissimilarity, 1 - SSIM, as a loss (Wang et al. 2004): 11x11 Gaussian window, on luma."""

import torch
from torch import Tensor
from torch.nn import functional as F

from supersampler_model.ops.color import luminance

SIZE, SIGMA = 11, 1.5
C1, C2 = 0.01**2, 0.03**2  # constants of SSIM for values in [0, 1]


def dissimilarity(image: Tensor, truth: Tensor) -> Tensor:
    """(n, 1, H, W) 1 - SSIM of display values (n, 3, H, W), NaN where a window has no reference."""
    a, b = luminance(image), luminance(truth)
    maps = torch.cat([a, b, a * a, b * b, a * b], dim=1)
    mean_a, mean_b, aa, bb, ab = _blurred(maps).split_with_sizes([1] * 5, dim=1)
    means = (2.0 * mean_a * mean_b + C1) / (mean_a * mean_a + mean_b * mean_b + C1)
    spread_a, spread_b = aa - mean_a * mean_a, bb - mean_b * mean_b
    return 1.0 - means * (2.0 * (ab - mean_a * mean_b) + C2) / (spread_a + spread_b + C2)


def _blurred(maps: Tensor) -> Tensor:
    """Gaussian mean of each channel over the part of the window inside the image."""
    place = torch.arange(SIZE, dtype=maps.dtype, device=maps.device) - SIZE // 2
    weights = (-0.5 * (place / SIGMA) ** 2).exp()
    count = maps.shape[1]
    across = weights.expand(count, 1, 1, SIZE)
    ones = torch.ones_like(maps[:1, :1])

    def both(image: Tensor, kernel: Tensor) -> Tensor:
        channels = image.shape[1]
        rows = F.conv2d(image, kernel[:channels], padding=(0, SIZE // 2), groups=channels)
        turned = kernel[:channels].transpose(2, 3)
        return F.conv2d(rows, turned, padding=(SIZE // 2, 0), groups=channels)

    means: Tensor = both(maps, across) / both(ones, across)
    return means
