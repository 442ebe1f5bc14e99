"""`guided-flow`: `guided-warp`, whose light is then moved and brightened where it did so by itself.

Light that is taken from like surfaces of the last shaded frame is where it was on them: shadows, reflections
and the light of lamps that move are left behind. A small network compares the light of the last two shaded
frames, both brought to this frame's surfaces, at half size, and says how that of the last one is to be moved.
Light of full size follows, as far as surfaces are alike and the network is sure (Wu et al. 2023, section
4.3).
"""

from collections.abc import Mapping
from typing import Any, ClassVar, NamedTuple, Self

import torch
from torch import Tensor

from supersampler.methods.extrapolation.spec import (
    GUIDED_FLOW,
    FlowNetworkConfig,
    GuidedFlowConfig,
    GuidedWarpConfig,
)
from supersampler.methods.spec import HALF
from supersampler_model.methods.base import (
    Fused,
    Size,
    render_size_of,
)
from supersampler_model.methods.extrapolation.flow_network import (
    FLOW,
    GAIN,
    PICTURE,
    SHARE,
    FlowNetwork,
    moved,
)
from supersampler_model.methods.extrapolation.guided import (
    FARTHEST,
    Shaded,
    Surface,
    back_to_shaded,
    guided_light,
    reflectance,
    samples_at,
    shaded_of,
    surface_of,
)
from supersampler_model.methods.learned import LearnedMethod
from supersampler_model.ops.color import bounded, finite, measured_exposure, tone
from supersampler_model.ops.motion import read, usable_motion
from supersampler_model.ops.sampling import sum_of

TONED = 1.0 - 1e-4  # most of a toned colour


class Past(NamedTuple):
    """The history, told apart; each of the two frames as light is taken from it."""

    last: Shaded
    earlier: Shaded
    motion: Tensor  # (1, 2, h'', w'') from the frame before back to the last shaded one
    motion_jitter: Tensor  # (1, 2)
    shaded_motion: Tensor  # (1, 2, h', w') of the last shaded frame
    between: Tensor  # (1, 2, ., .) from the frame before that back to the earlier shaded one
    between_jitter: Tensor  # (1, 2)


class Pictures(NamedTuple):
    """What the network sees of a frame."""

    later: Tensor  # (1, PICTURE, h / 2, w / 2) light of the last shaded frame, toned, and roughness
    earlier: Tensor  # the same of the one before


class Gathered(NamedTuple):
    """What is known of a frame before the network speaks."""

    surface: Surface
    light: Tensor  # (1, 3, h, w) guided, of the last shaded frame
    pictures: Pictures
    motion: Tensor  # (1, 2, h, w) back to the last shaded frame


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

    spec: ClassVar = GUIDED_FLOW

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
        return Fused(self.net, inputs, {"said": (1, FLOW + GAIN + SHARE, *HALF)}, ratio=1)

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
        image = self.finish(gathered, said)
        return Step(image, *self.left(gathered.motion, jitter, past))

    def gather(self, now: Surface, roughness: Tensor, motion: Tensor, jitter: Tensor, past: Past) -> Gathered:
        """Bring the light of both shaded frames to this frame's surfaces, of the earlier one at half size."""
        c = self.config.warp
        total, long_ago = motions_of(motion, jitter, past)
        x, y = samples_at(total, jitter, render_size_of(past.last.color), past.last.jitter)
        light = guided_light(now, past.last, x, y, c)
        x, y = samples_at(long_ago, jitter, render_size_of(past.earlier.color), past.earlier.jitter)
        few = Surface(*map(halved, now))
        lights = [halved(light), guided_light(few, past.earlier, halved(x), halved(y), c)]
        exposure, _ = measured_exposure(lights[0], torch.ones_like(few.depth))
        rough = halved(finite(roughness).clamp(0.0, 1.0))
        later, earlier = (torch.cat([tone(one * exposure).clamp(max=TONED), rough], dim=1) for one in lights)
        return Gathered(now, light, Pictures(later, earlier), total)

    def finish(self, gathered: Gathered, said: Tensor) -> Tensor:
        """(1, 3, h, w) the picture, of what the network says."""
        surface = gathered.surface
        light = self.refined(gathered.light, self.guides(surface), said)
        return bounded(light * reflectance(surface, self.config.warp))

    def guides(self, surface: Surface) -> Tensor:
        """(1, 4, h, w) what tells surfaces apart over which light moves: normal and depth, in deviations."""
        c = self.config
        distance = surface.depth.clamp(min=FARTHEST).log()  # whose differences are shares
        return torch.cat([surface.normal / c.turned, distance / c.apart], dim=1)

    def refined(self, light: Tensor, guides: Tensor, said: Tensor) -> Tensor:
        """Light that is moved and made brighter or darker, where the network is sure of it.

        The mask of IFRNet, which the network says, is in the place of the thresholds of equations 5 and 6.

        Args:
            light: (n, 3, h, w) guided.
            guides: (n, 4, h, w) of the surfaces.
            said: (n, FLOW + GAIN + SHARE, h / 2, w / 2) by the network.
        """
        c = self.config
        said = between(said, render_size_of(light))
        flow, gain, sure = said[:, :FLOW], said[:, FLOW : FLOW + GAIN], said[:, FLOW + GAIN :]
        there = moved(torch.cat([light, guides], dim=1), (2.0 * flow).clamp(-c.farthest, c.farthest))
        off = there[:, 3:] - guides
        alike = (-0.5 * sum_of([off[:, i : i + 1] ** 2 for i in range(4)])).exp()
        brighter = (gain.clamp(-1.0, 1.0) * (c.stops * 0.6931472)).exp()
        refined = (light + alike * (there[:, :3] - light)) * brighter
        return light + sure.sigmoid() * (refined - light)

    def left(self, motion: Tensor, jitter: Tensor, past: Past) -> list[Tensor]:
        """What is left to the next frame, in the order of `history`; `motion` goes to the last shaded one."""
        return [
            *(past.last.color, *past.last.surface, past.last.jitter * 1.0),
            *(motion, jitter * 1.0, usable_motion(past.shaded_motion)),
            *(past.earlier.color, *past.earlier.surface, past.earlier.jitter * 1.0),
            *(usable_motion(past.between), past.between_jitter * 1.0),
        ]


def past_of(*history: Tensor) -> Past:
    """Return the history, in the order of `GuidedFlow.history`, told apart."""
    color, base_color, normal, depth, jitter, motion, motion_jitter, shaded_motion, *earlier = history
    *frame, between, between_jitter = earlier
    last = shaded_of(color, base_color, normal, depth, jitter)
    return Past(last, shaded_of(*frame), motion, motion_jitter, shaded_motion, between, between_jitter)


def motions_of(motion: Tensor, jitter: Tensor, past: Past) -> tuple[Tensor, Tensor]:
    """(1, 2, h, w) each: back to the last shaded frame, and to the earlier one."""
    total = back_to_shaded(motion, jitter, past.motion, past.motion_jitter)
    before = back_to_shaded(past.shaded_motion, past.last.jitter, past.between, past.between_jitter)
    return total, back_to_shaded(total, jitter, before, past.last.jitter)


def halved(image: Tensor) -> Tensor:
    """The upper left of each four pixels: (1, c, h, w) -> (1, c, h / 2, w / 2), rounded up.

    One of the four as it is, not their mean, which would be of no surface, and for which the earlier frame's
    light would have to be found for all.
    """
    return image[:, :, ::2, ::2]


def between(image: Tensor, size: Size) -> Tensor:
    """What the upper left of each four pixels has, (n, c, h / 2, w / 2), between these, too: linear."""
    every = torch.zeros((image.shape[0], 1, size.height, size.width), device=image.device)
    x = every + 0.5 * torch.arange(size.width, device=image.device)
    y = every + 0.5 * torch.arange(size.height, device=image.device)[:, None]
    return read(image, x, y)
