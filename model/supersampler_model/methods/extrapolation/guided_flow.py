"""`guided-flow`: `guided-warp` with a learned motion and gain of the light.

The light of the last shaded frame, taken from similar surfaces, stays where it was on them: moving shadows,
reflections and lamps lag behind. A small network compares the light of the last two shaded frames, both
resampled on this frame's surfaces at half size, and infers how the light of the last one moved. Light at full
size is moved accordingly where surfaces are similar and the network is confident (Wu et al. 2023, section
4.3).
"""

from typing import ClassVar, NamedTuple

import torch
from torch import Tensor

from supersampler.methods.extrapolation.spec import (
    GUIDED_FLOW,
    GuidedFlowConfig,
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
    LIGHT,
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

TONED = 1.0 - 1e-4  # maximum of a toned colour


class FlowHistory(NamedTuple):
    """The history tensors, grouped; both shaded frames are sanitized."""

    last: Shaded
    earlier: Shaded
    motion: Tensor  # (1, 2, h'', w'') from the previous frame back to the last shaded one
    motion_jitter: Tensor  # (1, 2)
    shaded_motion: Tensor  # (1, 2, h', w') of the last shaded frame
    between: Tensor  # (1, 2, ., .) from the frame before that back to the earlier shaded one
    between_jitter: Tensor  # (1, 2)


class Lights(NamedTuple):
    """The network inputs."""

    later: Tensor  # (1, LIGHT, h / 2, w / 2) light of the last shaded frame, toned, and roughness
    earlier: Tensor  # the same of the one before


class Gathered(NamedTuple):
    """Results of the gather stage."""

    surface: Surface
    light: Tensor  # (1, 3, h, w) guided light of the last shaded frame
    lights: Lights
    motion: Tensor  # (1, 2, h, w) back to the last shaded frame


class GuidedFlow(LearnedMethod):
    """Light each pixel like similar surfaces, then extrapolate the motion of light.

    Untrained it computes the images of `guided-warp`. It takes no step on shaded frames, see `after_shaded`;
    the first shaded frame is also the earlier one, so that no light has moved.
    """

    spec: ClassVar = GUIDED_FLOW
    config: GuidedFlowConfig
    net: FlowNetwork

    def make_network(self) -> FlowNetwork:
        """Return FRNet."""
        return FlowNetwork(self.config.network)

    def fused(self) -> Fused | None:
        """All of FRNet; tensor names are those of released graphs."""
        inputs = dict.fromkeys(("later", "earlier"), (1, LIGHT, *HALF))
        return Fused(self.net, inputs, {"flow": (1, FLOW + GAIN + SHARE, *HALF)}, ratio=1)

    def forward(
        self,
        depth: Tensor,  # (1, 1, h, w) reversed
        motion: Tensor,  # (1, 2, h, w) render pixels, previous minus current
        jitter: Tensor,  # (1, 2) render pixels
        gbuffer_base_color: Tensor,  # (1, 3, h, w)
        gbuffer_normal: Tensor,  # (1, 3, h, w)
        gbuffer_roughness: Tensor,  # (1, 1, h, w)
        *history: Tensor,  # as in `GuidedFlow.history`
    ) -> tuple[Tensor, ...]:
        """Return the image (1, 3, h, w), linear RGB >= 0, and the next history."""
        grouped = flow_history(*history)
        now = surface_of(gbuffer_base_color, gbuffer_normal, depth)
        gathered = self.gather(now, gbuffer_roughness, motion, jitter, grouped)
        (flow,) = self.net(*gathered.lights)
        image = self.finish(gathered, flow)
        return (image, *self.next_history(gathered.motion, jitter, grouped))

    def gather(
        self, now: Surface, roughness: Tensor, motion: Tensor, jitter: Tensor, history: FlowHistory
    ) -> Gathered:
        """Compute the guided light of both shaded frames, of the earlier one at half size."""
        c = self.config.warp
        total, total_earlier = motions_of(motion, jitter, history)
        x, y = samples_at(total, jitter, render_size_of(history.last.color), history.last.jitter)
        light = guided_light(now, history.last, x, y, c)
        x, y = samples_at(
            total_earlier, jitter, render_size_of(history.earlier.color), history.earlier.jitter
        )
        few = Surface(*map(halved, now))
        lights = [halved(light), guided_light(few, history.earlier, halved(x), halved(y), c)]
        exposure, _ = measured_exposure(lights[0], torch.ones_like(few.depth))
        rough = halved(finite(roughness).clamp(0.0, 1.0))
        later, earlier = (torch.cat([tone(one * exposure).clamp(max=TONED), rough], dim=1) for one in lights)
        return Gathered(now, light, Lights(later, earlier), total)

    def finish(self, gathered: Gathered, flow: Tensor) -> Tensor:
        """Return the image (1, 3, h, w) from the network's output."""
        surface = gathered.surface
        light = self.refined(gathered.light, self.guides(surface), flow)
        return bounded(light * reflectance(surface, self.config.warp))

    def guides(self, surface: Surface) -> Tensor:
        """(1, 4, h, w) surface features in standard deviations: normal and logarithm of depth."""
        c = self.config
        distance = surface.depth.clamp(min=FARTHEST).log()  # differences of logarithms are relative
        return torch.cat([surface.normal / c.normal_sigma, distance / c.depth_sigma], dim=1)

    def refined(self, light: Tensor, guides: Tensor, flow: Tensor) -> Tensor:
        """Move the light and apply the gain, weighted by the share that the network infers.

        The mask of IFRNet replaces the thresholds of equations 5 and 6.

        Args:
            light: (n, 3, h, w) guided.
            guides: (n, 4, h, w) of the surfaces.
            flow: (n, FLOW + GAIN + SHARE, h / 2, w / 2) from the network.
        """
        c = self.config
        flow = between(flow, render_size_of(light))
        flow, gain, sure = flow[:, :FLOW], flow[:, FLOW : FLOW + GAIN], flow[:, FLOW + GAIN :]
        there = moved(torch.cat([light, guides], dim=1), (2.0 * flow).clamp(-c.max_motion, c.max_motion))
        difference = there[:, 3:] - guides
        alike = (-0.5 * sum_of([difference[:, i : i + 1] ** 2 for i in range(4)])).exp()
        brighter = (gain.clamp(-1.0, 1.0) * (c.max_stops * 0.6931472)).exp()
        refined = (light + alike * (there[:, :3] - light)) * brighter
        return light + sure.sigmoid() * (refined - light)

    def next_history(self, motion: Tensor, jitter: Tensor, history: FlowHistory) -> list[Tensor]:
        """Return the next history, in the order of `history`; `motion` points to the last shaded frame."""
        return [
            *(history.last.color, *history.last.surface, history.last.jitter * 1.0),
            *(motion, jitter * 1.0, usable_motion(history.shaded_motion)),
            *(history.earlier.color, *history.earlier.surface, history.earlier.jitter * 1.0),
            *(usable_motion(history.between), history.between_jitter * 1.0),
        ]


def flow_history(*history: Tensor) -> FlowHistory:
    """Group and sanitize the history tensors, given in the order of `GuidedFlow.history`."""
    color, base_color, normal, depth, jitter, motion, motion_jitter, shaded_motion, *earlier = history
    *frame, between, between_jitter = earlier
    last = shaded_of(color, base_color, normal, depth, jitter)
    return FlowHistory(last, shaded_of(*frame), motion, motion_jitter, shaded_motion, between, between_jitter)


def motions_of(motion: Tensor, jitter: Tensor, history: FlowHistory) -> tuple[Tensor, Tensor]:
    """Motion, (1, 2, h, w) each, back to the last shaded frame and to the earlier one."""
    total = back_to_shaded(motion, jitter, history.motion, history.motion_jitter)
    before = back_to_shaded(
        history.shaded_motion, history.last.jitter, history.between, history.between_jitter
    )
    return total, back_to_shaded(total, jitter, before, history.last.jitter)


def halved(image: Tensor) -> Tensor:
    """Keep the upper left of each 2x2 pixels: (1, c, h, w) -> (1, c, h / 2, w / 2), rounded up.

    Not their mean, which would belong to no surface, and would need the earlier frame's light at full size.
    """
    return image[:, :, ::2, ::2]


def between(image: Tensor, size: Size) -> Tensor:
    """Interpolate linearly between the upper left of each 2x2 pixels: (n, c, h / 2, w / 2) to all pixels."""
    every = torch.zeros((image.shape[0], 1, size.height, size.width), device=image.device)
    x = every + 0.5 * torch.arange(size.width, device=image.device)
    y = every + 0.5 * torch.arange(size.height, device=image.device)[:, None]
    return read(image, x, y)
