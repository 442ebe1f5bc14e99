"""Losses: error of display values, its change, structural dissimilarity, classes (docs/training.md)."""

from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional as F

from supersampler_model import ops

SSIM_SIZE, SSIM_SIGMA = 11, 1.5
C1, C2 = 0.01**2, 0.03**2  # constants of SSIM for values in [0, 1]


@dataclass(frozen=True)
class ImageWeights:
    """Weights of the loss terms."""

    rms: float = 1.0  # of each crop's root mean square error; absolute errors hardly depend on thin edges
    change: float = 0.5  # of the change of the error from frame to frame


@dataclass(frozen=True)
class ClassifierWeights(ImageWeights):
    """Weights of the loss terms.

    Where a pixel may be on either side of an edge, squared errors lead to the mean, and absolute errors to
    the median. `rms` is therefore larger than the default.
    """

    rms: float = 3.0
    ghost: float = 0.5  # extra weight of the image error where the history is invalid or missing
    classes: float = 0.05  # of the cross entropies
    rarest: float = 8.0  # maximum weight of a rare class in the cross entropies


def display_values(image: Tensor, exposure: Tensor) -> Tensor:
    """Convert linear RGB to display values: exposed, toned, sRGB (`supersampler.display_transform`)."""
    toned = ops.tone(image * exposure.reshape(-1, 1, 1, 1)).clamp(0.0, 1.0)
    bright = 1.055 * toned.clamp(min=0.0031308) ** (1.0 / 2.4) - 0.055
    return torch.where(toned <= 0.0031308, 12.92 * toned, bright)


def image_loss(error: Tensor, before: Tensor | None, weight: Tensor | float, weights: ImageWeights) -> Tensor:
    """Return the loss of an error in display values, (n, 3, H, W), NaN without reference.

    The change since the error `before` counts, too. `weight`, (n, 1, H, W), applies to the error only.
    """
    loss = _mean_error(error, weights.rms, weight)
    if before is not None:
        loss = loss + weights.change * _mean_error(error - before, weights.rms)
    return loss


def _mean_error(error: Tensor, rms: float, weight: Tensor | float = 1.0) -> Tensor:
    known = error.isfinite()
    error = torch.where(known, error, torch.zeros_like(error))
    count = known.sum(dim=(1, 2, 3)).clamp(min=1)
    squared = (weight * error * error).sum(dim=(1, 2, 3)) / count
    return (weight * error.abs()).sum() / count.sum() + rms * (squared + 1e-6).sqrt().mean()


def dissimilarity(image: Tensor, truth: Tensor) -> Tensor:
    """Return 1 - SSIM (Wang et al. 2004) of display values, under an 11x11 Gaussian, on luma.

    Returns:
        (n, 1, H, W), NaN where a window has no reference.
    """
    a, b = ops.luminance(image), ops.luminance(truth)
    maps = torch.cat([a, b, a * a, b * b, a * b], dim=1)
    mean_a, mean_b, aa, bb, ab = _gaussian_means(maps).split_with_sizes([1] * 5, dim=1)
    means = (2.0 * mean_a * mean_b + C1) / (mean_a * mean_a + mean_b * mean_b + C1)
    spread_a, spread_b = aa - mean_a * mean_a, bb - mean_b * mean_b
    return 1.0 - means * (2.0 * (ab - mean_a * mean_b) + C2) / (spread_a + spread_b + C2)


def _gaussian_means(maps: Tensor) -> Tensor:
    """Return the Gaussian mean of each channel over the part of the window inside the image."""
    offset = torch.arange(SSIM_SIZE, dtype=maps.dtype, device=maps.device) - SSIM_SIZE // 2
    kernel = (-0.5 * (offset / SSIM_SIGMA) ** 2).exp().expand(maps.shape[1], 1, 1, SSIM_SIZE)

    def sums(image: Tensor) -> Tensor:
        channels = image.shape[1]
        rows = F.conv2d(image, kernel[:channels], padding=(0, SSIM_SIZE // 2), groups=channels)
        turned = kernel[:channels].transpose(2, 3)
        return F.conv2d(rows, turned, padding=(SSIM_SIZE // 2, 0), groups=channels)

    return sums(maps) / sums(torch.ones_like(maps[:1, :1]))


def class_loss(logits: Tensor, ghost: Tensor, alias: Tensor, weights: ClassifierWeights) -> Tensor:
    """Return the cross entropy of both groups of classes. Rare classes have larger weights.

    Args:
        logits: (n, 6, H / 2, W / 2).
        ghost: (n, H, W) uint8, 0 to 2; other values are unknown.
        alias: (n, H, W) uint8, as `ghost`.
        weights: weights of the loss terms.
    """
    return weights.classes * (
        _entropy(logits[:, :3], class_fractions(ghost), weights.rarest)
        + _entropy(logits[:, 3:], class_fractions(alias), weights.rarest)
    )


def class_fractions(classes: Tensor) -> Tensor:
    """Return the fraction of each class in 2x2 pixels: (n, H, W) to (n, 3, H / 2, W / 2).

    Unknown pixels add 0. Sizes are rounded up; at an odd border, the fraction is of the existing pixels.
    """
    one_hot = torch.stack([classes == c for c in range(3)], dim=1).float()
    return F.avg_pool2d(one_hot, 2, ceil_mode=True)


def _entropy(logits: Tensor, fractions: Tensor, rarest: float) -> Tensor:
    balance = (1.0 / fractions.mean(dim=(0, 2, 3))).sqrt().clamp(max=rarest)
    weighted = fractions * balance[:, None, None]
    total = weighted.sum().clamp(min=1e-6)
    return -(weighted * logits.log_softmax(dim=1)).sum() / total
