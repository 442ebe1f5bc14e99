"""What the classifier is trained for beside its images: the classes of pixels."""

from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional as F

from supersampler_model.training.losses import ImageWeights


@dataclass(frozen=True)
class ClassifierWeights(ImageWeights):
    """Weights of the terms.

    Attributes:
        rms: more than of images in general: where a pixel may be on either side of an edge, squares lead to
            the mean, absolute errors to the likelier of the two.
        ghost: of the absolute error where the history is of no use, beside that everywhere.
        classes: of the cross entropies.
        rarest: the largest weight of a rare class in them.
    """

    rms: float = 3.0
    ghost: float = 0.5
    classes: float = 0.05
    rarest: float = 8.0


def class_loss(logits: Tensor, ghost: Tensor, alias: Tensor, weights: ClassifierWeights) -> Tensor:
    """Cross entropy of both groups, rare classes weighing more.

    Args:
        logits: (n, 6, H / 2, W / 2).
        ghost: (n, H, W) int64, 0 to 2; anything else is unknown.
        alias: (n, H, W) int64, the same.
        weights: of the terms.
    """
    return weights.classes * (
        _entropy(logits[:, :3], class_fractions(ghost), weights.rarest)
        + _entropy(logits[:, 3:], class_fractions(alias), weights.rarest)
    )


def class_fractions(classes: Tensor) -> Tensor:
    """(n, H, W) classes to their shares in each 2x2 pixels: (n, 3, H / 2, W / 2); 0 of what is unknown."""
    one_hot = torch.stack([classes == c for c in range(3)], dim=1).float()
    return F.avg_pool2d(one_hot, 2)


def _entropy(logits: Tensor, fractions: Tensor, rarest: float) -> Tensor:
    frequency = fractions.mean(dim=(0, 2, 3)).clamp(min=1e-6)
    balance = (1.0 / frequency).sqrt().clamp(max=rarest)
    weighted = fractions * balance[:, None, None]
    return -(weighted * logits.log_softmax(dim=1)).sum() / weighted.sum().clamp(min=1e-6)
