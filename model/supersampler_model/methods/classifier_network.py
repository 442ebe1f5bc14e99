"""The classifier and compositor of Guo et al. 2022 (supplement, section 1), on tensors at half display size.

The channels of 2x2 display pixels are packed into one pixel, as by SpaceToDepth in the paper. No tensor of
the network is larger than half the display.
"""

import itertools
from collections.abc import Sequence

import torch
from torch import Tensor, nn
from torch.nn import functional as F
from torch.nn.utils.fusion import fuse_conv_bn_eval

from supersampler.methods.classifier.spec import CLASSES, NetworkConfig
from supersampler_model import ops

ALIGNED = 8  # the deepest level is at 1/8 of the packed size


class Pointwise(nn.Sequential):
    """1x1 convolution, batch normalisation and, unless it is the last layer, ReLU."""

    def __init__(self, channels: int, out: int, *, rectified: bool = True) -> None:
        layers = [nn.Conv2d(channels, out, 1, bias=False), nn.BatchNorm2d(out)]
        super().__init__(*layers, *([nn.ReLU()] if rectified else []))


class Block(nn.Sequential):
    """1x1, depthwise 3x3, 1x1: the bottleneck of the supplement's figure 1."""

    def __init__(self, channels: int, out: int) -> None:
        depthwise = nn.Conv2d(out, out, 3, padding=1, groups=out, bias=False)
        super().__init__(Pointwise(channels, out), depthwise, Pointwise(out, out))


class Encoder(nn.Module):
    """Four levels: half of a level's channels go to the next level at half size, the others to the decoder.

    All channels of the deepest level go to the decoder.
    """

    def __init__(self, channels: int, levels: tuple[int, ...]) -> None:
        super().__init__()
        inputs = [channels, *(c // 2 for c in levels[:-1])]
        self.blocks = nn.ModuleList(Block(a, b) for a, b in zip(inputs, levels, strict=True))
        kept = [*(c // 2 for c in levels[:-1]), levels[-1]]
        self.out_channels = sum(c // 4**i for i, c in enumerate(kept))

    def forward(self, x: Tensor) -> Tensor:
        """Map (n, channels, h, w) to (n, out_channels, h, w); h and w are multiples of ALIGNED."""
        return self.deeper(self.blocks[0](x))

    def deeper(self, x: Tensor) -> Tensor:
        """Run the other levels on the result of the first one."""
        outputs = []
        for block in self.blocks[1:]:
            half = x.shape[1] // 2
            kept, x = x.split_with_sizes([half, half], dim=1)
            outputs.append(kept)
            x = block(F.max_pool2d(x, 2))
        outputs.append(x)
        unpacked = [F.pixel_shuffle(kept, 2**level) if level else kept for level, kept in enumerate(outputs)]
        return torch.cat(unpacked, dim=1)


class ClassifierNetwork(nn.Module):
    """Classifies each packed pixel, and infers the blend parameters of its four display pixels.

    The inputs are `packed` channels of packed pixels, and `half_inputs` channels at half display size.
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
        """Infer logits of CLASSES (n, 6, h, w) and packed blend parameters (n, 4 m, h, w).

        `packed` is (n, 4 c, h, w) from `pack`, `half_inputs` (n, d, h, w) at half display size.
        """
        return self.decode(packed, encode(self.encoder, packed, half_inputs))

    def on_pixels(self, pixels: Sequence[Tensor], half_inputs: Tensor) -> tuple[Tensor, Tensor]:
        """Infer logits (n, 6, H / 2, W / 2) and blend parameters (n, m, H, W): `forward`, then `unpack`.

        2x2 convolutions at a stride of 2 replace packing and 1x1 convolutions, and move fewer bytes.

        Args:
            pixels: parts of (n, c, H, W), not packed; H and W are multiples of 2 ALIGNED.
            half_inputs: (n, d, H / 2, W / 2) inputs at half display size.
        """
        missing = -half_inputs.shape[1] % 4
        if missing:
            none = half_inputs.new_zeros(half_inputs.shape[0], missing, *half_inputs.shape[2:])
            half_inputs = torch.cat([half_inputs, none], dim=1)
        planes = torch.cat([*pixels, F.pixel_shuffle(half_inputs, 2)], dim=1)
        first, depthwise, last = self.encoder.blocks[0].children()
        weight, bias = _folded_weights(first)
        x = F.conv2d(planes, _on_pixels(weight, planes.shape[1]), bias, stride=2).relu()
        features = self.decoder(self.encoder.deeper(last(depthwise(x))))
        hidden = self._hidden_and_one(planes, features)
        return self.classes(features), self._blend_pixels(hidden)

    def _hidden_and_one(self, planes: Tensor, features: Tensor) -> Tensor:
        """Compute the hidden layer, and a channel of ones."""
        weight, bias = _folded_weights(self.hidden)
        width = features.shape[1]
        of_pixels, of_features = weight.split_with_sizes([weight.shape[1] - width, width], dim=1)
        bias = torch.cat([bias, bias.new_ones(1)])
        of_features, of_pixels = (torch.cat([w, torch.zeros_like(w[:1])]) for w in (of_features, of_pixels))
        of_pixels = _on_pixels(of_pixels, planes.shape[1])
        return (F.conv2d(features, of_features, bias) + F.conv2d(planes, of_pixels, stride=2)).relu()

    def _blend_pixels(self, hidden_and_one: Tensor) -> Tensor:
        """Compute the unpacked blend parameters; the channel of ones carries the bias of each pixel."""
        weight, bias = self.blend.state_dict(keep_vars=True).values()
        weight = torch.cat([weight[:, :, 0, 0], bias[:, None]], dim=1)
        weight = weight.reshape(-1, 2, 2, weight.shape[1]).permute(3, 0, 1, 2)
        return F.conv_transpose2d(hidden_and_one, weight, stride=2)

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
        if not torch.compiler.is_exporting() and whole == size:
            continue  # the gradient of the copy is slow; in graphs, sizes are symbolic
        image = image.index_select(axis, torch.arange(whole, device=image.device).clamp(max=size - 1))
    return image


def _folded_weights(layer: nn.Module) -> tuple[Tensor, Tensor]:
    """Return weight and bias of a `Pointwise`, its batch normalisation folded in."""
    convolution, normalisation = list(layer.children())[:2]
    if isinstance(convolution, nn.Conv2d) and isinstance(normalisation, nn.BatchNorm2d):
        convolution = fuse_conv_bn_eval(convolution, normalisation)
    weight, bias = convolution.state_dict(keep_vars=True).values()
    return weight, bias


def _on_pixels(weight: Tensor, channels: int) -> Tensor:
    """Convert weights (out, 4 c, 1, 1) of packed pixels to (out, channels, 2, 2), 0 after c channels."""
    missing = 4 * channels - weight.shape[1]
    if missing:
        weight = torch.cat([weight, torch.zeros_like(weight[:, :missing])], dim=1)
    return weight.reshape(-1, channels, 2, 2)


def encode(encoder: nn.Module, *inputs: Tensor) -> Tensor:
    """Run an `Encoder` on inputs of any size: (n, c, h, w) each to (n, out_channels, h, w)."""
    return ops.cut_to(encoder(padded(torch.cat(inputs, dim=1))), ops.size_of(inputs[0]))


def pack(image: Tensor) -> Tensor:
    """Pack 2x2 pixels into one; an odd last row or column repeats: (n, c, H, W) -> (n, 4 c, H / 2, W / 2)."""
    return F.pixel_unshuffle(padded(image, 2), 2)


def unpack(packed: Tensor) -> Tensor:
    """Invert `pack`: (n, 4 c, h, w) -> (n, c, 2 h, 2 w)."""
    return F.pixel_shuffle(packed, 2)


def classes_of(logits: Tensor, known: Tensor) -> Tensor:
    """Return the probabilities of CLASSES. As in the labels, pixels without history are disoccluded.

    Args:
        logits: (1, 6, h, w).
        known: (1, 1, h, w) bool: whether there is a history.
    """
    visibility = logits.new_tensor([0.0, 1.0, 0.0]).reshape(1, 3, 1, 1)
    ghosting = torch.where(known, class_probabilities(logits[:, :3]), visibility)
    return torch.cat([ghosting, class_probabilities(logits[:, 3:])], dim=1)


def class_probabilities(logits: Tensor) -> Tensor:
    """Return the softmax of three channels, in operators that all providers implement in the same way."""
    likely = logits.clamp(-30.0, 30.0).exp()
    return likely / (likely[:, :1] + likely[:, 1:2] + likely[:, 2:3])
