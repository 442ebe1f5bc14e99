"""`taa`: Salvi, "An Excursion in Temporal Supersampling" (GDC 2016), as published.

The image is an exponential moving average of 10 % new and 90 % old colour. The old colour is reprojected by
the longest motion vector of the 3x3 neighbourhood and rectified: the segment from the old colour to the new
sample is clipped by a box around this frame's 3x3 colours. Variance clipping builds that box from the first
two raw moments, mu +- gamma sigma, and intersects it with the minimum and maximum of the colours.

Salvi works at one resolution. At other ratios, the new sample is the bilinear upsampling of this frame, and
the boxes surround the render-size neighbourhood. Colours are compared in YCoCg, after exposure and tone
curve. Where a sample of the neighbourhood is not usable, the history is kept without clipping.
"""

from typing import ClassVar, NamedTuple

import torch
from torch import Tensor

from supersampler.methods.taa.spec import TAA, TaaConfig
from supersampler_model import ops
from supersampler_model.methods.base import Method


class Gathered(NamedTuple):
    """This frame and the warped history at display size, in the space of comparison."""

    sample: Tensor  # (1, 3, H, W)
    history: Tensor  # (1, 3, H, W)
    has_history: Tensor  # (1, 1, H, W) 0 or 1
    usable: Tensor  # (1, 1, H, W) 1 where all samples of the neighbourhood are usable, else 0
    reactive: Tensor  # (1, 1, H, W) in [0, 1], 0 where one of them is not usable
    box: ops.Corners


class Taa(Method):
    """Variance-clipping temporal anti-aliasing."""

    spec: ClassVar = TAA
    config: TaaConfig

    def compute(
        self,
        color: Tensor,  # (1, 3, h, w) linear RGB
        motion: Tensor,  # (1, 2, h, w) render pixels, previous minus current
        reactive: Tensor,  # (1, 1, h, w) in [0, 1]
        jitter: Tensor,  # (1, 2) render pixels
        exposure: Tensor,  # (1,) 0: measure
        display_size: Tensor,  # (2,) int64
        history_color: Tensor,  # (1, 3, H, W) linear RGB
        history_exposure: Tensor,  # (1,) 0: no history
    ) -> tuple[Tensor, ...]:
        """Return the image (1, 3, H, W), linear RGB >= 0, the next history and the weight of the history."""
        usable, color = ops.valid(color), ops.sanitize(color, 0.0)
        followed = ops.exposure_for(color, usable, exposure, history_exposure)
        exposure = followed.abs()
        color = ops.filled(color, usable, exposure)
        gathered = self.gather(color, usable, motion, reactive, jitter, exposure, display_size, history_color)
        weight = self.network(gathered, history_exposure)
        image = self.finish(gathered, weight, exposure)
        return image, image, followed, 1.0 - weight

    def gather(
        self,
        color: Tensor,
        usable: Tensor,
        motion: Tensor,
        reactive: Tensor,
        jitter: Tensor,
        exposure: Tensor,
        display_size: Tensor,
        history_color: Tensor,
    ) -> Gathered:
        """Upsample this frame, compute the boxes of its neighbourhoods, warp the history."""
        display, render = ops.display_size_of(display_size), ops.size_of(color)
        grid = ops.grid_of(display, render, jitter)
        toned = self.to_space(color * exposure)
        sample = ops.resample(toned, *grid.bands(render, ops.linear, reach=1))
        corners = grid.pick(torch.cat(self.neighbourhood_box(toned), dim=1))
        box = ops.Corners(*corners.split_with_sizes([3, 3], dim=1))
        vectors = ops.to_display(ops.longest(ops.usable_motion(motion)), display, render)
        reprojection = ops.reproject(grid.pick_vectors(vectors), display, grid)
        warped = ops.read_cubic(history_color, reprojection.position)
        history = self.to_space(ops.sanitize(warped, 0.0) * exposure)
        usable = ops.minimum_3x3(usable)
        return Gathered(
            sample=sample,
            history=history,
            has_history=reprojection.on_screen,
            usable=grid.pick(usable),
            reactive=ops.reactive_at(reactive, usable, grid),
            box=box,
        )

    def network(self, gathered: Gathered, history_exposure: Tensor) -> Tensor:
        """Return the weight of the new sample, (1, 1, H, W).

        It is alpha; 0 where the sample is not usable; 1 without history. The reactive mask raises it.
        """
        has_history = gathered.has_history * (history_exposure.abs() > 0.0)
        return 1.0 - has_history * (1.0 - self.config.alpha * gathered.usable) * (1.0 - gathered.reactive)

    def finish(self, gathered: Gathered, weight: Tensor, exposure: Tensor) -> Tensor:
        """Clip the history, blend, and convert to linear RGB."""
        match self.config.clip:
            case "sample":
                history = ops.clip_to_sample(gathered.history, gathered.sample, gathered.box)
            case "center":
                history = ops.clip_to_center(gathered.history, gathered.box.box())
            case _:
                history = gathered.box.clamp(gathered.history)
        history = torch.where(gathered.usable > 0.0, history, gathered.history)
        blend = history + weight * (gathered.sample - history)
        return ops.bounded(ops.inverse_tone(self.from_space(blend).clamp(min=0.0)) / exposure)

    def neighbourhood_box(self, color: Tensor) -> ops.Corners:
        """Return the box of each 3x3 neighbourhood at render size."""
        extent = ops.Corners(ops.minimum_3x3(color), ops.maximum_3x3(color))
        if self.config.gamma is None:
            return extent
        first, second = ops.blurred(color), ops.blurred(color * color)  # E[c] and E[c^2]
        for _ in range(3, self.config.window, 2):
            first, second = ops.blurred(first), ops.blurred(second)
        half = self.config.gamma * (second - first * first).clamp(min=0.0).sqrt()
        box = ops.Corners(first - half, first + half)
        if self.config.intersect_extent:
            return ops.Corners(torch.maximum(box.low, extent.low), torch.minimum(box.high, extent.high))
        return box

    def to_space(self, exposed: Tensor) -> Tensor:
        """Convert exposed linear RGB to the space in which colours are compared and blended."""
        return ops.ycocg(ops.tone(exposed)) if self.config.space == "ycocg" else ops.tone(exposed)

    def from_space(self, color: Tensor) -> Tensor:
        """Convert back to toned RGB."""
        return ops.from_ycocg(color) if self.config.space == "ycocg" else color
