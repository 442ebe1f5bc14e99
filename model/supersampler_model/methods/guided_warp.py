"""`guided-warp`: the colour of an unshaded frame, from the last shaded one (Wu et al. 2023, ExtraSS).

The G-buffers of an unshaded frame give its surfaces; only the light is missing (section 4.2). The colours of
the shaded frame over its reflectance are its light. Each pixel of the unshaded frame is reprojected into the
shaded frame, and averages the light of four of the 33 samples around that position: those whose surfaces are
most similar to its own. Disoccluded and off-screen surfaces therefore take the light of a similar surface
nearby, not of their occluder. The light is multiplied by each pixel's own reflectance. The image has the
samples and the jitter of the unshaded frame, so that an upscaler can step on it as on a shaded frame.
"""

from collections.abc import Sequence
from functools import reduce
from typing import ClassVar, NamedTuple

import torch
from torch import Tensor

from supersampler.io.display import MAX_HALF
from supersampler.methods.constants import MAX_MOTION, MIN_NORMAL, UNKNOWN_DEPTH
from supersampler.methods.extrapolation.spec import (
    GUIDED_WARP,
    INVALID_DEPTH,
    KEY_INDICES,
    KEY_STEPS,
    MAX_KEY,
    MIN_LIGHT_WEIGHT,
    NEIGHBOURS,
    SKY_DEPTH,
    GuidedWarpConfig,
)
from supersampler_model import ops
from supersampler_model.methods.base import Method

MISSING = float("nan")


class Surface(NamedTuple):
    """The sanitized G-buffers of a frame."""

    base_color: Tensor  # (1, 3, h, w)
    normal: Tensor  # (1, 3, h, w)
    depth: Tensor  # (1, 1, h, w) UNKNOWN_DEPTH where the sample is invalid


class Shaded(NamedTuple):
    """A shaded frame, the source of light."""

    color: Tensor  # (1, 3, h', w') linear RGB, sanitized; 0 where the sample is missing
    usable: Tensor  # (1, 1, h', w') 0 where the sample is missing, else 1
    surface: Surface
    jitter: Tensor  # (1, 2)

    def next_color(self) -> Tensor:
        """Return the colour for the next history: NaN where the sample is missing."""
        return torch.where(self.usable > 0.0, self.color, MISSING)


class Light(NamedTuple):
    """Light on the surfaces of an unshaded frame."""

    color: Tensor  # (1, 3, h, w) 0 where it is unknown
    known: Tensor  # (1, 1, h, w) whether a sample of the shaded frame is near: bool


class Guide(NamedTuple):
    """The surface features by which samples are selected, and the positions around which they lie."""

    pixels: Tensor  # (h w, 7) features of the pixels
    samples: Tensor  # (h' w', 7) features of the shaded frame's samples
    size: ops.Size  # of the shaded frame
    x: Tensor  # (h w) position of each pixel in the shaded frame; 0 is the first sample
    y: Tensor


class Candidate(NamedTuple):
    """A sample of the shaded frame for each pixel."""

    sample: Tensor  # (h w) int64 index, row by row
    cost: Tensor  # (h w) -log of its weight


def shaded_of(color: Tensor, base_color: Tensor, normal: Tensor, depth: Tensor, jitter: Tensor) -> Shaded:
    """Sanitize a shaded frame."""
    usable = ops.valid(color)
    surface = surface_of(base_color, normal, depth, usable)
    return Shaded(ops.sanitize(color, 0.0) * usable, usable, surface, jitter)


def reflectance(surface: Surface, config: GuidedWarpConfig) -> Tensor:
    """Return the reflectance (1, 3, h, w): base colour plus `config.least`; 1 at the sky."""
    sky = ops.sum_of([surface.normal[:, i : i + 1] ** 2 for i in range(3)]) < MIN_NORMAL
    return torch.where(sky, 1.0, surface.base_color + config.least)


def guided_light(surface: Surface, shaded: Shaded, x: Tensor, y: Tensor, config: GuidedWarpConfig) -> Light:
    """Return the light on surfaces of this frame, from similar samples of a shaded frame.

    Args:
        surface: (h, w) of all pixels of this frame, or of some.
        shaded: the shaded frame.
        x: (1, 1, h, w) position of each pixel in it, see `samples_at`; clamped to the screen.
        y: (1, 1, h, w) vertical position.
        config: constants.
    """
    guide = _guide(surface, shaded, x, y, config)
    light = _rows(shaded.color / reflectance(shaded.surface, config))
    return _mean(_candidates(guide, config), light, _rows(shaded.usable), ops.size_of(surface.depth))


def _guide(surface: Surface, shaded: Shaded, x: Tensor, y: Tensor, config: GuidedWarpConfig) -> Guide:
    size = ops.size_of(shaded.color)
    x, y = x.clamp(0.0, size.width - 1.0), y.clamp(0.0, size.height - 1.0)
    # If no depth of the shaded frame is valid, depth must not count, or no sample would be similar.
    has_depth = (shaded.surface.depth >= 0.0).float().sum() > 0.0
    unknown = torch.full_like(surface.depth, UNKNOWN_DEPTH)
    surface = surface._replace(depth=torch.where(has_depth, surface.depth, unknown))
    pixels, samples = _features(surface, config), _features(shaded.surface, config)
    return Guide(pixels, samples, size, x.reshape(-1), y.reshape(-1))


def _features(surface: Surface, config: GuidedWarpConfig) -> Tensor:
    """Return features (h w, 7) in standard deviations: base colour, normal, logarithm of depth."""
    shades = torch.cat([surface.base_color, surface.normal], dim=1) / config.surface_sigma
    log_depth = surface.depth.clamp(min=SKY_DEPTH).log() / config.depth_sigma  # its differences are relative
    log_depth = torch.where(surface.depth < 0.0, INVALID_DEPTH, log_depth)
    return _rows(torch.cat([shades, log_depth], dim=1))


def _candidates(guide: Guide, config: GuidedWarpConfig) -> list[Candidate]:
    """Select the `config.taps` samples of largest joint bilateral weight (equation 2)."""
    rings = [(float(stride * x), float(stride * y)) for stride in config.strides for x, y in NEIGHBOURS]
    offsets = [(0.0, 0.0), *rings]  # from near to far
    selected = indices_of_smallest(
        [_candidate(guide, *offset, config).cost for offset in offsets], config.taps
    )
    across, down = (torch.tensor(axis, device=guide.x.device) for axis in zip(*offsets, strict=True))
    return [_candidate(guide, across.index_select(0, n), down.index_select(0, n), config) for n in selected]


def _candidate(
    guide: Guide, across: Tensor | float, down: Tensor | float, config: GuidedWarpConfig
) -> Candidate:
    """Return the samples at an offset from the pixels' positions: (h w) offsets, or one for all pixels."""
    x, y = (guide.x + 0.5).floor() + across, (guide.y + 0.5).floor() + down
    column = x.clamp(0.0, guide.size.width - 1.0).long()
    row = y.clamp(0.0, guide.size.height - 1.0).long()
    index = row * guide.size.width + column
    difference = guide.pixels - guide.samples.index_select(0, index)
    x, y = (x - guide.x) / config.distance_sigma, (y - guide.y) / config.distance_sigma
    return Candidate(index, 0.5 * ((difference * difference).sum(dim=1) + (x * x + y * y)))


def _mean(candidates: Sequence[Candidate], light: Tensor, usable: Tensor, size: ops.Size) -> Light:
    """Return the mean of the usable (h' w', 1) samples of `light`, (h' w', 3), by weight (equation 3)."""
    lowest = reduce(torch.minimum, [candidate.cost for candidate in candidates])
    samples = [candidate.sample for candidate in candidates]
    weights = [
        (lowest - candidate.cost).exp()[:, None] * usable.index_select(0, candidate.sample)
        for candidate in candidates
    ]
    terms = [light.index_select(0, sample) * weight for sample, weight in zip(samples, weights, strict=True)]
    total = ops.sum_of(weights)
    mean = ops.sum_of(terms) / total.clamp(min=MIN_LIGHT_WEIGHT)

    def image(rows: Tensor) -> Tensor:
        return rows.reshape(1, size.height, size.width, -1).permute(0, 3, 1, 2)

    return Light(image(mean), image(total) >= MIN_LIGHT_WEIGHT)


def surface_of(base_color: Tensor, normal: Tensor, depth: Tensor, usable: Tensor | None = None) -> Surface:
    """Sanitize the G-buffers of a frame.

    Args:
        base_color: (1, 3, h, w).
        normal: (1, 3, h, w).
        depth: (1, 1, h, w) reversed.
        usable: (1, 1, h, w) 1 where the sample's colour is valid, else 0; None: everywhere.

    Returns:
        The surfaces; their depth is UNKNOWN_DEPTH where a G-buffer is invalid or the sample is not usable.
    """
    depth = ops.usable_depth(depth)
    known = torch.cat([base_color, normal], dim=1).abs() <= MAX_HALF
    valid_here = [known[:, i : i + 1] for i in range(6)] + ([] if usable is None else [usable > 0.0])
    depth = torch.where(reduce(torch.logical_and, valid_here), depth, UNKNOWN_DEPTH)
    return Surface(ops.finite(base_color).clamp(0.0, 1.0), ops.finite(normal).clamp(-1.0, 1.0), depth)


def back_to_shaded(motion: Tensor, jitter: Tensor, before: Tensor, jitter_before: Tensor) -> Tensor:
    """Return the motion (1, 2, h, w) from this frame to the last shaded frame, through the previous frame.

    Args:
        motion: (1, 2, h, w) to the previous frame, in pixels of this frame.
        jitter: (1, 2) of this frame.
        before: (1, 2, h'', w'') from the previous frame to the last shaded one, in pixels of the previous
            frame; zeros if the previous frame was shaded.
        jitter_before: (1, 2) of the previous frame.
    """
    motion = ops.usable_motion(motion)
    render, previous = ops.size_of(motion), ops.size_of(before)
    places = ops.positions_of(*samples_at(motion, jitter, previous, jitter_before))
    rest = ops.read(ops.usable_motion(before), places)
    across = rest[:, :1] * render.width / previous.width
    down = rest[:, 1:] * render.height / previous.height
    return (motion + torch.cat([across, down], dim=1)).clamp(-MAX_MOTION, MAX_MOTION)


def samples_at(
    motion: Tensor, jitter: Tensor, other: ops.Size, other_jitter: Tensor
) -> tuple[Tensor, Tensor]:
    """Return the positions x and y, (1, 1, h, w) each, that motion points to among another frame's samples.

    Args:
        motion: (1, 2, h, w) in pixels of its own frame, without jitter.
        jitter: (1, 2) of that frame.
        other: size of the other frame.
        other_jitter: (1, 2) of the other frame; position 0 is its first sample.
    """
    w, h = ops.size_of(motion)
    x = torch.arange(w, device=motion.device) + motion[:, :1] + (jitter[0, 0] + 0.5)
    y = torch.arange(h, device=motion.device)[:, None] + motion[:, 1:] + (jitter[0, 1] + 0.5)
    return x * other.width / w - (other_jitter[0, 0] + 0.5), y * other.height / h - (other_jitter[0, 1] + 0.5)


def indices_of_smallest(values: Sequence[Tensor], count: int) -> list[Tensor]:
    """Return the indices, (n) int64 each, of the `count` smallest values, smallest first.

    This is a partial insertion sort of minima and maxima, because TopK differs between ONNX providers. A key
    holds a value in steps of 1 / KEY_STEPS and, in its lower digits, the index: one comparison sorts both,
    and the first of equal values wins. Values are >= 0, (n) each; those above MAX_KEY / KEY_STEPS count as
    equal.
    """
    smallest: list[Tensor] = []
    for number, value in enumerate(values):
        key = (value * KEY_STEPS).floor().clamp(max=MAX_KEY) * KEY_INDICES + float(number)
        for position, smaller in enumerate(smallest):
            smallest[position], key = torch.minimum(smaller, key), torch.maximum(smaller, key)
        if len(smallest) < count:
            smallest.append(key)
    return [(key - (key / KEY_INDICES).floor() * KEY_INDICES).long() for key in smallest]


def _rows(planes: Tensor) -> Tensor:
    """Return (1, c, h, w) as (h w, c): the channels of a pixel are contiguous."""
    return planes[0].permute(1, 2, 0).reshape(-1, planes.shape[1])


class GuidedWarp(Method):
    """Light each pixel like similar surfaces of the last shaded frame.

    It does not step on shaded frames: the history after one is that frame, see `after_shaded`. With a history
    of zeros the image is black. Samples with invalid surface or depth are used only where there are no
    others. Where all samples nearby are missing, so is the pixel: the image is NaN.
    """

    spec: ClassVar = GUIDED_WARP
    config: GuidedWarpConfig

    def compute(
        self,
        depth: Tensor,  # (1, 1, h, w) reversed
        motion: Tensor,  # (1, 2, h, w) render pixels, previous minus current
        jitter: Tensor,  # (1, 2) render pixels
        gbuffer_base_color: Tensor,  # (1, 3, h, w)
        gbuffer_normal: Tensor,  # (1, 3, h, w)
        history_color: Tensor,  # (1, 3, h', w') linear RGB
        history_base_color: Tensor,  # (1, 3, h', w')
        history_normal: Tensor,  # (1, 3, h', w')
        history_depth: Tensor,  # (1, 1, h', w')
        history_jitter: Tensor,  # (1, 2)
        history_motion: Tensor,  # (1, 2, h'', w'')
        history_motion_jitter: Tensor,  # (1, 2)
    ) -> tuple[Tensor, ...]:
        """Return the image (1, 3, h, w), linear RGB >= 0 or NaN, and the next history."""
        surface = surface_of(gbuffer_base_color, gbuffer_normal, depth)
        shaded = shaded_of(history_color, history_base_color, history_normal, history_depth, history_jitter)
        to_shaded = back_to_shaded(motion, jitter, history_motion, history_motion_jitter)
        x, y = samples_at(to_shaded, jitter, ops.size_of(shaded.color), shaded.jitter)
        light, known = guided_light(surface, shaded, x, y, self.config)
        image = torch.where(known, ops.bounded(light * reflectance(surface, self.config)), MISSING)
        return (image, shaded.next_color(), *shaded.surface, shaded.jitter * 1.0, to_shaded, jitter * 1.0)
