"""`guided-flow`: `guided-warp`, whose light is then moved and brightened where it did so by itself.

Light that is taken from like surfaces of the last shaded frame is where it was on them: shadows, reflections
and the light of lamps that move are left behind. A small network compares the light of the last two shaded
frames, both brought to this frame's surfaces, at half size, and says how that of the last one is to be moved.
Only where that changes it, and on surfaces alike, it takes the place of the light of full size
(Wu et al. 2023, section 4.3).
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, ClassVar, NamedTuple, Self

import torch
from torch import Tensor

from supersampler_model.color import bounded, exposure_for, finite, inverse_tone, tone
from supersampler_model.method import BETWEEN, EARLIER, HALF, PREVIOUS, RENDER, SHADED, Fused, render_size_of
from supersampler_model.methods.guided import (
    GuidedWarpConfig,
    Shaded,
    Surface,
    back_to_shaded,
    guided_light,
    light_of,
    reflectance,
    samples_at,
    shaded_of,
    surface_of,
)
from supersampler_model.methods.learned import LearnedMethod
from supersampler_model.motion import usable_motion
from supersampler_model.networks.flow import FLOW, GAIN, PICTURE, FlowNetwork, FlowNetworkConfig, moved
from supersampler_model.networks.gbuffer import doubled
from supersampler_model.sampling import sum_of

TONED = 1.0 - 1e-4  # most of a toned colour
DARK = 1e-3  # toned light whose differences count in full


@dataclass(frozen=True)
class GuidedFlowConfig:
    """Constants; docs/methods.md has where they come from.

    Attributes:
        network: its widths.
        warp: see there.
        farthest: that light is moved, pixels of half the render size.
        stops: that it is made brighter or darker at most; 0 leaves it to the flow alone.
        alike: likeness of two surfaces from which one is lit as the other (delta 1 of equation 6).
        changed: relative change of light from which it counts (delta 2).
        ramp: half the width of either threshold, as a share of it.
    """

    network: FlowNetworkConfig = field(default_factory=FlowNetworkConfig)
    warp: GuidedWarpConfig = field(default_factory=GuidedWarpConfig)
    farthest: float = 32.0
    stops: float = 2.0
    alike: float = 0.1
    changed: float = 0.1
    ramp: float = 0.5


class Past(NamedTuple):
    """The history, told apart; each of the two frames as light is taken from it."""

    last: Shaded
    earlier: Shaded
    motion: Tensor  # (1, 2, h'', w'') from the frame before back to the last shaded one
    motion_jitter: Tensor  # (1, 2)
    shaded_motion: Tensor  # (1, 2, h', w') of the last shaded frame
    between: Tensor  # (1, 2, ., .) from the frame before that back to the earlier shaded one
    between_jitter: Tensor  # (1, 2)


class Gathered(NamedTuple):
    """What is known of a frame before the network speaks."""

    surface: Surface
    light: Tensor  # (1, 3, h, w) guided, of the last shaded frame
    pictures: tuple[Tensor, Tensor]  # (1, PICTURE, h / 2, w / 2) later and earlier
    exposure: Tensor  # (1,) of the toned light in them
    motion: Tensor  # (1, 2, h, w) back to the last shaded frame


class Finished(NamedTuple):
    """What is made of it."""

    image: Tensor  # (1, 3, h, w) linear RGB
    light: Tensor  # (1, 3, h / 2, w / 2) toned, of the network alone


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
    history_shaded_motion: Tensor
    history_earlier_color: Tensor
    history_earlier_base_color: Tensor
    history_earlier_normal: Tensor
    history_earlier_depth: Tensor
    history_earlier_jitter: Tensor
    history_earlier_motion: Tensor
    history_earlier_motion_jitter: Tensor


class GuidedFlow(LearnedMethod):
    """Light each pixel as like surfaces were lit, then move light as it has moved before.

    Untrained it draws what `guided-warp` draws. A shaded frame takes no step, see `after_shaded`; after the
    first, which is its own earlier one, no light has moved.
    """

    name, source = "guided-flow", "Wu et al. 2023 (ExtraSS), section 4.3 (docs/methods.md)"
    history: ClassVar = {
        "color": (1, 3, *SHADED),  # of the last shaded frame, as the next four
        "base_color": (1, 3, *SHADED),
        "normal": (1, 3, *SHADED),
        "depth": (1, 1, *SHADED),
        "jitter": (1, 2),
        "motion": (1, 2, *PREVIOUS),  # from the frame before back to the shaded one, its own pixels
        "motion_jitter": (1, 2),  # of the frame before
        "shaded_motion": (1, 2, *SHADED),  # of the last shaded frame
        "earlier_color": (1, 3, *EARLIER),  # of the one that was shaded before it, as the next four
        "earlier_base_color": (1, 3, *EARLIER),
        "earlier_normal": (1, 3, *EARLIER),
        "earlier_depth": (1, 1, *EARLIER),
        "earlier_jitter": (1, 2),
        "earlier_motion": (1, 2, *BETWEEN),  # from the frame before the last shaded one back to that
        "earlier_motion_jitter": (1, 2),  # of the frame before the last shaded one
    }
    image: ClassVar = (1, 3, *RENDER)
    ratios: ClassVar = (1.0, 1.0)

    def __init__(self, config: GuidedFlowConfig | None = None) -> None:
        super().__init__()
        self.config = config or GuidedFlowConfig()
        self.net = FlowNetwork(self.config.network)

    @classmethod
    def configured(cls, config: Mapping[str, Any]) -> Self:
        """See `LearnedMethod`."""
        settings = dict(config)
        network = FlowNetworkConfig(tuple(settings.pop("network")["levels"]))
        warp = dict(settings.pop("warp"))
        warp["strides"] = tuple(warp["strides"])
        return cls(GuidedFlowConfig(network=network, warp=GuidedWarpConfig(**warp), **settings))

    def fused(self) -> Fused | None:
        """All of FRNet."""
        inputs = dict.fromkeys(("later", "earlier"), (1, PICTURE, *HALF))
        return Fused(self.net, inputs, {"said": (1, FLOW + GAIN, *HALF)}, ratio=1)

    def forward(
        self,
        depth: Tensor,  # (1, 1, h, w) reversed
        motion: Tensor,  # (1, 2, h, w) render pixels, previous minus current
        jitter: Tensor,  # (1, 2) render pixels
        gbuffer_base_color: Tensor,  # (1, 3, h, w)
        gbuffer_normal: Tensor,  # (1, 3, h, w)
        gbuffer_roughness: Tensor,  # (1, 1, h, w)
        history_color: Tensor,  # (1, 3, h', w') linear RGB
        history_base_color: Tensor,  # (1, 3, h', w')
        history_normal: Tensor,  # (1, 3, h', w')
        history_depth: Tensor,  # (1, 1, h', w')
        history_jitter: Tensor,  # (1, 2)
        history_motion: Tensor,  # (1, 2, h'', w'')
        history_motion_jitter: Tensor,  # (1, 2)
        history_shaded_motion: Tensor,  # (1, 2, h', w')
        history_earlier_color: Tensor,  # (1, 3, ., .) linear RGB
        history_earlier_base_color: Tensor,
        history_earlier_normal: Tensor,
        history_earlier_depth: Tensor,
        history_earlier_jitter: Tensor,  # (1, 2)
        history_earlier_motion: Tensor,
        history_earlier_motion_jitter: Tensor,  # (1, 2)
    ) -> Step:
        """Return the image (1, 3, h, w), linear RGB >= 0, and the history."""
        past = past_of(
            history_color,
            history_base_color,
            history_normal,
            history_depth,
            history_jitter,
            history_motion,
            history_motion_jitter,
            history_shaded_motion,
            history_earlier_color,
            history_earlier_base_color,
            history_earlier_normal,
            history_earlier_depth,
            history_earlier_jitter,
            history_earlier_motion,
            history_earlier_motion_jitter,
        )
        now = surface_of(gbuffer_base_color, gbuffer_normal, depth)
        gathered = self.gather(now, gbuffer_roughness, motion, jitter, past)
        (said,) = self.net(*gathered.pictures)
        image = self.finish(gathered, said).image
        return Step(image, *self.left(gathered, jitter, past))

    def gather(self, now: Surface, roughness: Tensor, motion: Tensor, jitter: Tensor, past: Past) -> Gathered:
        """Bring the light of both shaded frames to this frame's surfaces, of the earlier one at half size."""
        c = self.config.warp
        total, long_ago = motions_of(motion, jitter, past)
        x, y = samples_at(total, jitter, render_size_of(past.last.color), past.last.jitter)
        light = guided_light(now, past.last, x, y, c)
        x, y = samples_at(long_ago, jitter, render_size_of(past.earlier.color), past.earlier.jitter)
        few = Surface(*map(halved, now))
        lights = [halved(light), guided_light(few, past.earlier, halved(x), halved(y), c)]
        nothing = torch.zeros_like(light[0, 0, 0, :1])
        exposure = exposure_for(lights[0], torch.ones_like(few.depth), nothing, nothing)
        rough = halved(finite(roughness).clamp(0.0, 1.0))
        later, earlier = (torch.cat([self.shown(one, exposure), rough], dim=1) for one in lights)
        return Gathered(now, light, (later, earlier), exposure, total)

    def shown(self, light: Tensor, exposure: Tensor) -> Tensor:
        """Toned light, as the network sees it."""
        return tone(light * exposure).clamp(max=TONED)

    def finish(self, gathered: Gathered, said: Tensor) -> Finished:
        """Move the light and make it brighter or darker; take it where that matters (equations 5 and 6)."""
        c, surface = self.config, gathered.surface
        stays = gathered.pictures[0][:, :3]
        flow = said[:, :FLOW].clamp(-c.farthest, c.farthest)
        gain = (said[:, FLOW:].clamp(-1.0, 1.0) * (c.stops * 0.6931472)).exp()
        refined = inverse_tone(moved(stays, flow)) * gain
        toned = tone(refined)
        changed = self.passes(length(toned - stays) / length(toned).clamp(min=DARK), c.changed)
        size = render_size_of(surface.depth)
        few = [halved(part) for part in (surface.base_color, surface.normal)]
        near, facing, light, counts = (
            doubled(part)[:, :, : size.height, : size.width]
            for part in (*few, refined / gathered.exposure, changed)
        )
        apart = length(near - surface.base_color) / 3.0**0.5
        along = channel_sum(facing * surface.normal)
        share = counts * self.passes((1.0 - apart) * along, c.alike)
        mixed = gathered.light + share * (light - gathered.light)
        return Finished(bounded(mixed * reflectance(surface, c.warp)), toned)

    def passes(self, value: Tensor, threshold: float) -> Tensor:
        """0 below a threshold, 1 above, with a ramp between, for gradients to pass."""
        width = 2.0 * self.config.ramp * threshold
        return ((value - threshold) / width + 0.5).clamp(0.0, 1.0)

    def left(self, gathered: Gathered, jitter: Tensor, past: Past) -> list[Tensor]:
        """Return what is left to the next frame, in the order of `history`."""
        return [
            *(past.last.color, *past.last.surface, past.last.jitter * 1.0),
            *(gathered.motion, jitter * 1.0, usable_motion(past.shaded_motion)),
            *(past.earlier.color, *past.earlier.surface, past.earlier.jitter * 1.0),
            *(usable_motion(past.between), past.between_jitter * 1.0),
        ]

    def true_light(self, color: Tensor, gathered: Gathered) -> Tensor:
        """(1, 3, h / 2, w / 2) toned light that the network should have made, of a frame's own colour."""
        light = light_of(color, gathered.surface, self.config.warp)
        return self.shown(halved(light), gathered.exposure)


def past_of(*history: Tensor) -> Past:
    """Return the history, in the order of `GuidedFlow.history`, told apart."""
    color, base_color, normal, depth, jitter, motion, motion_jitter, shaded_motion, *earlier = history
    *frame, between, between_jitter = earlier
    last = shaded_of(color, base_color, normal, depth, jitter)
    return Past(last, shaded_of(*frame), motion, motion_jitter, shaded_motion, between, between_jitter)


def motions_of(motion: Tensor, jitter: Tensor, past: Past) -> tuple[Tensor, Tensor]:
    """(1, 2, h, w) each: where this frame's pixels were in the last shaded frame, and in the earlier one."""
    total = back_to_shaded(motion, jitter, past.motion, past.motion_jitter)
    before = back_to_shaded(past.shaded_motion, past.last.jitter, past.between, past.between_jitter)
    return total, back_to_shaded(total, jitter, before, past.last.jitter)


def halved(image: Tensor) -> Tensor:
    """The upper left of each four pixels: (1, c, h, w) -> (1, c, h / 2, w / 2), rounded up.

    One of the four as it is, not their mean, which would be of no surface, and for which the earlier frame's
    light would have to be found for all.
    """
    return image[:, :, ::2, ::2]


def length(vector: Tensor) -> Tensor:
    """(n, 3, h, w) -> (n, 1, h, w); its gradient is finite at 0."""
    return (channel_sum(vector * vector) + 1e-12).sqrt()


def channel_sum(image: Tensor) -> Tensor:
    """(n, 3, h, w) -> (n, 1, h, w)."""
    return sum_of([image[:, i : i + 1] for i in range(3)])
