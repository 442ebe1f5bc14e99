"""What a frame carries along (alpha, any channels), blended by the weight that the colour was blended by.

A graph of its own, so that frames without pay nothing. No method is named after it: every model folder has
it as `aovs.onnx`, and what a method tells as `weight` goes in; of a method without a past, zeros.
"""

from typing import ClassVar, NamedTuple

import torch
from torch import Tensor

from supersampler.methods.aovs.spec import AOVS
from supersampler_model.methods.base import (
    Method,
    display_size_of,
    render_size_of,
)
from supersampler_model.ops.color import finite
from supersampler_model.ops.motion import dilate_motion_2x2, past_of, read, usable_depth, usable_motion
from supersampler_model.ops.sampling import gaussian, grid_of, normalised, pick_first, upsample

SIGMA = 0.4  # Gaussian that upsamples this frame, render pixels


class Step(NamedTuple):
    """The channels, twice: to be shown, and to be remembered."""

    image: Tensor
    history_aovs: Tensor


class Carry(Method):
    """Upsample, warp, blend."""

    spec: ClassVar = AOVS

    def forward(
        self,
        aovs: Tensor,  # (1, k, h, w) at the samples of the colour
        depth: Tensor,  # (1, 1, h, w) reversed
        motion: Tensor,  # (1, 2, h, w) render pixels, previous minus current
        jitter: Tensor,  # (1, 2) render pixels
        display_size: Tensor,  # (2,) int64
        weight: Tensor,  # (1, 1, H, W) share of the past
        history_aovs: Tensor,  # (1, k, H, W)
    ) -> Step:
        """Return the channels at display size, (1, k, H, W); NaN and Inf count as 0."""
        display, render = display_size_of(display_size), render_size_of(aovs)
        grid = grid_of(display, render, jitter)
        samples = torch.cat([finite(aovs), torch.ones_like(depth)], dim=1)
        present = normalised(upsample(samples, grid, gaussian(SIGMA)))
        closest = torch.cat(dilate_motion_2x2(usable_depth(depth), usable_motion(motion)), dim=1)
        there = past_of(pick_first(closest, grid)[:, 1:], display, render)
        past = read(finite(history_aovs), there.x, there.y)
        blend = present + weight.clamp(0.0, 1.0) * (past - present)
        return Step(blend, blend * 1.0)
