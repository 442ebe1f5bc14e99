"""`bilinear` and `bicubic`: spatial upsampling without history. The baselines of the bench."""

from typing import ClassVar

import torch
from torch import Tensor

from supersampler.methods.spatial.spec import BICUBIC, BILINEAR
from supersampler_model.methods.base import Method
from supersampler_model.ops.color import bounded, sanitize, valid
from supersampler_model.ops.missing import filled
from supersampler_model.ops.sampling import catmull_rom, grid_bands, grid_of, linear, resample
from supersampler_model.ops.size import display_size_of, render_size_of


class Spatial(Method):
    """Separable interpolation with `kernel`; missing samples are filled from those around."""

    reach: ClassVar[int]

    def kernel(self, distance: Tensor) -> Tensor:
        """Weight of a sample at `distance` render pixels, 0 from `reach` on."""
        raise NotImplementedError

    def compute(
        self,
        color: Tensor,  # (1, 3, h, w) linear RGB
        jitter: Tensor,  # (1, 2) render pixels
        display_size: Tensor,  # (2,) int64
    ) -> tuple[Tensor]:
        """Return the image (1, 3, H, W), linear RGB >= 0."""
        display, render = display_size_of(display_size), render_size_of(color)
        grid = grid_of(display, render, jitter)
        kernels = grid_bands(grid, render, self.kernel, reach=self.reach)
        return (bounded(resample(filled(sanitize(color, 0.0), valid(color), torch.ones(1)), *kernels)),)


class Bilinear(Spatial):
    """Bilinear interpolation."""

    spec: ClassVar = BILINEAR
    reach = 1

    def kernel(self, distance: Tensor) -> Tensor:
        """Tent."""
        return linear(distance)


class Bicubic(Spatial):
    """Catmull-Rom interpolation."""

    spec: ClassVar = BICUBIC
    reach = 2

    def kernel(self, distance: Tensor) -> Tensor:
        """Catmull-Rom."""
        return catmull_rom(distance)
