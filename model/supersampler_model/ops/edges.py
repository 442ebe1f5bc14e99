"""Upsampling of one frame along its edges, for pixels without history.

Steering kernel regression (Takeda, Farsiu and Milanfar 2007): each pixel is a mean of the 4x4 samples around
it. The weights fall with the distance along the axes of the structure tensor of luma, faster across an edge
than along it. A sample enters and leaves the 4x4 samples with a weight of 0.
"""

from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn import functional as F

from supersampler.methods.constants import ACROSS, ALONG, EDGE_CONTRAST, MIN_WEIGHT, ROUND
from supersampler_model.ops.images import channels_of, padded_3x3, pick_columns, size_of, sum_of
from supersampler_model.ops.sampling import Bands, Grid, GridAxis, bands, linear, resample


class Form(NamedTuple):
    """Quadratic form xx x^2 + xy x y + yy y^2 of a distance (x, y) in render pixels, each (1, 1, H, W)."""

    xx: Tensor
    xy: Tensor
    yy: Tensor


def upsample_along_edges(luma: Tensor, usable: Tensor, grid: Grid) -> Tensor:
    """Upsample the usable samples of luma, (1, 1, H, W), with a kernel that is long along edges.

    Args:
        luma: (1, 1, h, w) toned, filled where samples are missing. The result is the nearest of these where
            none of the 4x4 samples is usable.
        usable: (1, 1, h, w) 1 or 0.
        grid: grid of the display pixels.
    """
    form, size = kernel_form(structure_tensor(luma, grid)), size_of(luma)
    samples = torch.cat([luma * usable, usable], dim=1)
    columns, rows = _taps(grid.x, size.width), _taps(grid.y, size.height)
    sums = []
    for row, y in rows:
        line, y = samples.index_select(2, row), y[:, None]
        for column, x in columns:
            near = (1.0 - form.xx * (x * x) - (form.xy * x + form.yy * y) * y).clamp(min=0.0)
            near = near * near
            sums.append(near * near * pick_columns(line, column))
    total, weight = channels_of(sum_of(sums))
    return torch.where(weight > MIN_WEIGHT, total / weight.clamp(min=MIN_WEIGHT), grid.pick(luma))


def structure_tensor(luma: Tensor, grid: Grid) -> Form:
    """Interpolate the products of the gradients at the four samples around each display pixel."""
    slope = luma.new_tensor([[-1.0, 0.0, 1.0], [-2.0, 0.0, 2.0], [-1.0, 0.0, 1.0]]) / 8.0  # Sobel
    slopes = F.conv2d(padded_3x3(padded_3x3(luma)), torch.stack([slope, slope.T])[:, None])
    x, y = channels_of(slopes)  # with one more sample at each side

    def around(axis: GridAxis, size: int) -> Bands:
        return bands(axis.position + 1.0, size + 2, axis.span, linear, reach=1, aligned=grid.aligned)

    across, down = map(around, (grid.x, grid.y), size_of(luma))
    return Form(*channels_of(resample(torch.cat([x * x, x * y, y * y], dim=1), across, down)))


def kernel_form(tensor: Form) -> Form:
    """Return the quadratic form of a structure tensor: weights are 0 at distances where it is 1 or more."""
    difference = tensor.xx - tensor.yy
    contrast = (difference * difference + 4.0 * tensor.xy * tensor.xy + 1e-12).sqrt()
    coherence = contrast / (tensor.xx + tensor.yy + EDGE_CONTRAST)
    mean = ROUND + (0.5 * (ACROSS + ALONG) - ROUND) * coherence
    turn = (0.5 * (ACROSS - ALONG)) * coherence / contrast
    return Form(mean + turn * difference, 4.0 * turn * tensor.xy, mean - turn * difference)


def _taps(axis: GridAxis, size: int) -> list[tuple[Tensor, Tensor]]:
    """Return the four samples around each pixel along an axis, and their distances from the pixel."""
    taps = [axis.position.floor() + float(step) for step in range(-1, 3)]
    return [(tap.long().clamp(0, size - 1), tap - axis.position) for tap in taps]
