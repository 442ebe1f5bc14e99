"""Tensors that the stages of the classifiers pass to each other, and the inputs of their network.

The network inputs are differences and contrasts, which the gather stage computes at almost no cost, and a
small network only poorly. Colours enter as square roots, which spaces dark values like bright ones.
"""

import math
from collections.abc import Callable, Mapping
from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn import functional as F

from supersampler.methods.classifier.spec import HALF_COUNT, NEIGHBOURHOOD_INPUTS, CountCode
from supersampler_model import ops

FULL_COUNT = 64.0  # samples at which the logarithm is 1
COUNTS: Mapping[CountCode, Callable[[Tensor], Tensor]] = {
    "saturating": lambda count: count / (count + HALF_COUNT),
    "logarithm": lambda count: (1.0 + count).log() / math.log1p(FULL_COUNT),
}
"""Encodings of the sample count, to [0, 1)."""


class CurrentFrame(NamedTuple):
    """This frame at display size, in the working type; colours are toned RGB.

    The working type is the type of the network's parameters, see docs/explanation/precision.md.
    """

    frame: Tensor  # (1, 3, H, W) cubic upsampling
    sample: Tensor  # (1, 3, H, W) mean of the samples near each pixel
    confidence: Tensor  # (1, 1, H, W) sum of their Gaussian weights, [0, 1]
    mean: Tensor  # (1, 3, H, W) of the samples of a neighbourhood, YCoCg
    deviation: Tensor  # (1, 3, H, W) their standard deviation
    window: ops.Window  # the 3x3 samples around each pixel
    edge: Tensor  # (1, 1, H, W) relative range of depth around
    glare: Tensor  # (1, 1, H, W) 1 where one of 3x3 samples is over GLARE_EXPOSED
    sampled: Tensor  # (1, 1, H, W) 1 where one of 3x3 samples is usable
    luma: Tensor | None = None  # (1, 1, H, W) upsampled along edges; None with G-buffers of display size
    peak: Tensor | None = None  # (1, 1, H, W) of the samples around, see `ops.peak`; None as above


class WarpedHistory(NamedTuple):
    """The warped history at display size; float32 unless a comment says working type."""

    color: Tensor  # (1, 3, H, W) toned RGB
    rounded: Tensor  # `color` in the working type
    detail: Tensor  # (1, 3, H, W) cubic minus bilinear resampling, working type
    undilated: Tensor  # (1, 3, H, W) warped by the pixel's own motion, not the dilated one, toned RGB
    samples: Tensor  # (1, 1, H, W) number of accumulated samples; 0 without history
    range: Tensor  # (1, 2, H, W) minimum and maximum luma of the samples
    glare: Tensor  # (1, 1, H, W) consecutive frames with light over GLARE_EXPOSED nearby, up to CONFIRMED
    difference: Tensor  # (1, 1, H, W) relative difference of depth, equation 10, working type
    surface: Tensor  # (1, 1, H, W) 0 where the surface was occluded, 1 where it was visible
    classes: Tensor  # (1, 6, H / 2, W / 2) class probabilities of the previous frame, working type


class Gathered(NamedTuple):
    """Results of the gather stage. H and W are the size of the grid, which extends beyond the display."""

    current: CurrentFrame
    warped: WarpedHistory
    reprojection: ops.Reprojection
    depth: Tensor  # (1, 1, H, W) of the closest sample around
    surfaces: Tensor  # (1, 2, h, w) depth, and occluding depth
    exposure: Tensor  # (1,) > 0
    followed: Tensor  # (1,) signed exposure for the history, see `exposure_for`
    flash: Tensor  # (1,) bool, see `is_flash`
    display: ops.Size
    grid: ops.Grid
    further_inputs: Mapping[str, Tensor] | None = None  # of the network, (1, 1, H, W) by name
    reactive: Tensor = torch.zeros(())  # (1, 1, H, W) of `reactive_at`


class History(NamedTuple):
    """The history tensors without jitter and mean; shapes as in `Classifier.history`."""

    color: Tensor
    state: Tensor
    classes: Tensor
    depth: Tensor
    exposure: Tensor


def pixel_inputs(gathered: Gathered, count: CountCode = "saturating") -> dict[str, Tensor]:
    """Compute all of INPUTS; values are at most about 1. Colours are in the working type."""
    current, warped, reprojection = gathered.current, gathered.warped, gathered.reprojection
    range_ = warped.range.to(current.frame.dtype)
    frame, sample, color, range_ = (root(c) for c in (current.frame, current.sample, warped.rounded, range_))
    luma, luma_before = ops.luminance(sample), ops.luminance(color)
    around = torch.cat([ops.minimum_3x3(luma_before), ops.maximum_3x3(luma_before)], dim=1)
    low, high = ops.channels_of(gathered.grid.at_pixels(around))  # beyond the display, of the repeated pixel
    speed = reprojection.speed()
    return {
        "frame": ops.luminance(frame),
        "sample": luma,
        "history": luma_before,
        "history_to_sample": ops.largest((color - sample).abs()),
        "history_to_frame": ops.largest((color - frame).abs()),
        "contrast": ops.largest(current.deviation).clamp(min=1e-3).sqrt(),
        "history_contrast": high - low,
        "beyond_range": torch.maximum(low - luma, luma - high).clamp(min=0.0),
        "min_luma": range_[:, :1],
        "max_luma": range_[:, 1:2],
        "detail": root(ops.largest(warped.detail.abs())),
        "confidence": current.confidence,
        "count": COUNTS[count](warped.samples),
        "depth_difference": warped.difference,
        "surface": warped.surface,
        "speed": speed / (speed + 4.0),
        "blur": reprojection.blur(),
        "edge": current.edge,
        **(gathered.further_inputs or {}),
    }


def neighbourhood_inputs(pixels: Mapping[str, Tensor], display: ops.Size) -> dict[str, Tensor]:
    """Compute all of NEIGHBOURHOOD_INPUTS: inputs per pixel, averaged at half size under a 5x5 tent.

    Aliasing averages out over a neighbourhood, a change of lighting does not.
    """
    difference = pixels["history"] - pixels["frame"]
    both, half = torch.cat([difference, difference.abs()], dim=1), ops.half_of(display)
    means = F.conv2d(both, both.new_full((2, 1, 2, 2), 0.25), stride=2, groups=2)
    means = ops.repeat_edges(ops.blurred(ops.blurred(means, half), half), half)
    return dict(zip(NEIGHBOURHOOD_INPUTS, ops.channels_of(root(means.abs())), strict=True))


def root(value: Tensor) -> Tensor:
    """Return the square root, with bounded slope."""
    return value.clamp(min=1e-6).sqrt()
