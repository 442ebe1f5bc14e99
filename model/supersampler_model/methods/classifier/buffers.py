"""Tensors that the stages of `classifier` pass to each other.

Those that say "working type" are half floats in a method of half precision, else float32; all others are
float32 (docs/explanation/precision.md).
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import NamedTuple

import torch
from torch import Tensor

from supersampler_model.ops.motion import Reprojection
from supersampler_model.ops.sampling import Grid, Window
from supersampler_model.ops.size import Size


class CurrentFrame(NamedTuple):
    """This frame at display size, in the working type; colours are toned RGB."""

    frame: Tensor  # (1, 3, H, W) cubic upsampling
    sample: Tensor  # (1, 3, H, W) mean of the samples near each pixel
    confidence: Tensor  # (1, 1, H, W) sum of their Gaussian weights, [0, 1]
    mean: Tensor  # (1, 3, H, W) of the samples of a neighbourhood, YCoCg
    deviation: Tensor  # (1, 3, H, W) their standard deviation
    window: Window  # the 3x3 samples around each pixel
    edge: Tensor  # (1, 1, H, W) relative range of depth around
    glare: Tensor  # (1, 1, H, W) 1 where one of 3x3 samples is over GLARING
    sampled: Tensor  # (1, 1, H, W) 1 where one of 3x3 samples is usable


class WarpedHistory(NamedTuple):
    """The warped history at display size."""

    color: Tensor  # (1, 3, H, W) toned RGB
    rounded: Tensor  # `color` in the working type
    detail: Tensor  # (1, 3, H, W) cubic minus bilinear resampling, working type
    own: Tensor  # (1, 3, H, W) warped by the pixel's own motion, not the dilated one, toned RGB
    samples: Tensor  # (1, 1, H, W) number of accumulated samples; 0 without history
    range: Tensor  # (1, 2, H, W) minimum and maximum luma of the samples
    glare: Tensor  # (1, 1, H, W) consecutive frames with light over GLARING nearby, up to CONFIRMED
    difference: Tensor  # (1, 1, H, W) relative difference of depth, equation 10, working type
    surface: Tensor  # (1, 1, H, W) 0 where the surface was occluded, 1 where it was visible
    classes: Tensor  # (1, 6, H / 2, W / 2) class probabilities of the previous frame, working type


class Gathered(NamedTuple):
    """Results of the gather stage. H and W are those of the grid, which extends beyond the display."""

    current: CurrentFrame
    warped: WarpedHistory
    reprojection: Reprojection
    depth: Tensor  # (1, 1, H, W) of the closest sample around
    surfaces: Tensor  # (1, 2, h, w) depth, and occluding depth
    exposure: Tensor  # (1,) > 0
    followed: Tensor  # (1,) signed exposure for the history, see `exposure_for`
    flash: Tensor  # (1,) bool, see `is_flash`
    display: Size
    grid: Grid
    further_inputs: Mapping[str, Tensor] = MappingProxyType({})  # of the network, (1, 1, H, W) by name
    reactive: Tensor = torch.zeros(())  # (1, 1, H, W) of `reactive_at`


class History(NamedTuple):
    """The history tensors; shapes as in `Classifier.history`."""

    color: Tensor
    state: Tensor
    classes: Tensor
    depth: Tensor
    exposure: Tensor


class Finished(NamedTuple):
    """Results of the finish stage."""

    image: Tensor  # (1, 3, H, W) linear RGB
    state: Tensor  # as in `Classifier.history`
    classes: Tensor
    weight: Tensor  # (1, 1, H, W) weight of the history in the image
