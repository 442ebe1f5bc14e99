"""The classifier and compositor of Guo et al. 2022 (supplement, section 1), on tensors at half display size.

Every display pixel's channels come packed, four pixels in one: the first 1x1 convolution then sees what the
paper's sees after its SpaceToDepth, and nothing in the network is larger than half the display.
"""

import itertools

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from supersampler.methods.classifier.spec import CLASSES, NetworkConfig

ALIGNED = 8  # the deepest level is at 1/8 of the packed size


class Pointwise(nn.Sequential):
    """1x1 convolution, batch normalisation and, but for the last of a network, ReLU."""

    def __init__(self, channels: int, out: int, *, rectified: bool = True) -> None:
        layers = [nn.Conv2d(channels, out, 1, bias=False), nn.BatchNorm2d(out)]
        super().__init__(*layers, *([nn.ReLU()] if rectified else []))


class Block(nn.Sequential):
    """1x1, depthwise 3x3, 1x1: the bottleneck of the supplement's figure 1."""

    def __init__(self, channels: int, out: int) -> None:
        depthwise = nn.Conv2d(out, out, 3, padding=1, groups=out, bias=False)
        super().__init__(Pointwise(channels, out), depthwise, Pointwise(out, out))


class Encoder(nn.Module):
    """Four levels; each hands one half of its channels to the next, at half size, and one to the decoder.

    The deepest hands all to the decoder: 16 + 8 + 4 + 4 channels, once pixels are shuffled into place.
    """

    def __init__(self, channels: int, levels: tuple[int, ...]) -> None:
        super().__init__()
        handed = [channels, *(c // 2 for c in levels[:-1])]
        self.blocks = nn.ModuleList(Block(a, b) for a, b in zip(handed, levels, strict=True))
        kept = [*(c // 2 for c in levels[:-1]), levels[-1]]
        self.out_channels = sum(c // 4**i for i, c in enumerate(kept))

    def forward(self, x: Tensor) -> Tensor:
        """(n, channels, h, w) to (n, out_channels, h, w); h and w are multiples of ALIGNED."""
        seen = []
        for level, block in enumerate(self.blocks):
            x = block(x)
            if level + 1 < len(self.blocks):
                half = x.shape[1] // 2
                kept, x = x[:, :half], F.max_pool2d(x[:, half:], 2)
            else:
                kept = x
            seen.append(F.pixel_shuffle(kept, 2**level) if level else kept)
        return torch.cat(seen, dim=1)


class ClassifierNetwork(nn.Module):
    """Which class each packed pixel is of, and how each of its four pixels is to be composed.

    Args:
        config: widths.
        packed: channels of the packed input.
        carried: channels at half size that come beside them (the classes of the frame before).
        mixing: what the compositor says of each pixel.
    """

    def __init__(self, config: NetworkConfig, *, packed: int, carried: int, mixing: int) -> None:
        super().__init__()
        self.encoder = Encoder(packed + carried, config.levels)
        widths = [self.encoder.out_channels, *[config.decoder] * config.decoder_layers]
        self.decoder = nn.Sequential(*(Pointwise(a, b) for a, b in itertools.pairwise(widths)))
        self.classes = nn.Conv2d(config.decoder, CLASSES, 1)
        self.hidden = Pointwise(packed + config.decoder, config.hidden)
        self.mixing = nn.Conv2d(config.hidden, 4 * mixing, 1)
        for parameter in self.mixing.parameters():
            nn.init.zeros_(parameter)  # begins as the running mean that the blend takes it for

    def forward(self, packed: Tensor, carried: Tensor) -> tuple[Tensor, Tensor]:
        """Classify and weigh.

        Args:
            packed: (n, 4 c, h, w), as `pack` makes it.
            carried: (n, d, h, w).

        Returns:
            Logits of CLASSES (n, 6, h, w), and (n, 4 m, h, w), packed, of the pixels.
        """
        return self.decode(packed, encode(self.encoder, packed, carried))

    def decode(self, packed: Tensor, features: Tensor) -> tuple[Tensor, Tensor]:
        """Say the same of what an encoder has found."""
        features = self.decoder(features)
        mixing = self.mixing(self.hidden(torch.cat([packed, features], dim=1)))
        return self.classes(features), mixing


def padded(image: Tensor, aligned: int = ALIGNED) -> Tensor:
    """Repeat the last row and column up to a multiple of `aligned`."""
    for axis in (2, 3):
        size = image.shape[axis]
        whole = (size + aligned - 1) // aligned * aligned
        image = image.index_select(axis, torch.arange(whole, device=image.device).clamp(max=size - 1))
    return image


def cut_to(image: Tensor, like: Tensor) -> Tensor:
    """Undo `padded`."""
    return image[:, :, : like.shape[2], : like.shape[3]]


def encode(encoder: nn.Module, *inputs: Tensor) -> Tensor:
    """Run an `Encoder` on inputs of any size: (n, c, h, w) each to (n, out_channels, h, w)."""
    return cut_to(encoder(padded(torch.cat(inputs, dim=1))), inputs[0])


def pack(image: Tensor) -> Tensor:
    """Four pixels in one, the last row and column repeated if odd: (n, c, H, W) -> (n, 4 c, H / 2, W / 2)."""
    h, w = image.shape[2], image.shape[3]
    rows = torch.arange((h + 1) // 2 * 2, device=image.device).clamp(max=h - 1)
    columns = torch.arange((w + 1) // 2 * 2, device=image.device).clamp(max=w - 1)
    return F.pixel_unshuffle(image.index_select(2, rows).index_select(3, columns), 2)


def unpack(packed: Tensor, h: int, w: int) -> Tensor:
    """Inverse of `pack`, cut to (h, w)."""
    return F.pixel_shuffle(packed, 2)[:, :, :h, :w]


def shares(logits: Tensor) -> Tensor:
    """Softmax of three channels, in operators that all providers have alike."""
    likely = (logits.clamp(-30.0, 30.0)).exp()
    return likely / (likely[:, :1] + likely[:, 1:2] + likely[:, 2:3])
