"""`guided-flow`: `guided-warp` with a learned motion and gain of the light.

`guided-warp` leaves the light of the last shaded frame where it was on the surfaces, so that moving shadows,
reflections and lamps lag behind. A small network compares the light of the last two shaded frames, both
resampled on this frame's surfaces at half size, and infers how the light moved between them. That flow then
moves the light at full size, where surfaces are similar and the network is confident (Wu et al. 2023, section
4.3).

The network is FRNet of that paper. The paper leaves its layers to a supplement, but takes its loss from
IFRNet (Kong et al. 2022); this network therefore follows the pyramid of IFRNet: one encoder for both images
and, from the coarsest level up, a decoder that refines the flow and passes features on. As both images are of
previous frames, it infers one flow instead of two. Its convolutions are depthwise ones between 1x1 ones.
"""

from typing import ClassVar, NamedTuple

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from supersampler.methods.constants import MAX_TONED
from supersampler.methods.extrapolation import spec as extrapolation
from supersampler.methods.spec import HALF
from supersampler_model import ops
from supersampler_model.methods import guided_warp
from supersampler_model.methods.base import LearnedMethod, NetworkSubgraph
from supersampler_model.methods.classifier_network import Block, padded
from supersampler_model.methods.gbuffer_network import doubled
from supersampler_model.methods.guided_warp import Light, Shaded, Surface

LIGHT = 4  # channels of an input: toned light, roughness
FLOW = 2  # output channels of the flow: offset across, offset down
OUTPUTS = (FLOW, 1, 1)
"""Output channels: flow in pixels of the inputs, gain, logit of the blend weight of the moved light."""
AGE_RATIO = 3.0  # age of the earlier over that of the later input, if every second frame is shaded


class Decoder(nn.Module):
    """Refines the flow at one level, and passes features to the next finer level, of width `above`.

    The finest level has no level above and infers all OUTPUTS; the deepest one receives no features.
    """

    def __init__(self, width: int, above: int | None, *, deepest: bool) -> None:
        super().__init__()
        joined = 2 * width if deepest else 3 * width + FLOW
        self.blocks = nn.Sequential(Block(joined, width), Block(width, width))
        self.flow = nn.Conv2d(width, 4 * (FLOW if above else sum(OUTPUTS)), 1)
        self.features = nn.Conv2d(width, 4 * above, 1) if above else None
        for parameter in self.flow.parameters():
            nn.init.zeros_(parameter)  # zeros: no flow

    def forward(self, joined: Tensor) -> tuple[Tensor, Tensor | None]:
        """Return the flow, or all OUTPUTS at the finest level, and features, both at twice the size."""
        inner = self.blocks(joined)
        outputs = F.pixel_shuffle(self.flow(inner).float(), 2)
        return outputs, None if self.features is None else F.pixel_shuffle(self.features(inner), 2)


class FlowNetwork(nn.Module):
    """Infers where to read each pixel's light in the last shaded frame, its gain and its blend weight."""

    def __init__(self, config: extrapolation.FlowNetworkConfig) -> None:
        super().__init__()
        self.config = config
        widths = config.levels
        inputs = [4 * LIGHT, *widths[:-1]]
        self.encoder = nn.ModuleList(Block(a, b) for a, b in zip(inputs, widths, strict=True))
        finer = [None, *widths[:-1]]
        self.decoder = nn.ModuleList(
            Decoder(width, above, deepest=level + 1 == len(widths))
            for level, (width, above) in enumerate(zip(widths, finer, strict=True))
        )

    def forward(self, later: Tensor, earlier: Tensor) -> tuple[Tensor]:
        """Infer OUTPUTS (n, sum(OUTPUTS), h, w) from the light of two shaded frames, (n, LIGHT, h, w)."""
        n = later.shape[0]
        pyramid = self.features(torch.cat([later, earlier]))  # in one pass
        outputs, features = self.decoder[-1](torch.cat([pyramid[-1][:n], pyramid[-1][n:]], dim=1))
        for both, decoder in zip(reversed(pyramid[:-1]), reversed(self.decoder[:-1]), strict=True):
            flow = outputs
            joined = [features, moved(both[:n], flow), moved(both[n:], AGE_RATIO * flow), flow.to(both.dtype)]
            more, features = decoder(torch.cat(joined, dim=1))
            outputs = torch.cat([2.0 * doubled(flow) + more[:, :FLOW], more[:, FLOW:]], dim=1)
        return (ops.cut_to(outputs, ops.size_of(later)),)

    def features(self, lights: Tensor) -> list[Tensor]:
        """Return features, finest level first, of images padded to whole pixels of the coarsest level."""
        x = F.pixel_unshuffle(padded(lights, 2 ** len(self.config.levels)), 2)
        pyramid: list[Tensor] = []
        for block in self.encoder:
            x = block(F.max_pool2d(x, 2) if pyramid else x)
            pyramid.append(x)
        return pyramid


def moved(image: Tensor, flow: Tensor) -> Tensor:
    """Read an image (n, c, h, w) bilinearly at an offset `flow`, (n, 2, h, w) pixels, clamped at the border.

    Positions are float32 even if images are half floats, which cannot represent positions beyond 2048.
    """
    x = torch.arange(image.shape[3], device=image.device) + flow[:, :1]
    y = torch.arange(image.shape[2], device=image.device)[:, None] + flow[:, 1:]
    return ops.read(image.float(), ops.positions_of(x, y)).to(image.dtype)


class FlowHistory(NamedTuple):
    """The history tensors, grouped; both shaded frames are sanitized."""

    last: Shaded
    earlier: Shaded  # the shaded frame before the last one
    motion: Tensor  # (1, 2, h'', w'') from the previous frame to the last shaded one
    motion_jitter: Tensor  # (1, 2) of the previous frame
    shaded_motion: Tensor  # (1, 2, h', w') from the last shaded frame to the frame before it
    between: Tensor  # (1, 2, ., .) from that frame to the earlier shaded one
    between_jitter: Tensor  # (1, 2) of that frame


class Lights(NamedTuple):
    """The network inputs."""

    later: Tensor  # (1, LIGHT, h / 2, w / 2) toned light of the last shaded frame, and roughness
    earlier: Tensor  # (1, LIGHT, h / 2, w / 2) of the earlier shaded frame


class Gathered(NamedTuple):
    """Results of the gather stage."""

    surface: Surface
    light: Light  # guided light of the last shaded frame
    lights: Lights
    motion: Tensor  # (1, 2, h, w) to the last shaded frame


class GuidedFlow(LearnedMethod):
    """Light each pixel like similar surfaces, then extrapolate the motion of light.

    Untrained, it computes the images of `guided-warp`. It does not step on shaded frames, see `after_shaded`.
    After a reset, the first shaded frame serves as both shaded frames of the history: no light has moved.
    """

    spec: ClassVar = extrapolation.GUIDED_FLOW
    config: extrapolation.GuidedFlowConfig
    net: FlowNetwork

    def make_network(self) -> FlowNetwork:
        """Return FRNet."""
        return FlowNetwork(self.config.network)

    def subgraph(self) -> NetworkSubgraph | None:
        """Return FRNet, with the tensor names of released graphs."""
        inputs = dict.fromkeys(("later", "earlier"), (1, LIGHT, *HALF))
        return NetworkSubgraph(self.net, inputs, {"flow": (1, sum(OUTPUTS), *HALF)}, ratio=1)

    def compute(
        self,
        depth: Tensor,  # (1, 1, h, w) reversed
        motion: Tensor,  # (1, 2, h, w) render pixels, previous minus current
        jitter: Tensor,  # (1, 2) render pixels
        gbuffer_base_color: Tensor,  # (1, 3, h, w)
        gbuffer_normal: Tensor,  # (1, 3, h, w)
        gbuffer_roughness: Tensor,  # (1, 1, h, w)
        *history: Tensor,  # as in `GuidedFlow.history`
    ) -> tuple[Tensor, ...]:
        """Return the image (1, 3, h, w), linear RGB >= 0 or NaN, and the next history."""
        grouped = flow_history(*history)
        surface = guided_warp.surface_of(gbuffer_base_color, gbuffer_normal, depth)
        gathered = self.gather(surface, gbuffer_roughness, motion, jitter, grouped)
        (flow,) = self.net(*gathered.lights)
        image = self.finish(gathered, flow)
        return (image, *self.next_history(gathered.motion, jitter, grouped))

    def gather(
        self, surface: Surface, roughness: Tensor, motion: Tensor, jitter: Tensor, history: FlowHistory
    ) -> Gathered:
        """Compute the guided light of the last shaded frame, and of the earlier one at half size."""
        c, last, earlier = self.config.warp, history.last, history.earlier
        to_last, to_earlier = motions_of(motion, jitter, history)
        x, y = guided_warp.samples_at(to_last, jitter, ops.size_of(last.color), last.jitter)
        light = guided_warp.guided_light(surface, last, x, y, c)
        x, y = guided_warp.samples_at(to_earlier, jitter, ops.size_of(earlier.color), earlier.jitter)
        half_surface = Surface(*map(halved, surface))
        earlier_light = guided_warp.guided_light(half_surface, earlier, halved(x), halved(y), c).color
        lights = [halved(light.color), earlier_light]
        exposure, _ = ops.measured_exposure(lights[0], torch.ones_like(half_surface.depth))
        rough = halved(ops.finite(roughness).clamp(0.0, 1.0))
        toned = (ops.tone(half * exposure).clamp(max=MAX_TONED) for half in lights)
        return Gathered(surface, light, Lights(*(torch.cat([t, rough], dim=1) for t in toned)), to_last)

    def finish(self, gathered: Gathered, flow: Tensor) -> Tensor:
        """Return the image (1, 3, h, w) from the network's output."""
        surface = gathered.surface
        light, known = gathered.light
        guides = torch.where(known, self.guides(surface), extrapolation.INVALID_DEPTH)  # similar to no other
        light = self.refined(light, guides, flow)
        image = ops.bounded(light * guided_warp.reflectance(surface, self.config.warp))
        return torch.where(known, image, guided_warp.MISSING)

    def guides(self, surface: Surface) -> Tensor:
        """Return surface features (1, 4, h, w) in standard deviations: normal and logarithm of depth."""
        c = self.config
        log_depth = surface.depth.clamp(min=extrapolation.SKY_DEPTH).log()  # its differences are relative
        return torch.cat([surface.normal / c.normal_sigma, log_depth / c.depth_sigma], dim=1)

    def refined(self, light: Tensor, guides: Tensor, flow: Tensor) -> Tensor:
        """Move the light by the inferred flow, multiply it by the gain, and blend by the inferred weight.

        The blend weight, as in IFRNet, replaces the thresholds of equations 5 and 6.

        Args:
            light: (n, 3, h, w) guided light.
            guides: (n, 4, h, w) see `guides`.
            flow: (n, sum(OUTPUTS), h / 2, w / 2) from the network.
        """
        c = self.config
        flow, gain, logit = doubled_linear(flow, ops.size_of(light)).split_with_sizes(OUTPUTS, dim=1)
        source = moved(torch.cat([light, guides], dim=1), (2.0 * flow).clamp(-c.max_motion, c.max_motion))
        difference = source[:, 3:] - guides
        similarity = (-0.5 * ops.sum_of([difference[:, i : i + 1] ** 2 for i in range(4)])).exp()
        factor = (gain.clamp(-1.0, 1.0) * (c.max_stops * 0.6931472)).exp()
        refined = (light + similarity * (source[:, :3] - light)) * factor
        return light + logit.sigmoid() * (refined - light)

    def next_history(self, motion: Tensor, jitter: Tensor, history: FlowHistory) -> list[Tensor]:
        """Return the next history, in the order of `history`; `motion` points to the last shaded frame."""
        return [
            *(history.last.next_color(), *history.last.surface, history.last.jitter * 1.0),
            *(motion, jitter * 1.0, ops.usable_motion(history.shaded_motion)),
            *(history.earlier.next_color(), *history.earlier.surface, history.earlier.jitter * 1.0),
            *(ops.usable_motion(history.between), history.between_jitter * 1.0),
        ]


def flow_history(*history: Tensor) -> FlowHistory:
    """Group and sanitize the history tensors, given in the order of `GuidedFlow.history`."""
    color, base_color, normal, depth, jitter, motion, motion_jitter, shaded_motion, *earlier = history
    *frame, between, between_jitter = earlier
    last = guided_warp.shaded_of(color, base_color, normal, depth, jitter)
    before = guided_warp.shaded_of(*frame)
    return FlowHistory(last, before, motion, motion_jitter, shaded_motion, between, between_jitter)


def motions_of(motion: Tensor, jitter: Tensor, history: FlowHistory) -> tuple[Tensor, Tensor]:
    """Return the motion, (1, 2, h, w) each, to the last shaded frame and to the earlier one."""
    last_jitter = history.last.jitter
    to_last = guided_warp.back_to_shaded(motion, jitter, history.motion, history.motion_jitter)
    last_to_earlier = guided_warp.back_to_shaded(
        history.shaded_motion, last_jitter, history.between, history.between_jitter
    )
    return to_last, guided_warp.back_to_shaded(to_last, jitter, last_to_earlier, last_jitter)


def halved(image: Tensor) -> Tensor:
    """Keep the upper left of each 2x2 pixels: (1, c, h, w) -> (1, c, h / 2, w / 2), rounded up.

    A mean over several surfaces would be the light of none of them.
    """
    return image[:, :, ::2, ::2]


def doubled_linear(image: Tensor, size: ops.Size) -> Tensor:
    """Upsample bilinearly, as the inverse of `halved`: (n, c, h / 2, w / 2) -> (n, c, h, w)."""
    zeros = torch.zeros((image.shape[0], 1, size.height, size.width), device=image.device)
    x = zeros + 0.5 * torch.arange(size.width, device=image.device)
    y = zeros + 0.5 * torch.arange(size.height, device=image.device)[:, None]
    return ops.read(image, ops.positions_of(x, y))
