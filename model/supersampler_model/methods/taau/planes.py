"""Planes fitted to the luma of the samples around each display pixel.

On a smooth surface whose shade changes from sample to sample, variance clipping (Salvi 2016) finds as much
contrast as on detail. Contrast about the plane of the samples is that of detail alone.
"""

from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn import functional as F

from supersampler.methods.taau.spec import FIT, UNFIT
from supersampler_model.ops.sampling import Bands, Grid, gaussian, grid_bands, resample
from supersampler_model.ops.size import Size, render_size_of
from supersampler_model.ops.windows import blurred, padded_3x3


class Axis(NamedTuple):
    """Filters of the samples along an axis, under a Gaussian window."""

    mean: Bands  # weights that sum to 1
    slope: Bands  # least-squares slope, per standard deviation of the positions in the window
    shift: Tensor  # (n,) mean position in the window less that of the pixel, in these standard deviations


class Moments(NamedTuple):
    """Mean and variance of the samples in a window; those of luma are of its plane as far as that fits."""

    center: Tensor  # (1, 3, H, W)
    variance: Tensor  # (1, 3, H, W) 1 where most samples of the window are not usable


def fit_of(luma: Tensor, usable: Tensor, deviation: Tensor) -> Tensor:
    """(1, 1, h, w) whether 3x3 samples are on a plane: 0 on detail and edges, 1 on smooth surfaces.

    Args:
        luma: (1, 1, h, w), 0 where not usable.
        usable: (1, 1, h, w) 1 or 0.
        deviation: (1, 1, h, w) standard deviation of these samples.
    """
    slope = luma.new_tensor([-1.0, 0.0, 1.0]).expand(3, 3) / 6.0
    slopes = F.conv2d(padded_3x3(luma), torch.stack([slope, slope.T])[:, None])
    explained = (slopes * slopes).sum(dim=1, keepdim=True) * (6.0 / 9.0)
    fraction = explained / (deviation * deviation).clamp(min=1e-7)
    return ((fraction - UNFIT) / (FIT - UNFIT)).clamp(0.0, 1.0) * (blurred(usable) > 0.999)


def plane_moments(
    color: Tensor, usable: Tensor, fit: Tensor, grid: Grid, sigma: float, least: float
) -> Moments:
    """Return moments of the usable samples under a Gaussian at every display pixel.

    Args:
        color: (1, 3, h, w) YCoCg, 0 where not usable.
        usable: (1, 1, h, w) 1 or 0.
        fit: (1, 1, H, W) fraction of the plane's part in the result.
        grid: of the display pixels.
        sigma: of the Gaussian, render pixels.
        least: fraction of the window that must be usable.
    """
    x, y = _axes(render_size_of(color), grid, sigma)
    sums = resample(torch.cat([color, color * color, usable], dim=1), x.mean, y.mean)
    first, second, weight = sums.split_with_sizes([3, 3, 1], dim=1)
    total = weight.clamp(min=1e-6)
    mean = first / total
    variance = (second / total - mean * mean).clamp(min=0.0)
    across, down = resample(color[:, :1], x.slope, y.mean), resample(color[:, :1], x.mean, y.slope)
    fit = fit * (weight > 0.999)  # the slopes are of whole windows
    luma = mean[:, :1] - fit * (across * x.shift + down * y.shift[:, None])
    luma_variance = (variance[:, :1] - fit * (across * across + down * down)).clamp(min=0.0)
    variance = torch.cat([luma_variance, variance[:, 1:]], dim=1)
    return Moments(torch.cat([luma, mean[:, 1:]], dim=1), torch.where(weight > least, variance, 1.0))


def _axes(render: Size, grid: Grid, sigma: float) -> tuple[Axis, Axis]:
    window = gaussian(sigma)
    kernels = window, lambda d: d * window(d), lambda d: d * d * window(d)
    x, y = zip(*(grid_bands(grid, render, kernel) for kernel in kernels), strict=True)
    return _axis(*x), _axis(*y)


def _axis(window: Bands, first: Bands, second: Bands) -> Axis:
    """Return the filters of an axis from its Gaussian, and from that times distance and squared distance."""
    total = window.weights.sum(dim=2, keepdim=True)
    mean = first.weights.sum(dim=2, keepdim=True) / total
    variance = second.weights.sum(dim=2, keepdim=True) / total - mean * mean
    scale = 1.0 / variance.sqrt()
    slope = (first.weights - mean * window.weights) * scale / total
    shift = (mean * scale).reshape(-1)
    if window.outputs is not None:
        shift = shift.index_select(0, torch.arange(window.outputs, device=shift.device))
    return Axis(window._replace(weights=window.weights / total), window._replace(weights=slope), shift)
