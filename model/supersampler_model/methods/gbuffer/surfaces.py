"""G-buffers in `gbuffer`: what surfaces reflect, which samples are of the same one, what has changed."""

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

LEAST = 0.04  # reflectance that is added everywhere: of a dielectric, about
SIGMA = 0.5  # of the samples' weights, render pixels
DEPTH_MARGIN = 0.03  # relative difference of depth that one standard deviation is
ALIKE = (4.0, 8.0, 8.0)  # falloff with squared differences of normal, base colour, roughness and metallic
FARTHER, COLOR_APART = 0.1, 0.5  # alpha and eta_B (Wang et al. 2025, section IV.B)
AROUND_BASE, AROUND_COLOR = 3, 5  # k_b and k_i
NEIGHBOURHOOD = 9  # pixels within which depth is relative
CHANGED, AROUND_LIGHT = 6.0, 5  # stops that light must change by, on average over so many pixels a side
LOG2_E = 1.0 / math.log(2.0)
FAINTEST = 1.0 / 64.0  # exposed luminance below which light does not count as changing


def usable_surfaces(surfaces: Surfaces) -> Surfaces:
    """NaN and what is out of range become black, rough dielectric without a normal, at an unknown depth."""
    *shares, depth = surfaces
    known = [torch.where((s >= -1.0) & (s <= 1.0), s, torch.zeros_like(s)) for s in shares]
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
    """Grey, rough dielectrics that all face one way: what surfaces of known depth alone are taken for."""
    one = torch.ones_like(depth)
    grey, toward = 0.5 * one.expand(-1, 3, -1, -1), torch.cat([0.0 * one, 0.0 * one, one], dim=1)
    return Surfaces(grey, toward, 0.5 * one, 0.0 * one, 0.5 * one, depth)


def reflectance(surfaces: Surfaces) -> Tensor:
    """(1, 3, h, w) share of light that a surface reflects towards the eye: diffuse, and head on specular.

    Colours over this are light, which is smooth where textures are not (FuseSR, Zhong et al. 2023). The sky,
    which has no surface, counts as white.
    """
    base, metal = surfaces.base_color, surfaces.metallic
    dielectric = 1.0 - metal
    reflected = base * dielectric + 0.08 * surfaces.specular * dielectric + base * metal + LEAST
    sky = (_squared_length(surfaces.normal) < 0.1).float()
    return reflected + sky * (1.0 - reflected)


def samples_of(light: Tensor, usable: Tensor, render: Surfaces, display: Surfaces, grid: Grid) -> Samples:
    """The samples around each display pixel, weighed by a Gaussian and by how like their surface is.

    Args:
        light: (1, 3, h, w) what samples show over what they reflect, toned.
        usable: (1, 1, h, w).
        render: surfaces of the samples.
        display: surfaces of the pixels.
        grid: where these look.
    """
    colors, weights, likely, there = [], [], [], _features(display)
    for down, across, sample in _around(torch.cat([light, usable, render.depth, _features(render)], 1), grid):
        color, use, depth, features = sample.split_with_sizes([3, 1, 1, 8], dim=1)
        vertical = gaussian(SIGMA)(grid.row + down - grid.y)[:, None]
        near = (vertical * gaussian(SIGMA)(grid.column + across - grid.x) + 1e-4) * use
        apart = depth_difference(depth, display.depth) / DEPTH_MARGIN
        off = 0.5 * (apart * apart).clamp(max=20.0) + _squared_length(features - there)
        alike = (-off).exp()
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
    """(1, 8, h, w) whose squared distance is how unlike surfaces are, but for their depth."""
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
    """Depth over the closest around, in [0, 1]: without the unit that depth has."""
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


def occluded(now: Sequence[Tensor], past: Sequence[Tensor]) -> Tensor:
    """(1, 1, h, w) 1 where a warped frame of the past is of no use: equations 1 and 2.

    Args:
        now: toned colour, base colour and depth of this frame.
        past: the same of the warped one.
    """
    (color, base, depth), (past_color, past_base, past_depth) = now, past
    view, past_view = (1.0 / d.clamp(min=1e-9) for d in (depth, past_depth))  # distances
    behind = ((view - past_view).abs() > FARTHER * view).float()
    other = _unlike(past_base, base, AROUND_BASE)
    return torch.maximum(behind, torch.maximum(other, _unlike(past_color, color, AROUND_COLOR)))


def changed_light(now: Tensor, past: Tensor, known: Tensor) -> Tensor:
    """(1, 1, h, w) 1 where a frame's light has nothing in common with that of the frame before, else 0.

    That is where it differs by more than CHANGED stops on average over the known pixels around: lamps and
    shadows rarely do so much from one frame to the next, and single sparks never.

    Args:
        now: (1, 3, h, w) exposed colour.
        past: (1, 3, h, w) of the frame before, warped, at the same exposure.
        known: (1, 1, h, w) 1 where both are usable, else 0.
    """
    apart = (_stops(now) - _stops(past)) * known
    window = torch.ones(1, 1, AROUND_LIGHT, AROUND_LIGHT, device=now.device)
    sums = F.conv2d(torch.cat([apart, known]), window, padding=AROUND_LIGHT // 2)
    return (sums[:1].abs() > CHANGED * sums[1:]).float()


def _stops(exposed: Tensor) -> Tensor:
    return luminance(exposed).clamp(min=FAINTEST).log() * LOG2_E


def _unlike(warped: Tensor, image: Tensor, size: int) -> Tensor:
    """Whether more than half of the pixels around are farther than COLOR_APART in some channel."""
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
    """(1, 2, H, W) motion of the sample, of the nine around, whose depth is most like the pixel's."""
    least = torch.full_like(display_depth, torch.inf)
    chosen = torch.zeros_like(display_depth).expand(-1, 2, -1, -1)
    for down, across, sample in _around(torch.cat([depth, motion], dim=1), grid):
        off = depth_difference(sample[:, :1], display_depth) + 0.002 * (down * down + across * across)
        closer = off < least
        least, chosen = torch.where(closer, off, least), torch.where(closer, sample[:, 1:], chosen)
    return chosen


def depth_difference(a: Tensor, b: Tensor) -> Tensor:
    """Relative to the closer of both."""
    return (a - b).abs() / torch.maximum(a, b).clamp(min=1e-12)


def _squared_length(vectors: Tensor) -> Tensor:
    """(1, c, h, w) to (1, 1, h, w)."""
    return (vectors * vectors).sum(dim=1, keepdim=True)


class Nearest(NamedTuple):
    """Samples of a past frame, the nearest to where motion leads."""

    found: Tensor  # (1, c, h, w) as they are
    off: Tensor  # (1, 2, h, w) how far off they lie, render pixels
    on_screen: Tensor  # (1, 1, h, w) whether motion leads to a place on the screen


def nearest_past(image: Tensor, motion: Tensor, offset: Tensor) -> Nearest:
    """Read a frame of the past, of render size, where `motion` leads: its nearest samples as they are.

    Args:
        image: (1, c, h, w).
        motion: (1, 2, h, w) render pixels.
        offset: (1, 2) this frame's jitter less that of the past one.
    """
    h, w = image.shape[2], image.shape[3]
    x, y = _led(motion, offset)
    on_screen = (x > -0.5) & (x < w - 0.5) & (y > -0.5) & (y < h - 0.5)
    x, y = x.clamp(-2.0, w + 1.0), y.clamp(-2.0, h + 1.0)
    column, row = (x + 0.5).floor(), (y + 0.5).floor()
    found = read(image, column, row, mode="nearest")
    return Nearest(found, torch.cat([column - x, row - y], dim=1), on_screen.float())


def bilinear_past(image: Tensor, motion: Tensor, offset: Tensor) -> Tensor:
    """Read an image of the past, of render size, where `motion` leads; arguments as of `nearest_past`."""
    x, y = _led(motion, offset)
    return read(image, x.clamp(-2.0, image.shape[3] + 1.0), y.clamp(-2.0, image.shape[2] + 1.0))


def _led(motion: Tensor, offset: Tensor) -> tuple[Tensor, Tensor]:
    h, w = motion.shape[2], motion.shape[3]
    x = torch.arange(w, device=motion.device) + motion[:, :1] + offset[0, 0]
    y = torch.arange(h, device=motion.device)[:, None] + motion[:, 1:2] + offset[0, 1]
    return x, y
