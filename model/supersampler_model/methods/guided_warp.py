"""`guided-warp`: the colour of a frame that was not shaded, from the last one that was.

Textures and surfaces of this frame are known from its G-buffers; only the light on them is not. Each pixel
looks for it where it was in the last shaded frame: among 33 samples around, from near to far, it takes the
four that are most like its own surface, divides their colours by their base colours, and lights its own base
colour by what that gives. What was hidden or off screen then is lit as a like surface nearby is, not as what
hid it (Wu et al. 2023, section 4.2). The picture has this frame's samples and jitter: an upscaler steps on it
as on a shaded frame.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce
from typing import ClassVar, NamedTuple

import torch
from torch import Tensor

from supersampler_model.color import MAX_HALF, bounded, finite, quarantine, valid
from supersampler_model.method import PREVIOUS, RENDER, SHADED, Method, Size, render_size_of
from supersampler_model.motion import FAR, UNKNOWN_DEPTH, read, usable_depth, usable_motion
from supersampler_model.sampling import sum_of

AROUND = ((0, -1), (-1, 0), (1, 0), (0, 1), (-1, -1), (1, -1), (-1, 1), (1, 1))
"""The neighbours of a pixel, (x, y), nearer ones first."""
FARTHEST = 1e-30  # depth of the sky, for its logarithm
NOWHERE = 1e4  # where samples of no use are, standard deviations of depth away from all others
STEPS, MOST, NUMBERS = 16.0, 262143.0, 64.0
"""Of a key: steps of -log weight, as many of them as a float counts beside a number, and these."""


@dataclass(frozen=True)
class GuidedWarpConfig:
    """Constants; docs/methods.md has where they come from.

    Attributes:
        strides: of the rings of eight samples around the middle one, pixels (equation 1).
        taps: samples that are kept.
        surface_sigma: one standard deviation of base colour and normal (equation 2).
        depth_sigma: one of depth, as a share of it.
        distance_sigma: one of places on screen, pixels of the shaded frame (equation 2).
        least: reflectance that is added to base colours, so that dividing by black ones changes nothing.
    """

    strides: tuple[int, ...] = (1, 3, 5, 9)
    taps: int = 4
    surface_sigma: float = 0.03
    depth_sigma: float = 0.05
    distance_sigma: float = 1.0
    least: float = 0.02


class Surface(NamedTuple):
    """What G-buffers say of a frame; every value a number in its range."""

    base_color: Tensor  # (1, 3, h, w)
    normal: Tensor  # (1, 3, h, w)
    depth: Tensor  # (1, 1, h, w) UNKNOWN_DEPTH where the sample is of no use


class Guide(NamedTuple):
    """What samples are chosen by."""

    own: Tensor  # (h w, 7) what the surface of each pixel is told from
    samples: Tensor  # (h' w', 7) the same of the shaded frame's
    size: Size  # of that frame
    x: Tensor  # (h w) where each pixel was in it; 0 is the first sample's place
    y: Tensor


class Chosen(NamedTuple):
    """A sample of the shaded frame for each pixel."""

    at: Tensor  # (h w) int64, row by row
    off: Tensor  # (h w) -log of its weight


class Step(NamedTuple):
    """The image and what the next frame needs."""

    image: Tensor
    history_color: Tensor
    history_base_color: Tensor
    history_normal: Tensor
    history_depth: Tensor
    history_jitter: Tensor
    history_motion: Tensor
    history_motion_jitter: Tensor


class GuidedWarp(Method):
    """Light each pixel as like surfaces were lit in the last shaded frame.

    A shaded frame takes no step: what it leaves is itself, see `after_shaded`. Without one, which is a
    history of zeros, the image is black. A sample of which colour, surface or depth is no number in its range
    is not taken where there is another.
    """

    name, source = "guided-warp", "Wu et al. 2023 (ExtraSS), section 4.2"
    history: ClassVar = {
        "color": (1, 3, *SHADED),  # of the last shaded frame, as the next four
        "base_color": (1, 3, *SHADED),
        "normal": (1, 3, *SHADED),
        "depth": (1, 1, *SHADED),
        "jitter": (1, 2),
        "motion": (1, 2, *PREVIOUS),  # from the frame before back to the shaded one, its own pixels
        "motion_jitter": (1, 2),  # of the frame before
    }
    image: ClassVar = (1, 3, *RENDER)
    ratios: ClassVar = (1.0, 1.0)

    def __init__(self, config: GuidedWarpConfig | None = None) -> None:
        super().__init__()
        self.config = config or GuidedWarpConfig()

    def forward(
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
    ) -> Step:
        """Return the image (1, 3, h, w), linear RGB >= 0, and the history."""
        color = quarantine(history_color, 0.0)
        now = surface_of(gbuffer_base_color, gbuffer_normal, depth)
        then = surface_of(history_base_color, history_normal, history_depth, valid(history_color))
        total = back_to_shaded(motion, jitter, history_motion, history_motion_jitter)
        guide = self.gather(now, then, total, jitter, history_jitter)
        image = self.finish(self.network(guide), _rows(color / self.reflectance(then)), now)
        return Step(image, color, *then, history_jitter * 1.0, total, jitter * 1.0)

    def gather(
        self, now: Surface, then: Surface, motion: Tensor, jitter: Tensor, jitter_then: Tensor
    ) -> Guide:
        """Find where each pixel was; what was off screen, at the border."""
        size = render_size_of(then.depth)
        x, y = samples_at(motion, jitter, size, jitter_then)
        x, y = x.clamp(0.0, size.width - 1.0), y.clamp(0.0, size.height - 1.0)
        return Guide(self.columns(now), self.columns(then), size, x.reshape(-1), y.reshape(-1))

    def columns(self, surface: Surface) -> Tensor:
        """(h w, 7) what surfaces are told from, each in standard deviations: base colour, normal, depth."""
        c = self.config
        shades = torch.cat([surface.base_color, surface.normal], dim=1) / c.surface_sigma
        distance = surface.depth.clamp(min=FARTHEST).log() / c.depth_sigma  # whose differences are shares
        distance = torch.where(surface.depth < 0.0, torch.full_like(distance, NOWHERE), distance)
        return _rows(torch.cat([shades, distance], dim=1))

    def network(self, guide: Guide) -> list[Chosen]:
        """Choose the samples that weigh most: joint bilateral (equation 2)."""
        c = self.config
        rings = [(float(stride * x), float(stride * y)) for stride in c.strides for x, y in AROUND]
        places = [(0.0, 0.0), *rings]  # from near to far
        numbers = numbers_of_least([self.sample(guide, *place).off for place in places], c.taps)
        across, down = (torch.tensor(axis, device=guide.x.device) for axis in zip(*places, strict=True))
        return [self.sample(guide, across.index_select(0, n), down.index_select(0, n)) for n in numbers]

    def sample(self, guide: Guide, across: Tensor | float, down: Tensor | float) -> Chosen:
        """Look at the samples so far, (h w) or one for all, from where the pixels were."""
        x, y = (guide.x + 0.5).floor() + across, (guide.y + 0.5).floor() + down
        column = x.clamp(0.0, guide.size.width - 1.0).long()
        row = y.clamp(0.0, guide.size.height - 1.0).long()
        index = row * guide.size.width + column
        apart = guide.own - guide.samples.index_select(0, index)
        x, y = (x - guide.x) / self.config.distance_sigma, (y - guide.y) / self.config.distance_sigma
        return Chosen(index, 0.5 * ((apart * apart).sum(dim=1) + (x * x + y * y)))

    def finish(self, chosen: Sequence[Chosen], light: Tensor, now: Surface) -> Tensor:
        """Light this frame's surfaces by the mean of chosen samples of `light`, (h' w', 3) (equation 3)."""
        least = reduce(torch.minimum, [sample.off for sample in chosen])
        shares = [(least - sample.off).exp()[:, None] for sample in chosen]
        lit = [light.index_select(0, s.at) * share for s, share in zip(chosen, shares, strict=True)]
        mean = sum_of(lit) / sum_of(shares)
        size = render_size_of(now.depth)
        planes = mean.reshape(1, size.height, size.width, 3).permute(0, 3, 1, 2)
        return bounded(planes * self.reflectance(now))

    def reflectance(self, surface: Surface) -> Tensor:
        """(1, 3, h, w) what colours are divided by: base colour; one at the sky."""
        sky = sum_of([surface.normal[:, i : i + 1] ** 2 for i in range(3)]) < 0.1
        return torch.where(sky, torch.ones_like(surface.base_color), surface.base_color + self.config.least)


def surface_of(base_color: Tensor, normal: Tensor, depth: Tensor, usable: Tensor | None = None) -> Surface:
    """Return a frame's G-buffers in their ranges.

    Depth is UNKNOWN_DEPTH where one of them is no number, or the sample is not `usable`, (1, 1, h, w) 0 or 1.
    """
    depth = usable_depth(depth)
    known = torch.cat([base_color, normal], dim=1).abs() <= MAX_HALF
    good = [known[:, i : i + 1] for i in range(6)] + ([] if usable is None else [usable > 0.0])
    depth = torch.where(reduce(torch.logical_and, good), depth, torch.full_like(depth, UNKNOWN_DEPTH))
    return Surface(finite(base_color).clamp(0.0, 1.0), finite(normal).clamp(-1.0, 1.0), depth)


def back_to_shaded(motion: Tensor, jitter: Tensor, before: Tensor, jitter_before: Tensor) -> Tensor:
    """(1, 2, h, w) motion of this frame and, from where that leads, of the frame before to the shaded one.

    Args:
        motion: (1, 2, h, w) of this frame, its own pixels.
        jitter: (1, 2) of this frame.
        before: (1, 2, h'', w'') of the frame before back to the last shaded one, that frame's pixels; zeros
            where it was that.
        jitter_before: (1, 2) of the frame before.
    """
    motion = usable_motion(motion)
    render, previous = render_size_of(motion), render_size_of(before)
    further = read(usable_motion(before), *samples_at(motion, jitter, previous, jitter_before))
    across = further[:, :1] * render.width / previous.width
    down = further[:, 1:] * render.height / previous.height
    return (motion + torch.cat([across, down], dim=1)).clamp(-FAR, FAR)


def samples_at(motion: Tensor, jitter: Tensor, then: Size, jitter_then: Tensor) -> tuple[Tensor, Tensor]:
    """Where motion leads, (1, 1, h, w) each, in another frame; 0 is the place of its first sample.

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


def numbers_of_least(values: Sequence[Tensor], count: int) -> list[Tensor]:
    """Return which of some values, (n) each and >= 0, are the least: `count` of (n) int64.

    Values are compared in steps of 1 / STEPS, from 0 to MOST steps; of equals the first are taken. By
    comparing and exchanging, as TopK is not the same with all providers. What is exchanged is one float that
    holds both, the steps and the number: two operators, where a value and its number would take five.
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
    """(1, c, h, w) as (h w, c): what a pixel has lies together."""
    return planes[0].permute(1, 2, 0).reshape(-1, planes.shape[1])
