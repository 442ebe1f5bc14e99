"""G-buffer operations of `gbuffer`: reflectance, surface similarity, validity of the history."""

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import torch
from torch import Tensor
from torch.nn import functional as F

from supersampler.io.display import MAX_HALF
from supersampler.methods.constants import MIN_NORMAL
from supersampler.methods.gbuffer.spec import STEP_COST
from supersampler_model import ops

MIN_REFLECTANCE = 0.04  # added to every reflectance; about the reflectance of a dielectric
SAMPLE_SIGMA = 0.5  # Gaussian weight of a sample by distance, render pixels
DEPTH_SIGMA = 0.03  # Gaussian weight of a sample by relative depth difference
NORMAL_FALLOFF, BASE_COLOR_FALLOFF, FINISH_FALLOFF = 4.0, 8.0, 8.0
"""A sample's weight is exp(-falloff * squared difference), for each of these; finish: roughness, metallic."""
MAX_DISTANCE_CHANGE, MAX_COLOR_CHANGE = 0.1, 0.5
"""Changes of relative distance and of colour that invalidate the history: alpha and eta_B, section IV.B."""
BASE_COLOR_WINDOW, COLOR_WINDOW = 3, 5
"""Windows in which colours are compared, pixels a side: k_b and k_i of the paper."""
DEPTH_WINDOW = 9  # pixels a side: depth is relative to the closest in it
LIGHT_CHANGE, LIGHT_WINDOW = 6.0, 5
"""Change of light that invalidates the history: stops, averaged over a window of so many pixels a side."""
MIN_LUMINANCE = 1.0 / 64.0  # exposed; darker light counts as this
LOG2_E = 1.0 / math.log(2.0)


class Surfaces(NamedTuple):
    """G-buffers, at render or display size."""

    base_color: Tensor  # (1, 3, h, w) in [0, 1]
    normal: Tensor  # (1, 3, h, w) unit length; 0 at the sky
    roughness: Tensor  # (1, 1, h, w) in [0, 1], as the next two
    metallic: Tensor
    specular: Tensor
    depth: Tensor  # (1, 1, h, w) reversed


class Samples(NamedTuple):
    """The 3x3 samples of this frame around each display pixel, row by row."""

    colors: list[Tensor]  # of (1, 3, H, W), colour over reflectance, toned
    weights: list[Tensor]  # of (1, 1, H, W), by distance and similarity of the surfaces
    similarity: Tensor  # (1, 1, H, W) sum of the weights, about 1 where a similar surface was sampled


def usable_surfaces(surfaces: Surfaces, dtype: torch.dtype) -> Surfaces:
    """Sanitize, and convert all but depth to a type: NaN and values out of range become 0.

    Depth becomes UNKNOWN_DEPTH there.
    """
    *buffers, depth = surfaces
    known = [torch.where((b >= -1.0) & (b <= 1.0), b, 0.0) for b in (b.to(dtype) for b in buffers)]
    base, roughness, metallic, specular = (b.clamp(min=0.0) for b in (known[0], *known[2:]))
    return Surfaces(base, known[1], roughness, metallic, specular, ops.usable_depth(depth))


def reflectance(surfaces: Surfaces) -> Tensor:
    """Return the reflectance (1, 3, h, w): diffuse, plus specular at normal incidence; 1 at the sky.

    Colour over reflectance is light, which varies less than textures do (FuseSR, Zhong et al. 2023).
    """
    base, metal = surfaces.base_color, surfaces.metallic
    dielectric = 1.0 - metal
    reflected = base * dielectric + 0.08 * surfaces.specular * dielectric + base * metal + MIN_REFLECTANCE
    sky = (squared_norm(surfaces.normal) < MIN_NORMAL).to(base.dtype)
    return reflected + sky * (1.0 - reflected)


def lit(light: Tensor, reflected: Tensor) -> Tensor:
    """Multiply toned light by the reflectance; the result is toned.

    It equals `tone(inverse_tone(light) * reflected)`, without computing linear light, which may exceed the
    range of half floats.
    """
    color, minimum = light * reflected, ops.min_divisor(light, 1.0 / MAX_HALF)
    return (color / ((1.0 - ops.largest(light)).clamp(min=minimum) + ops.largest(color))).clamp(
        0.0, ops.TONED[light.dtype]
    )


def samples_of(light: Tensor, usable: Tensor, render: Surfaces, display: Surfaces, grid: ops.Grid) -> Samples:
    """Gather the 3x3 samples around each display pixel, weighted by distance and surface similarity.

    Args:
        light: (1, 3, h, w) colour over reflectance, toned.
        usable: (1, 1, h, w) 1 where the colour is valid, else 0; float32, as all weights are.
        render: surfaces of the samples.
        display: surfaces of the display pixels.
        grid: grid of the display.
    """
    colors, weights, similar = [], [], []
    own, target = _features(render), _features(display)
    # |a - b|^2 = |a|^2 - 2 a b + |b|^2, where |a|^2 is computed once for each sample
    lengths, target_length, twice = squared_norm(own), squared_norm(target), -2.0 * target
    for down, across, sample in samples_3x3([light, usable, render.depth, lengths, own], grid):
        color, valid, depth, length, features = sample
        vertical = ops.gaussian(SAMPLE_SIGMA)(grid.y.nearest + down - grid.y.position)[:, None]
        near = (
            vertical * ops.gaussian(SAMPLE_SIGMA)(grid.x.nearest + across - grid.x.position) + 1e-4
        ) * valid
        deviation = depth_difference(depth, display.depth).to(target.dtype)
        of_depth = (deviation * deviation * (0.5 / DEPTH_SIGMA**2)).clamp(max=10.0)
        of_features = (features * twice).sum(dim=1, keepdim=True) + length + target_length
        similarity = (-(of_depth + of_features)).exp().float()
        colors.append(color)
        weights.append(near * (similarity + 1e-4))
        similar.append(near * similarity)
    return Samples(colors, weights, ops.sum_of(similar))


def samples_3x3(images: Sequence[Tensor], grid: ops.Grid) -> Iterator[tuple[int, int, list[Tensor]]]:
    """Yield the 3x3 samples around each display pixel: offset down, offset across, samples (1, c, H, W)."""
    width, height = ops.size_of(images[0])
    offsets = (-1, 0, 1)
    columns = [(grid.x.nearest + across).clamp(0, width - 1) for across in offsets]
    picked = [[ops.pick_columns(image, column) for image in images] for column in columns]
    for down in offsets:
        row = (grid.y.nearest + down).clamp(0, height - 1)
        for across, of_column in zip(offsets, picked, strict=True):
            yield down, across, [image.index_select(2, row) for image in of_column]


def _features(surfaces: Surfaces) -> Tensor:
    """Return features (1, 8, h, w) whose squared distance is the dissimilarity of surfaces, without depth."""
    finish = torch.cat([surfaces.roughness, surfaces.metallic], dim=1)
    normal, base = NORMAL_FALLOFF**0.5 * surfaces.normal, BASE_COLOR_FALLOFF**0.5 * surfaces.base_color
    return torch.cat([normal, base, FINISH_FALLOFF**0.5 * finish], dim=1)


def weighted_mean(samples: Samples, kernel: Tensor | None = None) -> Tensor:
    """Return the mean (1, 3, H, W) of the samples.

    Args:
        samples: samples with their weights.
        kernel: (1, 9, H, W) logarithms of factors to the weights; None: all factors are 1.
    """
    weights = samples.weights
    if kernel is not None:
        factors = ops.channels_of(kernel.float().exp())
        weights = [weight * factor for weight, factor in zip(weights, factors, strict=True)]
    total = ops.sum_of(weights).clamp(min=1e-12)
    return ops.sum_of([c * (w / total).to(c.dtype) for c, w in zip(samples.colors, weights, strict=True)])


def relative_depth(depth: Tensor, closest: Tensor) -> Tensor:
    """Return depth over the closest depth around, in [0, 1], which is independent of the unit of depth."""
    return (depth.clamp(min=0.0) / closest.clamp(min=1e-12)).clamp(max=1.0)


def closest_around(depth: Tensor) -> Tensor:
    """Return the closest depth in each window of DEPTH_WINDOW pixels a side."""
    return F.max_pool2d(depth.clamp(min=0.0), DEPTH_WINDOW, 1, DEPTH_WINDOW // 2)


def gradients(surfaces: Surfaces) -> Tensor:
    """Return L1 differences (1, 2, h, w) of base colour and normal to the right and lower pixel (III.B)."""
    both = torch.cat([surfaces.base_color, surfaces.normal], dim=1)
    across, down = ((ops.shifted(both, *side) - both).abs() for side in ((1, 0), (0, 1)))
    sums = (across + down).split_with_sizes([3, 3], dim=1)
    return torch.cat([part.sum(dim=1, keepdim=True) for part in sums], dim=1)


def occluded(now: Sequence[Tensor], previous: Sequence[Tensor]) -> Tensor:
    """Return (1, 1, h, w): 1 where a warped previous frame is invalid, else 0 (equations 1 and 2).

    A frame is given by its toned colour, base colour and depth.
    """
    (color, base, depth), (previous_color, previous_base, previous_depth) = now, previous
    distance, previous_distance = (1.0 / d.clamp(min=1e-9) for d in (depth, previous_depth))
    moved = ((distance - previous_distance).abs() > MAX_DISTANCE_CHANGE * distance).float()
    other_base = _differs(previous_base, base, BASE_COLOR_WINDOW)
    return torch.maximum(moved, torch.maximum(other_base, _differs(previous_color, color, COLOR_WINDOW)))


def changed_light(now: Tensor, previous: Tensor, known: Tensor) -> Tensor:
    """Return (1, 1, h, w): 1 where the light changed abruptly since the previous frame, else 0.

    An abrupt change is more than LIGHT_CHANGE stops, averaged over the known pixels in a window of
    LIGHT_WINDOW pixels a side. Lamps and shadows rarely change that much in one frame, and a firefly covers
    too few pixels.

    Args:
        now: (1, 3, h, w) exposed colour.
        previous: (1, 3, h, w) of the previous frame, warped, at the same exposure.
        known: (1, 1, h, w) 1 where both are usable, else 0.
    """
    change = (_stops(now) - _stops(previous)) * known
    window = torch.ones(1, 1, LIGHT_WINDOW, LIGHT_WINDOW, device=now.device)
    sums = F.conv2d(torch.cat([change, known]), window, padding=LIGHT_WINDOW // 2)
    return (sums[:1].abs() > LIGHT_CHANGE * sums[1:]).float()


def _stops(exposed: Tensor) -> Tensor:
    return ops.luminance(exposed).clamp(min=MIN_LUMINANCE).log() * LOG2_E


def _differs(warped: Tensor, image: Tensor, size: int) -> Tensor:
    """Return 1 where a warped pixel differs from more than half of the image's pixels around it, else 0.

    Pixels differ by more than MAX_COLOR_CHANGE in some channel; the window is `size` pixels a side.
    """
    reach = size // 2
    h, w = image.shape[2], image.shape[3]
    rows = torch.arange(-reach, h + reach, device=image.device).clamp(0, h - 1)
    columns = torch.arange(-reach, w + reach, device=image.device).clamp(0, w - 1)
    wide = image.index_select(2, rows).index_select(3, columns)
    parts = [wide[:, :, y : y + h, x : x + w] for y in range(size) for x in range(size)]
    far = ops.largest((torch.cat(parts) - warped).abs()) > MAX_COLOR_CHANGE
    return (far.to(image.dtype).sum(dim=0, keepdim=True) > 0.5 * size * size).float()


def motion_of_surface(depth: Tensor, motion: Tensor, display_depth: Tensor, grid: ops.Grid) -> Tensor:
    """Return the motion (1, 2, H, W) of the 3x3 sample whose depth is most similar to the display pixel's."""
    lowest = torch.full_like(display_depth, torch.inf)
    chosen = torch.zeros_like(display_depth).expand(-1, 2, -1, -1)
    for down, across, (sample, moved) in samples_3x3([depth, motion], grid):
        cost = depth_difference(sample, display_depth) + STEP_COST * (down * down + across * across)
        better = cost < lowest
        lowest, chosen = torch.where(better, cost, lowest), torch.where(better, moved, chosen)
    return chosen


def depth_difference(a: Tensor, b: Tensor) -> Tensor:
    """Return the absolute difference of two depths, relative to the closer one."""
    return (a - b).abs() / torch.maximum(a, b).clamp(min=1e-12)


def squared_norm(vectors: Tensor) -> Tensor:
    """Return the squared length of vectors: (1, c, h, w) -> (1, 1, h, w)."""
    return (vectors * vectors).sum(dim=1, keepdim=True)


class NearestSamples(NamedTuple):
    """The sample of a previous frame nearest to the point that each pixel's motion points to."""

    values: Tensor  # (1, c, h, w) unfiltered
    offset: Tensor  # (1, 2, h, w) from that point to the sample, render pixels
    on_screen: Tensor  # (1, 1, h, w) 1 where the motion points inside the screen


def read_nearest(image: Tensor, motion: Tensor, offset: Tensor) -> NearestSamples:
    """Read the nearest samples of a previous frame where `motion` points.

    Args:
        image: (1, c, h, w).
        motion: (1, 2, h, w) render pixels.
        offset: (1, 2) this frame's jitter minus the jitter of that frame, render pixels.
    """
    h, w = image.shape[2], image.shape[3]
    x, y = _targets(motion, offset)
    on_screen = (x > -0.5) & (x < w - 0.5) & (y > -0.5) & (y < h - 0.5)
    x, y = x.clamp(-2.0, w + 1.0), y.clamp(-2.0, h + 1.0)
    column, row = (x + 0.5).floor(), (y + 0.5).floor()
    values = ops.read(image, ops.positions_of(column, row), mode="nearest")
    return NearestSamples(values, torch.cat([column - x, row - y], dim=1), on_screen.float())


def read_bilinear(image: Tensor, motion: Tensor, offset: Tensor) -> Tensor:
    """Read a previous frame bilinearly where `motion` points; see `read_nearest` for the arguments."""
    x, y = _targets(motion, offset)
    x, y = x.clamp(-2.0, image.shape[3] + 1.0), y.clamp(-2.0, image.shape[2] + 1.0)
    return ops.read(image, ops.positions_of(x, y))


def _targets(motion: Tensor, offset: Tensor) -> tuple[Tensor, Tensor]:
    """Return the positions, (1, 1, h, w) each, that the motion of each pixel points to."""
    h, w = motion.shape[2], motion.shape[3]
    x = torch.arange(w, device=motion.device) + motion[:, :1] + offset[0, 0]
    y = torch.arange(h, device=motion.device)[:, None] + motion[:, 1:2] + offset[0, 1]
    return x, y
