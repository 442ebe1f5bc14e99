"""`bilinear` and `bicubic`: spatial upsampling without history. The baselines of the bench."""

from abc import abstractmethod
from typing import ClassVar

import torch
from torch import Tensor

from supersampler.methods.spatial.spec import BICUBIC, BILINEAR
from supersampler_model import ops
from supersampler_model.methods.base import Method


class Spatial(Method):
    """Separable interpolation with `kernel`; missing samples are filled from the samples around."""

    reach: ClassVar[int]

    @staticmethod
    @abstractmethod
    def kernel(distance: Tensor) -> Tensor:
        """Return the weight of a sample at a distance in render pixels, 0 from `reach` on."""

    def compute(
        self,
        color: Tensor,  # (1, 3, h, w) linear RGB
        jitter: Tensor,  # (1, 2) render pixels
        display_size: Tensor,  # (2,) int64
    ) -> tuple[Tensor]:
        """Return the image (1, 3, H, W), linear RGB >= 0."""
        display, render = ops.display_size_of(display_size), ops.size_of(color)
        bands = ops.grid_of(display, render, jitter).bands(render, self.kernel, reach=self.reach)
        filled = ops.filled(ops.sanitize(color, 0.0), ops.valid(color), torch.ones(1))
        return (ops.bounded(ops.resample(filled, *bands)),)


class Bilinear(Spatial):
    """Bilinear interpolation."""

    spec: ClassVar = BILINEAR
    kernel = staticmethod(ops.linear)
    reach = 1


class Bicubic(Spatial):
    """Catmull-Rom interpolation."""

    spec: ClassVar = BICUBIC
    kernel = staticmethod(ops.catmull_rom)
    reach = 2
