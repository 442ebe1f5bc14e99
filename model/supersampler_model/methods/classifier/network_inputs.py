"""The network inputs of `classifier`.

A small network computes differences and contrasts poorly, and the gather stage computes them at almost no
cost: they are the inputs, in place of colours. Colours enter as square roots, which spaces dark values like
bright ones.
"""

import math
from collections.abc import Callable, Mapping

import torch
from torch import Tensor
from torch.nn import functional as F

from supersampler.methods.classifier.spec import NEIGHBOURHOOD_INPUTS, CountCode
from supersampler_model.methods.classifier.buffers import Gathered
from supersampler_model.ops.color import largest, luminance
from supersampler_model.ops.sampling import at_pixels
from supersampler_model.ops.size import Size, half_of
from supersampler_model.ops.windows import (
    blurred,
    channels_of,
    maximum_3x3,
    minimum_3x3,
    repeated,
)

MOST = 64.0  # samples at which the logarithm is 1
COUNTS: Mapping[CountCode, Callable[[Tensor], Tensor]] = {
    "saturating": lambda count: count / (count + 4.0),
    "logarithm": lambda count: (1.0 + count).log() / math.log1p(MOST),
}
"""Encodings of the sample count, to [0, 1)."""


def pixel_inputs(gathered: Gathered, count: CountCode = "saturating") -> dict[str, Tensor]:
    """Compute all of INPUTS; values are at most about 1. Colours are in the working type."""
    current, warped, reprojection = gathered.current, gathered.warped, gathered.reprojection
    range_ = warped.range.to(current.frame.dtype)
    frame, sample, color, range_ = (root(c) for c in (current.frame, current.sample, warped.rounded, range_))
    luma, luma_before = luminance(sample), luminance(color)
    low, high = channels_of(_range(luma_before, gathered))
    speed = reprojection.speed()
    return {
        "frame": luminance(frame),
        "sample": luma,
        "history": luma_before,
        "history_to_sample": largest((color - sample).abs()),
        "history_to_frame": largest((color - frame).abs()),
        "contrast": largest(current.deviation).clamp(min=1e-3).sqrt(),
        "history_contrast": high - low,
        "beyond_range": torch.maximum(low - luma, luma - high).clamp(min=0.0),
        "min_luma": range_[:, :1],
        "max_luma": range_[:, 1:2],
        "detail": root(largest(warped.detail.abs())),
        "confidence": current.confidence,
        "count": COUNTS[count](warped.samples),
        "depth_difference": warped.difference,
        "surface": warped.surface,
        "speed": speed / (speed + 4.0),
        "blur": reprojection.blur(),
        "edge": current.edge,
        **gathered.further_inputs,
    }


def _range(luma: Tensor, gathered: Gathered) -> Tensor:
    """(1, 2, H, W) minimum and maximum over 3x3 pixels."""
    least_and_most = torch.cat([minimum_3x3(luma), maximum_3x3(luma)], dim=1)
    return at_pixels(least_and_most, gathered.grid)  # of the repeated pixel, beyond the display


def neighbourhood_inputs(pixels: dict[str, Tensor], display: Size) -> dict[str, Tensor]:
    """Compute all of NEIGHBOURHOOD_INPUTS from the inputs per pixel.

    Aliasing averages out over a neighbourhood, a change of lighting does not.
    """
    apart = pixels["history"] - pixels["frame"]
    means = channels_of(root(_mean(torch.cat([apart, apart.abs()], dim=1), display).abs()))
    return dict(zip(NEIGHBOURHOOD_INPUTS, means, strict=True))


def _mean(image: Tensor, display: Size) -> Tensor:
    """Reduce (1, c, H, W) to half size and blur with a 5x5 tent."""
    channels, half = image.shape[1], half_of(display)
    quarters = image.new_full((channels, 1, 2, 2), 0.25)
    means = F.conv2d(image, quarters, stride=2, groups=channels)
    return repeated(blurred(blurred(means, half), half), half)


def root(value: Tensor) -> Tensor:
    """Square root with bounded slope."""
    return value.clamp(min=1e-6).sqrt()
