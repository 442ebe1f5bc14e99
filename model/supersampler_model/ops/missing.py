"""Missing samples of a frame: a mean of those around takes their place, where nothing better is known."""

import torch
from torch import Tensor

from supersampler.methods.missing import FILL_WINDOW, GREY_SHARE
from supersampler_model.ops.color import EXPOSURE_KEY
from supersampler_model.ops.size import render_size_of
from supersampler_model.ops.windows import cut, means_of, spread


def filled(color: Tensor, usable: Tensor, exposure: Tensor) -> Tensor:
    """Fill missing samples with the mean of the window that they are in.

    Windows have FILL_WINDOW x FILL_WINDOW samples. The mean is the square of the mean of square roots, so
    that highlights do not dominate. Where all of a window is missing, grey is shown.

    Args:
        color: (1, 3, h, w) linear RGB, finite.
        usable: (1, 1, h, w) 0 where a sample is missing, else 1.
        exposure: (1,) of the frame; it maps grey to EXPOSURE_KEY.

    Returns:
        (1, 3, h, w) linear RGB.
    """
    size, side = render_size_of(color), FILL_WINDOW
    values = torch.cat([color.sqrt(), torch.ones_like(usable)], dim=1) * usable
    whole = cut(cut(values, 2, size.height + side - 1), 3, size.width + side - 1)
    roots, share = spread(means_of(whole, side), side, size).split_with_sizes([3, 1], dim=1)
    mean = (roots + GREY_SHARE * (EXPOSURE_KEY / exposure).sqrt()) / (share + GREY_SHARE)
    return torch.where(usable > 0.0, color, mean * mean)
