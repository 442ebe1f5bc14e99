"""The image loss: error of display values and of their change from frame to frame (docs/training.md)."""

from dataclasses import dataclass

import torch
from torch import Tensor

from supersampler_model.ops.color import tone
from supersampler_model.training.processes import mean_of_processes


@dataclass(frozen=True)
class ImageWeights:
    """Weights of the loss terms.

    Attributes:
        rms: weight of each crop's root mean square error; the absolute error hardly depends on thin edges.
        change: weight of the error's change from frame to frame.
    """

    rms: float = 1.0
    change: float = 0.5


def shown(image: Tensor, exposure: Tensor) -> Tensor:
    """Linear RGB to display values: exposed, toned, sRGB (`supersampler.display_transform`)."""
    toned = tone(image * exposure.reshape(-1, 1, 1, 1)).clamp(0.0, 1.0)
    bright = 1.055 * toned.clamp(min=0.0031308) ** (1.0 / 2.4) - 0.055
    return torch.where(toned <= 0.0031308, 12.92 * toned, bright)


def image_loss(error: Tensor, before: Tensor | None, weight: Tensor | float, weights: ImageWeights) -> Tensor:
    """Error of display values where the reference is known.

    Args:
        error: (n, 3, H, W) image minus reference, NaN without reference.
        before: error of the previous frame; None: there is none.
        weight: (n, 1, H, W) of the error, not of its change.
        weights: of the terms.
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
    known_values = mean_of_processes(count.sum().float())
    return (weight * error.abs()).sum() / known_values + rms * (squared + 1e-6).sqrt().mean()
