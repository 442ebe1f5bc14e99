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
from supersampler_model.ops.motion import positions_of, read
from supersampler_model.ops.size import render_size_of

LIGHT = 4  # channels of an input: toned light, roughness
FLOW = 2  # output channels of the flow: offset across, offset down
OUTPUTS = (FLOW, 1, 1)
"""Output channels: flow in pixels of the inputs, gain, logit of the blend weight of the moved light."""
AGE_RATIO = 3.0  # age of the earlier input over that of the later one, where every second frame is shaded


class Decoder(nn.Module):
    """One level: refines the flow and passes features to the next finer level.

    Args:
        width: of the level's features.
        above: width of the next finer level; None at the finest, which infers all OUTPUTS instead.
        deepest: whether this is the coarsest level, without features from another.
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

    def __init__(self, config: FlowNetworkConfig) -> None:
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
        """Infer the flow from the light of two shaded frames, (n, LIGHT, h, w) in [0, 1].

        Returns:
            (n, sum(OUTPUTS), h, w).
        """
        n = later.shape[0]
        pyramid = self.features(torch.cat([later, earlier]))  # in one pass
        outputs, features = self.decoder[-1](torch.cat([pyramid[-1][:n], pyramid[-1][n:]], dim=1))
        for both, decoder in zip(reversed(pyramid[:-1]), reversed(self.decoder[:-1]), strict=True):
            flow = outputs
            joined = [features, moved(both[:n], flow), moved(both[n:], AGE_RATIO * flow), flow.to(both.dtype)]
            more, features = decoder(torch.cat(joined, dim=1))
            outputs = torch.cat([2.0 * doubled(flow) + more[:, :FLOW], more[:, FLOW:]], dim=1)
        return (cut_to(outputs, render_size_of(later)),)

    def features(self, lights: Tensor) -> list[Tensor]:
        """Return features of (n, LIGHT, h, w), finest level first, padded to whole pixels of the coarsest."""
        x = F.pixel_unshuffle(padded(lights, 2 ** len(self.config.levels)), 2)
        pyramid: list[Tensor] = []
        for block in self.encoder:
            x = block(F.max_pool2d(x, 2) if pyramid else x)
            pyramid.append(x)
        return pyramid


def moved(image: Tensor, flow: Tensor) -> Tensor:
    """Read an image (n, c, h, w) bilinearly at an offset `flow`, (n, 2, h, w) pixels, clamped at the border.

    Positions are float32 also for images of half floats: those cannot represent pixel positions beyond 2048.
    """
    x = torch.arange(image.shape[3], device=image.device) + flow[:, :1]
    y = torch.arange(image.shape[2], device=image.device)[:, None] + flow[:, 1:]
    return read(image.float(), positions_of(x, y)).to(image.dtype)
