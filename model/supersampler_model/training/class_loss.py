"""The classification loss of the classifier."""

from dataclasses import dataclass

import torch
from torch import Tensor
from torch.nn import functional as F

from supersampler_model.training.losses import ImageWeights
from supersampler_model.training.processes import mean_of_processes


@dataclass(frozen=True)
class ClassifierWeights(ImageWeights):
    """Weights of the loss terms.

    Attributes:
        rms: larger than the default: where a pixel may be on either side of an edge, squared errors lead to
            the mean, absolute errors to the median.
        ghost: extra weight of the image error where the history is invalid.
        classes: weight of the cross entropies.
        rarest: maximum weight of a rare class in them.
    """

    rms: float = 3.0
    ghost: float = 0.5
    classes: float = 0.05
    rarest: float = 8.0


def class_loss(logits: Tensor, ghost: Tensor, alias: Tensor, weights: ClassifierWeights) -> Tensor:
    """Cross entropy of both groups of classes; rare classes have larger weights.

    Args:
        logits: (n, 6, H / 2, W / 2).
        ghost: (n, H, W) int64, 0 to 2; other values are unknown.
        alias: (n, H, W) int64, the same.
        weights: of the loss terms.
    """
    return weights.classes * (
        _entropy(logits[:, :3], class_fractions(ghost), weights.rarest)
        + _entropy(logits[:, 3:], class_fractions(alias), weights.rarest)
    )


def class_fractions(classes: Tensor) -> Tensor:
    """Fraction of each class in 2x2 pixels: (n, H, W) to (n, 3, H / 2, W / 2); unknown pixels add 0.

    Sizes are rounded up; at an odd border the fraction is of the pixels that are there.
    """
    one_hot = torch.stack([classes == c for c in range(3)], dim=1).float()
    return F.avg_pool2d(one_hot, 2, ceil_mode=True)


def _entropy(logits: Tensor, fractions: Tensor, rarest: float) -> Tensor:
    frequency = mean_of_processes(fractions.mean(dim=(0, 2, 3))).clamp(min=1e-6)
    balance = (1.0 / frequency).sqrt().clamp(max=rarest)
    weighted = fractions * balance[:, None, None]
    total = mean_of_processes(weighted.sum()).clamp(min=1e-6)
    return -(weighted * logits.log_softmax(dim=1)).sum() / total
