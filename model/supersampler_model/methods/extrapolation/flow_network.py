"""FRNet, the flow network of Wu et al. 2023 (ExtraSS, section 4.3), on tensors of half the render size.

The paper calls it light and leaves its layers to a supplement; its loss is that of IFRNet (Kong et al.
2022), whose pyramid this is: features of both pictures by one encoder and, from the coarsest level up, a
decoder that refines the flow and hands features on. One flow in place of two, as both pictures are of the
past, and depthwise convolutions between 1x1 ones.
"""

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from supersampler.methods.extrapolation.spec import FlowNetworkConfig
from supersampler_model.methods.classifier.network import Block, cut_to, padded
from supersampler_model.methods.gbuffer.network import doubled
from supersampler_model.ops.motion import read

PICTURE = 4  # channels of a picture: toned light, roughness
FLOW, GAIN, SHARE = 2, 1, 1  # what is said of a pixel
AGO = 3.0  # frames since the earlier picture, for one since the later: where every second frame is shaded


class Decoder(nn.Module):
    """One level: refines the flow, and hands features to the level above.

    Args:
        width: of the level's features.
        above: of those of the level above; None at the finest, which says gain and share in their place.
        deepest: whether no level has handed anything to this one.
    """

    def __init__(self, width: int, above: int | None, *, deepest: bool) -> None:
        super().__init__()
        seen = 2 * width if deepest else 3 * width + FLOW
        self.blocks = nn.Sequential(Block(seen, width), Block(width, width))
        self.flow = nn.Conv2d(width, 4 * (FLOW if above else FLOW + GAIN + SHARE), 1)
        self.features = nn.Conv2d(width, 4 * above, 1) if above else None
        for parameter in self.flow.parameters():
            nn.init.zeros_(parameter)  # begins as light that stays on its surface

    def forward(self, seen: Tensor) -> tuple[Tensor, Tensor | None]:
        """(n, c, h, w) to what is said, in pixels, and features, both of twice the size."""
        inner = self.blocks(seen)
        said = F.pixel_shuffle(self.flow(inner).float(), 2)
        return said, None if self.features is None else F.pixel_shuffle(self.features(inner), 2)


class FlowNetwork(nn.Module):
    """Where light is to be read that was last shaded elsewhere, and how much brighter it is."""

    def __init__(self, config: FlowNetworkConfig) -> None:
        super().__init__()
        self.config = config
        widths = config.levels
        inputs = [4 * PICTURE, *widths[:-1]]
        self.encoder = nn.ModuleList(Block(a, b) for a, b in zip(inputs, widths, strict=True))
        aboves = [None, *widths[:-1]]
        self.decoder = nn.ModuleList(
            Decoder(width, above, deepest=level + 1 == len(widths))
            for level, (width, above) in enumerate(zip(widths, aboves, strict=True))
        )

    def forward(self, later: Tensor, earlier: Tensor) -> tuple[Tensor]:
        """Compare two pictures (n, PICTURE, h, w), in [0, 1], as light was in two shaded frames.

        Returns:
            (n, FLOW + GAIN + SHARE, h, w): how far off light is to be read in the later one, pixels of it;
            its gain; and the logit of the share that it takes.
        """
        n = later.shape[0]
        pyramid = self.features(torch.cat([later, earlier]))  # in one pass
        said, features = self.decoder[-1](torch.cat([pyramid[-1][:n], pyramid[-1][n:]], dim=1))
        for both, decoder in zip(reversed(pyramid[:-1]), reversed(self.decoder[:-1]), strict=True):
            flow = said
            seen = [features, moved(both[:n], flow), moved(both[n:], AGO * flow), flow.to(both.dtype)]
            more, features = decoder(torch.cat(seen, dim=1))
            said = torch.cat([2.0 * doubled(flow) + more[:, :FLOW], more[:, FLOW:]], dim=1)
        return (cut_to(said, later),)

    def features(self, pictures: Tensor) -> list[Tensor]:
        """Features of pictures (n, PICTURE, h, w), from the finest level, of whole pixels of the coarsest."""
        x = F.pixel_unshuffle(padded(pictures, 2 ** len(self.config.levels)), 2)
        pyramid: list[Tensor] = []
        for block in self.encoder:
            x = block(F.max_pool2d(x, 2) if pyramid else x)
            pyramid.append(x)
        return pyramid


def moved(image: Tensor, flow: Tensor) -> Tensor:
    """Read an image (n, c, h, w) at `flow` (n, 2, h, w) pixels from each of its own; beyond it, its border.

    Places are in single precision whatever the image is in: halves tell no pixels apart beyond 2048.
    """
    x = torch.arange(image.shape[3], device=image.device) + flow[:, :1]
    y = torch.arange(image.shape[2], device=image.device)[:, None] + flow[:, 1:]
    return read(image.float(), x, y).to(image.dtype)
