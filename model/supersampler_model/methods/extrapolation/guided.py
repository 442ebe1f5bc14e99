"""Guided light: this frame's surfaces are lit as similar surfaces were in a shaded frame.

Wu et al. 2023 (ExtraSS), section 4.2. The colours of a shaded frame are divided by its base colours. Each
pixel of this frame is reprojected into that frame and takes, among 33 samples around, from near to far, the
four most similar to its own surface. Disoccluded and off-screen surfaces are then lit like a similar surface
nearby, not like their occluder.
"""

from collections.abc import Sequence
from functools import reduce
from typing import NamedTuple

import torch
from torch import Tensor

from supersampler.methods.extrapolation.spec import GuidedWarpConfig
from supersampler_model.methods.base import Size, render_size_of
from supersampler_model.ops.color import MAX_HALF, finite, sanitize, valid
from supersampler_model.ops.motion import FAR, UNKNOWN_DEPTH, read, usable_depth, usable_motion
from supersampler_model.ops.sampling import sum_of

AROUND = ((0, -1), (-1, 0), (1, 0), (0, 1), (-1, -1), (1, -1), (-1, 1), (1, 1))
"""Offsets (x, y) of the neighbours of a pixel, nearest first."""
FARTHEST = 1e-30  # depth of the sky, for its logarithm
NOWHERE = 1e4  # depth of invalid samples, in standard deviations: far from all others
STEPS, MOST, NUMBERS = 16.0, 262143.0, 64.0
"""Layout of a sort key: steps per unit of -log weight, maximum of steps, range of indices."""


class Surface(NamedTuple):
    """The sanitized G-buffers of a frame."""

    base_color: Tensor  # (1, 3, h, w)
    normal: Tensor  # (1, 3, h, w)
    depth: Tensor  # (1, 1, h, w) UNKNOWN_DEPTH where the sample is invalid


class Shaded(NamedTuple):
    """A shaded frame, the source of light."""

    color: Tensor  # (1, 3, h', w') linear RGB, sanitized
    surface: Surface
    jitter: Tensor  # (1, 2)


class Guide(NamedTuple):
    """The features that samples are chosen by."""

    own: Tensor  # (h w, 7) surface features of the pixels
    samples: Tensor  # (h' w', 7) surface features of the shaded frame
    size: Size  # of that frame
    x: Tensor  # (h w) position of each pixel in it; 0 is the first sample
    y: Tensor


class Chosen(NamedTuple):
    """A sample of the shaded frame for each pixel."""

    at: Tensor  # (h w) int64, row by row
    cost: Tensor  # (h w) -log of its weight


def shaded_of(color: Tensor, base_color: Tensor, normal: Tensor, depth: Tensor, jitter: Tensor) -> Shaded:
    """Sanitize a shaded frame."""
    surface = surface_of(base_color, normal, depth, valid(color))
    return Shaded(sanitize(color, 0.0), surface, jitter)


def light_of(color: Tensor, surface: Surface, config: GuidedWarpConfig) -> Tensor:
    """(1, 3, h, w) light: colour over reflectance."""
    return color / reflectance(surface, config)


def reflectance(surface: Surface, config: GuidedWarpConfig) -> Tensor:
    """(1, 3, h, w) reflectance: base colour plus `least`; 1 at the sky."""
    sky = sum_of([surface.normal[:, i : i + 1] ** 2 for i in range(3)]) < 0.1
    return torch.where(sky, torch.ones_like(surface.base_color), surface.base_color + config.least)


def guided_light(now: Surface, then: Shaded, x: Tensor, y: Tensor, config: GuidedWarpConfig) -> Tensor:
    """(1, 3, h, w) light on this frame's surfaces, from the most similar samples of a shaded frame.

    Args:
        now: surfaces (h, w), of all pixels of this frame or of some.
        then: the shaded frame.
        x: (1, 1, h, w) their positions in it, see `samples_at`; clamped to the screen.
        y: the same, vertically.
        config: constants.
    """
    guide = _guide(now, then, x, y, config)
    return _mean(_chosen(guide, config), _rows(light_of(then.color, then.surface, config)), now)


def _guide(now: Surface, then: Shaded, x: Tensor, y: Tensor, config: GuidedWarpConfig) -> Guide:
    size = render_size_of(then.color)
    x, y = x.clamp(0.0, size.width - 1.0), y.clamp(0.0, size.height - 1.0)
    # where the shaded frame has no depth at all, the other features alone tell its samples apart
    has_depth = (then.surface.depth >= 0.0).float().sum() > 0.0
    now = now._replace(depth=torch.where(has_depth, now.depth, torch.full_like(now.depth, UNKNOWN_DEPTH)))
    own, samples = _columns(now, config), _columns(then.surface, config)
    return Guide(own, samples, size, x.reshape(-1), y.reshape(-1))


def _columns(surface: Surface, config: GuidedWarpConfig) -> Tensor:
    """(h w, 7) surface features in standard deviations: base colour, normal, logarithm of depth."""
    shades = torch.cat([surface.base_color, surface.normal], dim=1) / config.surface_sigma
    distance = (
        surface.depth.clamp(min=FARTHEST).log() / config.depth_sigma
    )  # differences of logarithms are relative
    distance = torch.where(surface.depth < 0.0, torch.full_like(distance, NOWHERE), distance)
    return _rows(torch.cat([shades, distance], dim=1))


def _chosen(guide: Guide, config: GuidedWarpConfig) -> list[Chosen]:
    """Choose the samples of largest weight: joint bilateral (equation 2)."""
    rings = [(float(stride * x), float(stride * y)) for stride in config.strides for x, y in AROUND]
    places = [(0.0, 0.0), *rings]  # from near to far
    numbers = indices_of_least([_sample(guide, *place, config).cost for place in places], config.taps)
    across, down = (torch.tensor(axis, device=guide.x.device) for axis in zip(*places, strict=True))
    return [_sample(guide, across.index_select(0, n), down.index_select(0, n), config) for n in numbers]


def _sample(guide: Guide, across: Tensor | float, down: Tensor | float, config: GuidedWarpConfig) -> Chosen:
    """Return the samples at an offset, (h w) or one for all, from the pixels' positions, and their costs."""
    x, y = (guide.x + 0.5).floor() + across, (guide.y + 0.5).floor() + down
    column = x.clamp(0.0, guide.size.width - 1.0).long()
    row = y.clamp(0.0, guide.size.height - 1.0).long()
    index = row * guide.size.width + column
    apart = guide.own - guide.samples.index_select(0, index)
    x, y = (x - guide.x) / config.distance_sigma, (y - guide.y) / config.distance_sigma
    return Chosen(index, 0.5 * ((apart * apart).sum(dim=1) + (x * x + y * y)))


def _mean(chosen: Sequence[Chosen], light: Tensor, now: Surface) -> Tensor:
    """(1, 3, h, w) mean of chosen samples of `light`, (h' w', 3) (equation 3)."""
    least = reduce(torch.minimum, [sample.cost for sample in chosen])
    weights = [(least - sample.cost).exp()[:, None] for sample in chosen]
    lit = [light.index_select(0, s.at) * share for s, share in zip(chosen, weights, strict=True)]
    mean = sum_of(lit) / sum_of(weights)
    size = render_size_of(now.depth)
    return mean.reshape(1, size.height, size.width, 3).permute(0, 3, 1, 2)


def surface_of(base_color: Tensor, normal: Tensor, depth: Tensor, usable: Tensor | None = None) -> Surface:
    """Sanitize the G-buffers of a frame.

    Depth is UNKNOWN_DEPTH where one of them is invalid, or the sample is not `usable`, (1, 1, h, w) 0 or 1.
    """
    depth = usable_depth(depth)
    known = torch.cat([base_color, normal], dim=1).abs() <= MAX_HALF
    good = [known[:, i : i + 1] for i in range(6)] + ([] if usable is None else [usable > 0.0])
    depth = torch.where(reduce(torch.logical_and, good), depth, torch.full_like(depth, UNKNOWN_DEPTH))
    return Surface(finite(base_color).clamp(0.0, 1.0), finite(normal).clamp(-1.0, 1.0), depth)


def back_to_shaded(motion: Tensor, jitter: Tensor, before: Tensor, jitter_before: Tensor) -> Tensor:
    """(1, 2, h, w) motion of this frame back to the last shaded one, chained through the previous frame.

    Args:
        motion: (1, 2, h, w) of this frame, its own pixels.
        jitter: (1, 2) of this frame.
        before: (1, 2, h'', w'') of the previous frame back to the last shaded one, its own pixels; zeros if
            the previous frame was shaded.
        jitter_before: (1, 2) of the previous frame.
    """
    motion = usable_motion(motion)
    render, previous = render_size_of(motion), render_size_of(before)
    further = read(usable_motion(before), *samples_at(motion, jitter, previous, jitter_before))
    across = further[:, :1] * render.width / previous.width
    down = further[:, 1:] * render.height / previous.height
    return (motion + torch.cat([across, down], dim=1)).clamp(-FAR, FAR)


def samples_at(motion: Tensor, jitter: Tensor, then: Size, jitter_then: Tensor) -> tuple[Tensor, Tensor]:
    """Positions, (1, 1, h, w) each, that motion points to in another frame; 0 is its first sample.

    Args:
        motion: (1, 2, h, w), pixels of its own frame, which its jitter is not in.
        jitter: (1, 2) of that frame.
        then: size of the other frame.
        jitter_then: (1, 2) of it.
    """
    w, h = render_size_of(motion)
    x = torch.arange(w, device=motion.device) + motion[:, :1] + (jitter[0, 0] + 0.5)
    y = torch.arange(h, device=motion.device)[:, None] + motion[:, 1:] + (jitter[0, 1] + 0.5)
    return x * then.width / w - (jitter_then[0, 0] + 0.5), y * then.height / h - (jitter_then[0, 1] + 0.5)


def indices_of_least(values: Sequence[Tensor], count: int) -> list[Tensor]:
    """Return the indices of the `count` smallest values, of (n) int64 each.

    Values, (n) each and >= 0, are compared in steps of 1 / STEPS, up to MOST steps; the first of equal values
    wins. Sorted by comparison and exchange, as TopK differs between providers. Steps and index are exchanged
    as one float: two operators in place of five.
    """
    least: list[Tensor] = []
    for number, value in enumerate(values):
        key = (value * STEPS).floor().clamp(max=MOST) * NUMBERS + float(number)
        for place, there in enumerate(least):
            least[place], key = torch.minimum(there, key), torch.maximum(there, key)
        if len(least) < count:
            least.append(key)
    return [(key - (key / NUMBERS).floor() * NUMBERS).long() for key in least]


def _rows(planes: Tensor) -> Tensor:
    """(1, c, h, w) to (h w, c): the channels of a pixel are contiguous."""
    return planes[0].permute(1, 2, 0).reshape(-1, planes.shape[1])
