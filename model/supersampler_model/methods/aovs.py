"""Temporal blending of AOVs (alpha or any channels) by the weights that a method computed for the colour.

It is exported as `aovs.onnx` in every model folder; frames without AOVs do not run it. Its input `weight` is
the method's auxiliary output `weight`, or zeros for a method without history.
"""

from typing import ClassVar

import torch
from torch import Tensor

from supersampler.methods.aovs.spec import AOVS
from supersampler_model.methods.base import Method
from supersampler_model.ops.color import MAX_HALF, finite, is_number, min_divisor
from supersampler_model.ops.images import display_size_of, size_of
from supersampler_model.ops.motion import (
    dilate_motion_2x2,
    read,
    reproject,
    to_display,
    usable_depth,
    usable_motion,
)
from supersampler_model.ops.sampling import gaussian, grid_of

SIGMA = 0.4  # Gaussian that upsamples this frame, render pixels
MIN_CERTAINTY = 1e-3  # sum of the weights below which samples are too far away


class BlendAovs(Method):
    """Upsample, warp, blend."""

    spec: ClassVar = AOVS

    def compute(
        self,
        aovs: Tensor,  # (1, k, h, w) at the samples of the colour
        depth: Tensor,  # (1, 1, h, w) reversed
        motion: Tensor,  # (1, 2, h, w) render pixels, previous minus current
        jitter: Tensor,  # (1, 2) render pixels
        display_size: Tensor,  # (2,) int64
        weight: Tensor,  # (1, 1, H, W) weight of the history
        history_aovs: Tensor,  # (1, k, H, W)
    ) -> tuple[Tensor, Tensor]:
        """Return the channels at display size, (1, k, H, W).

        Values are clamped to [-65504, 65504]. A NaN is a missing sample: where a channel has no others, the
        history stays.
        """
        display, render = display_size_of(display_size), size_of(aovs)
        grid = grid_of(display, render, jitter)
        known = is_number(aovs).float()
        values = torch.where(known > 0.0, aovs.clamp(-MAX_HALF, MAX_HALF), 0.0)
        sums = grid.upsample(torch.cat([values, known], dim=1), gaussian(SIGMA))
        total, certainty = sums.split_with_sizes([aovs.shape[1], aovs.shape[1]], dim=1)
        current = total / certainty.clamp(min=min_divisor(certainty, 1e-6))
        _, dilated = dilate_motion_2x2(usable_depth(depth), usable_motion(motion))
        vectors = grid.pick_first_vectors(to_display(dilated, display, render))
        history = read(finite(history_aovs), reproject(vectors, display, grid).position)
        keep = torch.where(certainty > MIN_CERTAINTY, weight.clamp(0.0, 1.0), 1.0)
        blend = current + keep * (history - current)
        return blend, blend * 1.0
