"""FRNet, the flow network of Wu et al. 2023 (ExtraSS, section 4.3), on tensors of half the render size.

The paper leaves its layers to a supplement; its loss is that of IFRNet (Kong et al. 2022), whose pyramid this
network follows: one encoder for both images and, from the coarsest level up, a decoder that refines the flow
and passes features on. It infers one flow instead of two, as both images are of previous frames, and uses
depthwise convolutions between 1x1 ones.
"""

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from supersampler.methods.extrapolation.spec import FlowNetworkConfig
from supersampler_model.methods.classifier.network import Block, cut_to, padded
from supersampler_model.methods.gbuffer.network import doubled
from supersampler_model.ops.motion import read

LIGHT = 4  # channels of an input: toned light, roughness
FLOW, GAIN, SHARE = 2, 1, 1  # output channels per pixel
AGO = 3.0  # age of the earlier input over that of the later one, where every second frame is shaded


class Decoder(nn.Module):
    """One level: refines the flow and passes features to the next finer level.

    Args:
        width: of the level's features.
        above: width of the next finer level; None at the finest, which infers gain and share instead.
        deepest: whether this is the coarsest level, without features from another.
    """

    def __init__(self, width: int, above: int | None, *, deepest: bool) -> None:
        super().__init__()
        joined = 2 * width if deepest else 3 * width + FLOW
        self.blocks = nn.Sequential(Block(joined, width), Block(width, width))
        self.flow = nn.Conv2d(width, 4 * (FLOW if above else FLOW + GAIN + SHARE), 1)
        self.features = nn.Conv2d(width, 4 * above, 1) if above else None
        for parameter in self.flow.parameters():
            nn.init.zeros_(parameter)  # zeros: no flow

    def forward(self, joined: Tensor) -> tuple[Tensor, Tensor | None]:
        """(n, c, h, w) to flow (and gain and share) in pixels, and features, both at twice the size."""
        inner = self.blocks(joined)
        flow_gain_share = F.pixel_shuffle(self.flow(inner).float(), 2)
        return flow_gain_share, None if self.features is None else F.pixel_shuffle(self.features(inner), 2)


class FlowNetwork(nn.Module):
    """Infers where the light of each pixel is to be read in the last shaded frame, and its gain."""

    def __init__(self, config: FlowNetworkConfig) -> None:
        super().__init__()
        self.config = config
        widths = config.levels
        inputs = [4 * LIGHT, *widths[:-1]]
        self.encoder = nn.ModuleList(Block(a, b) for a, b in zip(inputs, widths, strict=True))
        aboves = [None, *widths[:-1]]
        self.decoder = nn.ModuleList(
            Decoder(width, above, deepest=level + 1 == len(widths))
            for level, (width, above) in enumerate(zip(widths, aboves, strict=True))
        )

    def forward(self, later: Tensor, earlier: Tensor) -> tuple[Tensor]:
        """Infer the flow from the light of two shaded frames, (n, LIGHT, h, w) in [0, 1].

        Returns:
            (n, FLOW + GAIN + SHARE, h, w): offset to read the later input at, in its pixels; gain; logit of
            the share of the moved light.
        """
        n = later.shape[0]
        pyramid = self.features(torch.cat([later, earlier]))  # in one pass
        flow_gain_share, features = self.decoder[-1](torch.cat([pyramid[-1][:n], pyramid[-1][n:]], dim=1))
        for both, decoder in zip(reversed(pyramid[:-1]), reversed(self.decoder[:-1]), strict=True):
            flow = flow_gain_share
            joined = [features, moved(both[:n], flow), moved(both[n:], AGO * flow), flow.to(both.dtype)]
            more, features = decoder(torch.cat(joined, dim=1))
            flow_gain_share = torch.cat([2.0 * doubled(flow) + more[:, :FLOW], more[:, FLOW:]], dim=1)
        return (cut_to(flow_gain_share, later),)

    def features(self, lights: Tensor) -> list[Tensor]:
        """Features of inputs (n, LIGHT, h, w), finest level first, padded to whole pixels of the coarsest."""
        x = F.pixel_unshuffle(padded(lights, 2 ** len(self.config.levels)), 2)
        pyramid: list[Tensor] = []
        for block in self.encoder:
            x = block(F.max_pool2d(x, 2) if pyramid else x)
            pyramid.append(x)
        return pyramid


def moved(image: Tensor, flow: Tensor) -> Tensor:
    """Sample an image (n, c, h, w) at `flow` (n, 2, h, w) pixels from each of its pixels, clamped at the
    border.

    Positions are float32 whatever the image is: half floats cannot represent pixel positions beyond 2048.
    """
    x = torch.arange(image.shape[3], device=image.device) + flow[:, :1]
    y = torch.arange(image.shape[2], device=image.device)[:, None] + flow[:, 1:]
    return read(image.float(), x, y).to(image.dtype)
