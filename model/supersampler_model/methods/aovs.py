"""Temporal blending of AOVs (alpha or any channels) by the weights that a method computed for the colour.

Every model folder has it as `aovs.onnx`, which runs only on frames with AOVs. Its input `weight` is the
method's auxiliary output `weight`, or zeros for a method without history.
"""

from functools import reduce
from typing import ClassVar

import torch
from torch import Tensor

from supersampler.io.display import MAX_HALF
from supersampler.methods.aovs.spec import AOVS, MIN_CERTAINTY, SIGMA, UNKNOWN
from supersampler_model import ops
from supersampler_model.methods.base import Method


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

        Values are clamped to [-65504, 65504]. A NaN is a missing sample. Where a channel has only missing
        samples, its history is kept; without one, it is UNKNOWN, as every channel is before the first frame.
        """
        display, render = ops.display_size_of(display_size), ops.size_of(aovs)
        grid = ops.grid_of(display, render, jitter)
        known = ops.is_number(aovs).float()
        values = torch.where(known > 0.0, aovs.clamp(-MAX_HALF, MAX_HALF), 0.0)
        sums = grid.upsample(torch.cat([values, known], dim=1), ops.gaussian(SIGMA))
        total, certainty = sums.split_with_sizes([aovs.shape[1], aovs.shape[1]], dim=1)
        current = total / certainty.clamp(min=ops.min_divisor(certainty, 1e-6))
        _, dilated = ops.dilate_motion_2x2(ops.usable_depth(depth), ops.usable_motion(motion))
        vectors = grid.pick_first_vectors(ops.to_display(dilated, display, render))
        position = ops.reproject(vectors, display, grid).position
        history, is_known = read_bounded(ops.finite(history_aovs), position)
        found = certainty > MIN_CERTAINTY
        keep = torch.where(found, weight.clamp(0.0, 1.0), 1.0)
        blend = torch.where(is_known, current + keep * (history - current), current)
        blend = torch.where(is_known | found, blend.clamp(-MAX_HALF, MAX_HALF), UNKNOWN)
        return blend, blend * 1.0


def read_bounded(image: Tensor, position: Tensor) -> tuple[Tensor, Tensor]:
    """Resample with Catmull-Rom, bounded by the known ones of the four pixels around.

    The bounds keep the coverage of thin objects sharp.

    Args:
        image: (1, c, h, w), finite, or UNKNOWN.
        position: (1, H, W, 2) in its pixels.

    Returns:
        The result, (1, c, H, W), and where one of the four pixels is known.
    """
    first, unknown = position.floor(), image == UNKNOWN
    low, high = (
        ops.read(reduce(bound, ops.neighbours_2x2(torch.where(unknown, none, image))), first, mode="nearest")
        for bound, none in ((torch.minimum, 2.0 * MAX_HALF), (torch.maximum, -2.0 * MAX_HALF))
    )
    return torch.minimum(torch.maximum(ops.read_cubic(image, position), low), high), low <= high
