"""Upsampling of one frame along its edges, for pixels without history.

Steering kernel regression (Takeda, Farsiu and Milanfar 2007): the samples around a pixel are averaged under a
Gaussian whose axes are those of the structure tensor of luma, and whose two deviations depend on the tensor's
coherence. Gradients and samples are those of the 4x4 samples around the pixel, and their weights end at 0 there.
"""

from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn import functional as F

from supersampler.methods.constants import (
    ACROSS,
    ALONG,
    EDGE_CONTRAST,
    EDGE_SIGMA,
    MIN_WEIGHT,
)
from supersampler_model.ops.images import channels_of, padded_3x3, pick_columns, size_of, sum_of
from supersampler_model.ops.sampling import Bands, Grid, GridAxis, bands, linear, resample


class Form(NamedTuple):
    """Quadratic form xx x^2 + xy x y + yy y^2 of a distance (x, y) in render pixels, each (1, 1, H, W)."""

    xx: Tensor
    xy: Tensor
    yy: Tensor


def upsample_along_edges(color: Tensor, usable: Tensor, grid: Grid) -> Tensor:
    """Upsample the usable samples, (1, 3, H, W), by Gaussians that are long along edges and narrow across.

    Args:
        color: (1, 3, h, w), its first channel luma, toned; filled where samples are missing, which is the
            result where no usable one is among the 4x4 samples around.
        usable: (1, 1, h, w) 1 or 0.
        grid: grid of the display pixels.
    """
    form = steering_form(structure_tensor(color[:, :1], grid))
    samples, size = torch.cat([color * usable, usable], dim=1), size_of(color)
    columns, rows = _taps(grid.x, size.width), _taps(grid.y, size.height)
    sums = []
    for row, y in rows:
        line, y = samples.index_select(2, row), y[:, None]
        for column, x in columns:
            distance = form.xx * (x * x) + form.xy * (y * x) + form.yy * (y * y)
            weight = (-0.5 * distance).exp() * (window(x) * window(y))
            sums.append(weight * pick_columns(line, column))
    total, weight = sum_of(sums).split_with_sizes([3, 1], dim=1)
    return torch.where(weight > MIN_WEIGHT, total / weight.clamp(min=MIN_WEIGHT), grid.pick(color))


def structure_tensor(luma: Tensor, grid: Grid) -> Form:
    """Interpolate the products of the gradients at the four samples around each display pixel."""
    slope = luma.new_tensor([[-1.0, 0.0, 1.0], [-2.0, 0.0, 2.0], [-1.0, 0.0, 1.0]]) / 8.0  # Sobel
    slopes = F.conv2d(padded_3x3(padded_3x3(luma)), torch.stack([slope, slope.T])[:, None])
    x, y = channels_of(slopes)  # with one more sample at each side

    def around(axis: GridAxis, size: int) -> Bands:
        return bands(axis.position + 1.0, size + 2, axis.span, linear, reach=1, aligned=grid.aligned)

    across, down = map(around, (grid.x, grid.y), size_of(luma))
    return Form(*channels_of(resample(torch.cat([x * x, x * y, y * y], dim=1), across, down)))


def steering_form(tensor: Form) -> Form:
    """Return the form whose negative half is the exponent of the Gaussian, from the structure tensor."""
    difference = tensor.xx - tensor.yy
    contrast = (difference * difference + 4.0 * tensor.xy * tensor.xy + 1e-12).sqrt()
    coherence = contrast / (tensor.xx + tensor.yy + EDGE_CONTRAST)
    across, along = ((-2.0 * of * coherence).exp() / EDGE_SIGMA**2 for of in (ACROSS, ALONG))  # 1 / variance
    mean, turn = 0.5 * (across + along), 0.5 * (across - along) / contrast
    return Form(mean + turn * difference, 4.0 * turn * tensor.xy, mean - turn * difference)


def window(distance: Tensor) -> Tensor:
    """Return a weight that is 0 at a distance of two samples along an axis, where samples come and go."""
    return 1.0 - 0.25 * distance * distance


def _taps(axis: GridAxis, size: int) -> list[tuple[Tensor, Tensor]]:
    """Return the four samples along an axis around each pixel, and their distances from it."""
    taps = [axis.position.floor() + float(step) for step in range(-1, 3)]
    return [(tap.long().clamp(0, size - 1), tap - axis.position) for tap in taps]
