"""G-buffer operations of `gbuffer`: reflectance, surface similarity, masks, reads of previous frames."""

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn import functional as F

from supersampler_model.methods.gbuffer.buffers import Samples, Surfaces
from supersampler_model.ops.color import luminance
from supersampler_model.ops.motion import read, usable_depth
from supersampler_model.ops.sampling import Grid, channels_of, gaussian, sum_of

LEAST = 0.04  # reflectance added everywhere, about that of a dielectric
SIGMA = 0.5  # of the samples' weights, render pixels
DEPTH_MARGIN = 0.03  # standard deviation of relative depth differences
ALIKE = (4.0, 8.0, 8.0)  # falloff with squared differences of normal, base colour, roughness and metallic
FARTHER, COLOR_APART = 0.1, 0.5  # alpha and eta_B (Wang et al. 2025, section IV.B)
AROUND_BASE, AROUND_COLOR = 3, 5  # k_b and k_i
NEIGHBOURHOOD = 9  # pixels a side: depth is relative to the closest in it
CHANGED, AROUND_LIGHT = 6.0, 5  # least change of light in stops, averaged over so many pixels a side
LOG2_E = 1.0 / math.log(2.0)
FAINTEST = 1.0 / 64.0  # minimum exposed luminance in comparisons of light


def usable_surfaces(surfaces: Surfaces) -> Surfaces:
    """Replace NaN and values out of range by 0, and depth by UNKNOWN_DEPTH."""
    *parameters, depth = surfaces
    known = [torch.where((s >= -1.0) & (s <= 1.0), s, torch.zeros_like(s)) for s in parameters]
    base, normal, roughness, metallic, specular = known
    return Surfaces(
        base.clamp(min=0.0),
        normal,
        roughness.clamp(min=0.0),
        metallic.clamp(min=0.0),
        specular.clamp(min=0.0),
        usable_depth(depth),
    )


def matte(depth: Tensor) -> Surfaces:
    """Return grey, half rough dielectrics with one normal: the surfaces where only depth is known."""
    one = torch.ones_like(depth)
    grey, toward = 0.5 * one.expand(-1, 3, -1, -1), torch.cat([0.0 * one, 0.0 * one, one], dim=1)
    return Surfaces(grey, toward, 0.5 * one, 0.0 * one, 0.5 * one, depth)


def reflectance(surfaces: Surfaces) -> Tensor:
    """(1, 3, h, w) reflectance towards the camera: diffuse, plus specular at normal incidence.

    Colour over reflectance is light, which is smooth where textures are not (FuseSR, Zhong et al. 2023). The
    sky counts as white.
    """
    base, metal = surfaces.base_color, surfaces.metallic
    dielectric = 1.0 - metal
    reflected = base * dielectric + 0.08 * surfaces.specular * dielectric + base * metal + LEAST
    sky = (_squared_length(surfaces.normal) < 0.1).float()
    return reflected + sky * (1.0 - reflected)


def samples_of(light: Tensor, usable: Tensor, render: Surfaces, display: Surfaces, grid: Grid) -> Samples:
    """Gather the 3x3 samples around each display pixel, weighted by distance and surface similarity.

    Args:
        light: (1, 3, h, w) colour over reflectance, toned.
        usable: (1, 1, h, w).
        render: surfaces of the samples.
        display: surfaces of the display pixels.
        grid: of the display.
    """
    colors, weights, likely, there = [], [], [], _features(display)
    for down, across, sample in _around(torch.cat([light, usable, render.depth, _features(render)], 1), grid):
        color, use, depth, features = sample.split_with_sizes([3, 1, 1, 8], dim=1)
        vertical = gaussian(SIGMA)(grid.row + down - grid.y)[:, None]
        near = (vertical * gaussian(SIGMA)(grid.column + across - grid.x) + 1e-4) * use
        apart = depth_difference(depth, display.depth) / DEPTH_MARGIN
        cost = 0.5 * (apart * apart).clamp(max=20.0) + _squared_length(features - there)
        alike = (-cost).exp()
        colors.append(color)
        weights.append(near * (alike + 1e-4))
        likely.append(near * alike)
    return Samples(colors, weights, sum_of(likely))


def _around(image: Tensor, grid: Grid) -> Iterator[tuple[int, int, Tensor]]:
    """Yield rows down, columns across and the sample there, (1, c, H, W), of the nine around each pixel."""
    h, w = image.shape[2], image.shape[3]
    for down in (-1, 0, 1):
        rows = image.index_select(2, (grid.row + down).clamp(0, h - 1))
        for across in (-1, 0, 1):
            yield down, across, rows.index_select(3, (grid.column + across).clamp(0, w - 1))


def _features(surfaces: Surfaces) -> Tensor:
    """(1, 8, h, w) features whose squared distance is the dissimilarity of surfaces, except for depth."""
    by_normal, by_base, by_finish = (weight**0.5 for weight in ALIKE)
    finish = torch.cat([surfaces.roughness, surfaces.metallic], dim=1)
    return torch.cat([by_normal * surfaces.normal, by_base * surfaces.base_color, by_finish * finish], dim=1)


def weighed_mean(samples: Samples, kernel: Tensor | None = None) -> Tensor:
    """(1, 3, H, W) mean of the samples; `kernel` is (1, 9, H, W), logarithms of factors to their weights."""
    weights = samples.weights
    if kernel is not None:
        weights = [weight * factor for weight, factor in zip(weights, channels_of(kernel.exp()), strict=True)]
    total = sum_of(weights).clamp(min=1e-12)
    return sum_of([c * w for c, w in zip(samples.colors, weights, strict=True)]) / total


def relative_depth(depth: Tensor, closest: Tensor) -> Tensor:
    """Depth over the closest around, in [0, 1]: free of the unit of depth."""
    return (depth.clamp(min=0.0) / closest.clamp(min=1e-12)).clamp(max=1.0)


def closest_around(depth: Tensor) -> Tensor:
    """Closest depth within NEIGHBOURHOOD pixels each way."""
    return F.max_pool2d(depth.clamp(min=0.0), NEIGHBOURHOOD, 1, NEIGHBOURHOOD // 2)


def gradients(surfaces: Surfaces) -> Tensor:
    """(1, 2, h, w) differences of base colour and of normal to the right and lower neighbours (III.B)."""
    both = torch.cat([surfaces.base_color, surfaces.normal], dim=1)
    across = (both[..., 1:] - both[..., :-1]).abs()
    down = (both[:, :, 1:] - both[:, :, :-1]).abs()
    across = torch.cat([across, torch.zeros_like(both[..., :1])], dim=3)
    down = torch.cat([down, torch.zeros_like(both[:, :, :1])], dim=2)
    steps = across + down
    return torch.cat([steps[:, :3].sum(dim=1, keepdim=True), steps[:, 3:].sum(dim=1, keepdim=True)], dim=1)


def occluded(now: Sequence[Tensor], previous: Sequence[Tensor]) -> Tensor:
    """(1, 1, h, w) 1 where a warped previous frame is invalid: equations 1 and 2.

    Args:
        now: toned colour, base colour and depth of this frame.
        previous: the same of the warped frame.
    """
    (color, base, depth), (previous_color, previous_base, previous_depth) = now, previous
    view, previous_view = (1.0 / d.clamp(min=1e-9) for d in (depth, previous_depth))  # distances
    behind = ((view - previous_view).abs() > FARTHER * view).float()
    other = _unlike(previous_base, base, AROUND_BASE)
    return torch.maximum(behind, torch.maximum(other, _unlike(previous_color, color, AROUND_COLOR)))


def changed_light(now: Tensor, previous: Tensor, known: Tensor) -> Tensor:
    """(1, 1, h, w) 1 where the light changed abruptly since the previous frame, else 0.

    That is where it changed by more than CHANGED stops on average over the known pixels around. Lamps and
    shadows rarely change that much from one frame to the next, and single fireflies never do.

    Args:
        now: (1, 3, h, w) exposed colour.
        previous: (1, 3, h, w) of the previous frame, warped, at the same exposure.
        known: (1, 1, h, w) 1 where both are usable, else 0.
    """
    apart = (_stops(now) - _stops(previous)) * known
    window = torch.ones(1, 1, AROUND_LIGHT, AROUND_LIGHT, device=now.device)
    sums = F.conv2d(torch.cat([apart, known]), window, padding=AROUND_LIGHT // 2)
    return (sums[:1].abs() > CHANGED * sums[1:]).float()


def _stops(exposed: Tensor) -> Tensor:
    return luminance(exposed).clamp(min=FAINTEST).log() * LOG2_E


def _unlike(warped: Tensor, image: Tensor, size: int) -> Tensor:
    """1 where more than half of the pixels around differ by more than COLOR_APART in some channel."""
    reach = size // 2
    h, w = image.shape[2], image.shape[3]
    rows = torch.arange(-reach, h + reach, device=image.device).clamp(0, h - 1)
    columns = torch.arange(-reach, w + reach, device=image.device).clamp(0, w - 1)
    wide = image.index_select(2, rows).index_select(3, columns)
    parts = [wide[:, :, y : y + h, x : x + w] for y in range(size) for x in range(size)]
    red, green, blue = channels_of((torch.cat(parts) - warped).abs())
    far = torch.maximum(torch.maximum(red, green), blue) > COLOR_APART
    return (far.float().sum(dim=0, keepdim=True) > 0.5 * size * size).float()


def motion_of_surface(depth: Tensor, motion: Tensor, display_depth: Tensor, grid: Grid) -> Tensor:
    """(1, 2, H, W) motion of that sample of the 3x3 around whose depth is most similar to the pixel's."""
    least = torch.full_like(display_depth, torch.inf)
    chosen = torch.zeros_like(display_depth).expand(-1, 2, -1, -1)
    for down, across, sample in _around(torch.cat([depth, motion], dim=1), grid):
        cost = depth_difference(sample[:, :1], display_depth) + 0.002 * (down * down + across * across)
        closer = cost < least
        least, chosen = torch.where(closer, cost, least), torch.where(closer, sample[:, 1:], chosen)
    return chosen


def depth_difference(a: Tensor, b: Tensor) -> Tensor:
    """Difference of depths, relative to the closer one."""
    return (a - b).abs() / torch.maximum(a, b).clamp(min=1e-12)


def _squared_length(vectors: Tensor) -> Tensor:
    """(1, c, h, w) to (1, 1, h, w)."""
    return (vectors * vectors).sum(dim=1, keepdim=True)


class Nearest(NamedTuple):
    """Samples of a previous frame, nearest to where the motion points."""

    found: Tensor  # (1, c, h, w) unfiltered
    offset: Tensor  # (1, 2, h, w) from there to the sample, render pixels
    on_screen: Tensor  # (1, 1, h, w) 1 where the motion points inside the screen


def read_nearest(image: Tensor, motion: Tensor, offset: Tensor) -> Nearest:
    """Read the nearest samples of a previous frame where `motion` points.

    Args:
        image: (1, c, h, w).
        motion: (1, 2, h, w) render pixels.
        offset: (1, 2) this frame's jitter less that of the history one.
    """
    h, w = image.shape[2], image.shape[3]
    x, y = _led(motion, offset)
    on_screen = (x > -0.5) & (x < w - 0.5) & (y > -0.5) & (y < h - 0.5)
    x, y = x.clamp(-2.0, w + 1.0), y.clamp(-2.0, h + 1.0)
    column, row = (x + 0.5).floor(), (y + 0.5).floor()
    found = read(image, column, row, mode="nearest")
    return Nearest(found, torch.cat([column - x, row - y], dim=1), on_screen.float())


def read_bilinear(image: Tensor, motion: Tensor, offset: Tensor) -> Tensor:
    """Read a previous frame bilinearly where `motion` points; arguments as of `read_nearest`."""
    x, y = _led(motion, offset)
    return read(image, x.clamp(-2.0, image.shape[3] + 1.0), y.clamp(-2.0, image.shape[2] + 1.0))


def _led(motion: Tensor, offset: Tensor) -> tuple[Tensor, Tensor]:
    h, w = motion.shape[2], motion.shape[3]
    x = torch.arange(w, device=motion.device) + motion[:, :1] + offset[0, 0]
    y = torch.arange(h, device=motion.device)[:, None] + motion[:, 1:2] + offset[0, 1]
    return x, y
