"""What images are trained for (notes in docs/training.md)."""

from dataclasses import dataclass

import torch
from torch import Tensor

from supersampler_model.ops.color import tone


@dataclass(frozen=True)
class ImageWeights:
    """Weights of the terms.

    Attributes:
        rms: of each crop's root mean square error beside the absolute one, which thin edges hardly move.
        change: of the error's change from frame to frame.
    """

    rms: float = 1.0
    change: float = 0.5


def shown(image: Tensor, exposure: Tensor) -> Tensor:
    """Linear RGB as a screen shows it: exposed, toned, sRGB (`supersampler.display_transform`)."""
    toned = tone(image * exposure.reshape(-1, 1, 1, 1)).clamp(0.0, 1.0)
    bright = 1.055 * toned.clamp(min=0.0031308) ** (1.0 / 2.4) - 0.055
    return torch.where(toned <= 0.0031308, 12.92 * toned, bright)


def image_loss(off: Tensor, before: Tensor | None, weight: Tensor | float, weights: ImageWeights) -> Tensor:
    """Error of shown images, over what is known.

    Args:
        off: (n, 3, H, W) image minus truth, NaN where there is no truth.
        before: that of the previous frame; None where there is none.
        weight: (n, 1, H, W) of the error, not of its change.
        weights: of the terms.
    """
    loss = _mean_error(off, weights.rms, weight)
    if before is not None:
        loss = loss + weights.change * _mean_error(off - before, weights.rms)
    return loss


def _mean_error(off: Tensor, rms: float, weight: Tensor | float = 1.0) -> Tensor:
    known = off.isfinite()
    off = torch.where(known, off, torch.zeros_like(off))
    count = known.sum(dim=(1, 2, 3)).clamp(min=1)
    squared = (weight * off * off).sum(dim=(1, 2, 3)) / count
    return (weight * off.abs()).sum() / count.sum() + rms * (squared + 1e-6).sqrt().mean()
