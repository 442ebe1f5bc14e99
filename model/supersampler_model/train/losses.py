"""What the classifier and its compositor are trained for (notes in docs/methods.md)."""

from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional as F

from supersampler_model.color import tone


@dataclass(frozen=True)
class LossWeights:
    """Weights of the terms.

    Attributes:
        rms: of each crop's root mean square error beside the absolute one, which thin edges hardly move.
        ghost: of the absolute error where the past is of no use, beside that everywhere.
        change: of the error's change from frame to frame.
        classes: of the cross entropies.
        rarest: the largest weight of a rare class in them.
    """

    rms: float = 1.0
    ghost: float = 0.5
    change: float = 0.5
    classes: float = 0.05
    rarest: float = 8.0


def shown(image: Tensor, exposure: Tensor) -> Tensor:
    """Linear RGB as a screen shows it: exposed, toned, sRGB (`supersampler.display_transform`)."""
    toned = tone(image * exposure.reshape(-1, 1, 1, 1)).clamp(0.0, 1.0)
    bright = 1.055 * toned.clamp(min=0.0031308) ** (1.0 / 2.4) - 0.055
    return torch.where(toned <= 0.0031308, 12.92 * toned, bright)


def picture_loss(off: Tensor, before: Tensor | None, ghost: Tensor, weights: LossWeights) -> Tensor:
    """Error of shown pictures, over what is known.

    Args:
        off: (n, 3, H, W) picture minus truth, NaN where there is no truth.
        before: that of the frame before; None where there is none.
        ghost: (n, 1, H, W) 1 where the past is of no use.
        weights: of the terms.
    """
    weighted = 1.0 + weights.ghost * ghost
    loss = _mean_error(off, weights.rms, weighted)
    if before is not None:
        loss = loss + weights.change * _mean_error(off - before, weights.rms)
    return loss


def _mean_error(off: Tensor, rms: float, weight: Tensor | float = 1.0) -> Tensor:
    known = off.isfinite()
    off = torch.where(known, off, torch.zeros_like(off))
    count = known.sum(dim=(1, 2, 3)).clamp(min=1)
    squared = (weight * off * off).sum(dim=(1, 2, 3)) / count
    return (weight * off.abs()).sum() / count.sum() + rms * (squared + 1e-6).sqrt().mean()


def class_loss(logits: Tensor, ghost: Tensor, alias: Tensor, weights: LossWeights) -> Tensor:
    """Cross entropy of both groups, rare classes weighing more.

    Args:
        logits: (n, 6, H / 2, W / 2).
        ghost: (n, H, W) int64, 0 to 2; anything else is unknown.
        alias: (n, H, W) int64, the same.
        weights: of the terms.
    """
    return weights.classes * (
        _entropy(logits[:, :3], shares_of(ghost), weights.rarest)
        + _entropy(logits[:, 3:], shares_of(alias), weights.rarest)
    )


def shares_of(classes: Tensor) -> Tensor:
    """(n, H, W) classes to their shares in each 2x2 pixels: (n, 3, H / 2, W / 2); 0 of what is unknown."""
    one_hot = torch.stack([classes == c for c in range(3)], dim=1).float()
    return F.avg_pool2d(one_hot, 2)


def _entropy(logits: Tensor, shares: Tensor, rarest: float) -> Tensor:
    frequency = shares.mean(dim=(0, 2, 3)).clamp(min=1e-6)
    balance = (1.0 / frequency).sqrt().clamp(max=rarest)
    weighted = shares * balance[:, None, None]
    return -(weighted * logits.log_softmax(dim=1)).sum() / weighted.sum().clamp(min=1e-6)
