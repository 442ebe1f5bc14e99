"""The classifier and compositor of Guo et al. 2022 (supplement, section 1), on tensors at half display size.

The channels of 2x2 display pixels are packed into one. The first 1x1 convolution then has the inputs that the
paper's has after SpaceToDepth, and no tensor of the network is larger than half the display.
"""

import itertools

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from supersampler.methods.classifier.spec import CLASSES, NetworkConfig

ALIGNED = 8  # the deepest level is at 1/8 of the packed size


class Pointwise(nn.Sequential):
    """1x1 convolution, batch normalisation and, unless it is the last layer, ReLU."""

    def __init__(self, channels: int, out: int, *, rectified: bool = True) -> None:
        layers = [nn.Conv2d(channels, out, 1, bias=False), nn.BatchNorm2d(out)]
        super().__init__(*layers, *([nn.ReLU()] if rectified else []))

    def forward(self, x: Tensor, pixels: Tensor | None = None) -> Tensor:
        """(n, channels, h, w) to (n, out, h, w).

        Args:
            x: all channels, or those after the packed pixels.
            pixels: (n, c, 2 h, 2 w) pixels of which `pack` would make the first 4 c channels.
        """
        convolution, *rest = self.children()
        if pixels is None:
            x = convolution(x)
        else:
            parameters = dict(convolution.named_parameters())  # after folding also a bias
            weight, channels = parameters["weight"], pixels.shape[1]
            parts = [4 * channels, weight.shape[1] - 4 * channels]
            of_pixels, others = weight.split_with_sizes(parts, dim=1)
            x = F.conv2d(x, others, parameters.get("bias"))
            x = x + F.conv2d(pixels, of_pixels.reshape(-1, channels, 2, 2), stride=2)
        for layer in rest:
            x = layer(x)
        return x


class Block(nn.Sequential):
    """1x1, depthwise 3x3, 1x1: the bottleneck of the supplement's figure 1."""

    def __init__(self, channels: int, out: int) -> None:
        depthwise = nn.Conv2d(out, out, 3, padding=1, groups=out, bias=False)
        super().__init__(Pointwise(channels, out), depthwise, Pointwise(out, out))

    def forward(self, x: Tensor, pixels: Tensor | None = None) -> Tensor:
        """(n, channels, h, w) to (n, out, h, w); `pixels`: see `Pointwise`."""
        first, depthwise, last = self.children()
        result: Tensor = last(depthwise(first(x, pixels)))
        return result


class Encoder(nn.Module):
    """Four levels; half of each level's channels go to the next level at half size, half to the decoder.

    All channels of the deepest level go to the decoder: 16 + 8 + 4 + 4 channels after pixel shuffling.
    """

    def __init__(self, channels: int, levels: tuple[int, ...]) -> None:
        super().__init__()
        handed = [channels, *(c // 2 for c in levels[:-1])]
        self.blocks = nn.ModuleList(Block(a, b) for a, b in zip(handed, levels, strict=True))
        kept = [*(c // 2 for c in levels[:-1]), levels[-1]]
        self.out_channels = sum(c // 4**i for i, c in enumerate(kept))

    def forward(self, x: Tensor, pixels: Tensor | None = None) -> Tensor:
        """(n, channels, h, w) to (n, out_channels, h, w); h and w are multiples of ALIGNED.

        `pixels`: see `Pointwise`.
        """
        outputs = []
        for level, block in enumerate(self.blocks):
            x = block(x, pixels) if level == 0 else block(x)
            if level + 1 < len(self.blocks):
                half = x.shape[1] // 2
                kept, x = x[:, :half], F.max_pool2d(x[:, half:], 2)
            else:
                kept = x
            outputs.append(F.pixel_shuffle(kept, 2**level) if level else kept)
        return torch.cat(outputs, dim=1)


class ClassifierNetwork(nn.Module):
    """Classifies each packed pixel, and infers the blend parameters of its four display pixels.

    Args:
        config: widths.
        packed: channels of the packed input.
        half_inputs: channels of the input at half display size.
        blend_parameters: number of them per display pixel.
    """

    def __init__(
        self, config: NetworkConfig, *, packed: int, half_inputs: int, blend_parameters: int
    ) -> None:
        super().__init__()
        self.encoder = Encoder(packed + half_inputs, config.levels)
        widths = [self.encoder.out_channels, *[config.decoder] * config.decoder_layers]
        self.decoder = nn.Sequential(*(Pointwise(a, b) for a, b in itertools.pairwise(widths)))
        self.classes = nn.Conv2d(config.decoder, CLASSES, 1)
        self.hidden = Pointwise(packed + config.decoder, config.hidden)
        self.blend = nn.Conv2d(config.hidden, 4 * blend_parameters, 1)
        for parameter in self.blend.parameters():
            nn.init.zeros_(parameter)  # zeros: the blend is then a running mean

    def forward(self, packed: Tensor, half_inputs: Tensor) -> tuple[Tensor, Tensor]:
        """Infer classes and blend parameters.

        Args:
            packed: (n, 4 c, h, w) from `pack`.
            half_inputs: (n, d, h, w) inputs at half display size.

        Returns:
            Logits of CLASSES (n, 6, h, w) and packed blend parameters (n, 4 m, h, w).
        """
        return self.decode(packed, encode(self.encoder, packed, half_inputs))

    def on_pixels(self, pixels: Tensor, half_inputs: Tensor) -> tuple[Tensor, Tensor]:
        """Return the results of `forward` from display pixels that are not packed.

        Packed pixels and a 1x1 convolution move more bytes than a 2x2 convolution at a stride of 2.

        Args:
            pixels: (n, c, H, W).
            half_inputs: (n, d, h, w) inputs at half display size.

        Returns:
            Logits as `forward`; blend parameters with up to ALIGNED - 1 more rows and columns.
        """
        pixels = padded_pixels(pixels)
        features = self.decoder(self.encoder(padded(half_inputs), pixels))
        logits: Tensor = self.classes(features)
        return cut_to(logits, half_inputs), self.blend(self.hidden(features, pixels))

    def decode(self, packed: Tensor, features: Tensor) -> tuple[Tensor, Tensor]:
        """Return the results of `forward` from the encoder's features."""
        features = self.decoder(features)
        blend = self.blend(self.hidden(torch.cat([packed, features], dim=1)))
        return self.classes(features), blend


def padded(image: Tensor, aligned: int = ALIGNED) -> Tensor:
    """Repeat the last row and column up to a multiple of `aligned`."""
    for axis in (2, 3):
        size = image.shape[axis]
        whole = (size + aligned - 1) // aligned * aligned
        image = image.index_select(axis, torch.arange(whole, device=image.device).clamp(max=size - 1))
    return image


def padded_pixels(image: Tensor) -> Tensor:
    """Extend display pixels so that their packed pixels are `padded(pack(image))`."""
    for axis in (2, 3):
        size = image.shape[axis]
        half = (size + 1) // 2
        whole = torch.arange((half + ALIGNED - 1) // ALIGNED * ALIGNED, device=image.device).clamp(
            max=half - 1
        )
        index = 2 * whole[:, None] + torch.arange(2, device=image.device)
        image = image.index_select(axis, index.reshape(-1).clamp(max=size - 1))
    return image


def cut_to(image: Tensor, like: Tensor) -> Tensor:
    """Undo `padded`."""
    return image[:, :, : like.shape[2], : like.shape[3]]


def encode(encoder: nn.Module, *inputs: Tensor) -> Tensor:
    """Run an `Encoder` on inputs of any size: (n, c, h, w) each to (n, out_channels, h, w)."""
    return cut_to(encoder(padded(torch.cat(inputs, dim=1))), inputs[0])


def pack(image: Tensor) -> Tensor:
    """Pack 2x2 pixels into one; an odd last row or column repeats: (n, c, H, W) -> (n, 4 c, H / 2, W / 2)."""
    return F.pixel_unshuffle(even(image), 2)


def even(image: Tensor) -> Tensor:
    """Repeat an odd last row or column."""
    return padded(image, 2)


def unpack(packed: Tensor, h: int, w: int) -> Tensor:
    """Inverse of `pack`, cut to (h, w)."""
    return F.pixel_shuffle(packed, 2)[:, :, :h, :w]


def class_probabilities(logits: Tensor) -> Tensor:
    """Softmax of three channels, in operators that all providers implement alike."""
    likely = (logits.clamp(-30.0, 30.0)).exp()
    return likely / (likely[:, :1] + likely[:, 1:2] + likely[:, 2:3])
