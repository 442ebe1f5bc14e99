"""Surfaces of `gbuffer-fast`: light of this frame resampled by the agreement of surfaces."""

from typing import NamedTuple

import torch
from torch import Tensor

from supersampler.methods.gbuffer_fast.spec import GuidedConfig
from supersampler_model.methods.gbuffer.surfaces import depth_difference, samples_3x3, squared_norm
from supersampler_model.ops.motion import usable_depth
from supersampler_model.ops.sampling import Grid, gaussian, pick, sum_of

LEAST_WEIGHT = 1e-4
"""Of the farthest sample, and of the least similar surface: some light is found everywhere."""
MOST_DIFFERENCE = 10.0
"""Largest exponent of depth: half floats hold its exponential."""
STEP_COST = 0.002
"""Relative depth that a nearer sample may differ more and still be the pixel's own surface."""


class Surfaces(NamedTuple):
    """G-buffers, at render or display size; colours and normals in the working type."""

    base_color: Tensor  # (1, 3, h, w) in [0, 1]
    normal: Tensor  # (1, 3, h, w) unit length; 0 at the sky
    depth: Tensor  # (1, 1, h, w) reversed, float32

    def usable(self, dtype: torch.dtype) -> "Surfaces":
        """Sanitize: values out of range and NaN become 0, depth UNKNOWN_DEPTH."""
        base, normal = (image.to(dtype) for image in (self.base_color, self.normal))
        base = torch.where((base >= 0.0) & (base <= 1.0), base, 0.0)
        normal = torch.where((normal >= -1.0) & (normal <= 1.0), normal, 0.0)
        return Surfaces(base, normal, usable_depth(self.depth))

    def reflectance(self, least: float) -> Tensor:
        """Return (1, 3, h, w): base colour, raised to `least` at black; 1 at the sky.

        Colour over reflectance is light, which varies less than textures do (FuseSR, Zhong et al. 2023).
        """
        sky = squared_norm(self.normal) < 0.1
        return torch.where(sky, 1.0, least + (1.0 - least) * self.base_color)


class Guided(NamedTuple):
    """This frame's light at display pixels, and the motion of their surfaces."""

    light: Tensor  # (1, 3, H, W) toned
    agreement: Tensor  # (1, 1, H, W) sum of the samples' weights, about 1 where a similar surface was sampled
    motion: Tensor  # (1, 2, H, W) render pixels


def guide(
    light: Tensor,
    usable: Tensor,
    motion: Tensor,
    render: Surfaces,
    display: Surfaces,
    grid: Grid,
    config: GuidedConfig,
) -> Guided:
    """Resample light from the 3x3 samples around each display pixel, by distance and agreement of surfaces.

    Motion is that of the sample whose depth is most similar.

    Args:
        light: (1, 3, h, w) colour over reflectance, toned, in the working type; filled where `usable` is 0.
        usable: (1, 1, h, w) 1 where the colour is valid, else 0.
        motion: (1, 2, h, w) render pixels.
        render: surfaces of the samples.
        display: surfaces of the pixels of the grid.
        grid: of the display.
        config: of the method.
    """
    near = gaussian(config.guide_sigma)
    own, target = _features(render, config), _features(display, config)
    least, chosen = torch.full_like(display.depth, torch.inf), None
    colors, weights, similar = [], [], []
    for down, across, (color, valid, depth, features, moved) in samples_3x3(
        [light, usable, render.depth, own, motion], grid
    ):
        distance = near(grid.row + down - grid.y)[:, None] * near(grid.column + across - grid.x)
        apart = depth_difference(depth, display.depth)
        of_depth = (apart * apart * (0.5 / config.depth_sigma**2)).clamp(max=MOST_DIFFERENCE)
        similarity = (-(of_depth + squared_norm(features - target).float())).exp()
        distance = (distance + LEAST_WEIGHT) * valid
        colors.append(color)
        weights.append(distance * (similarity + LEAST_WEIGHT))
        similar.append(distance * similarity)
        cost = apart + STEP_COST * (down * down + across * across)
        chosen = moved if chosen is None else torch.where(cost < least, moved, chosen)
        least = torch.minimum(cost, least)
    assert chosen is not None  # noqa: S101 - nine samples
    found = sum_of(weights)
    total = found.clamp(min=1e-9)
    mean = sum_of([c * (w / total).to(c.dtype) for c, w in zip(colors, weights, strict=True)])
    mean = torch.where(found > 0.0, mean, pick(light, grid))
    return Guided(mean, sum_of(similar).clamp(max=1.0), chosen)


def _features(surfaces: Surfaces, config: GuidedConfig) -> Tensor:
    """Return features (1, 6, h, w) whose squared distance is the difference of surfaces, without depth."""
    normal = config.normal_falloff**0.5 * surfaces.normal
    return torch.cat([normal, config.base_color_falloff**0.5 * surfaces.base_color], dim=1)
