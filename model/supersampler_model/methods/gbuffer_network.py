"""The network of Wang et al. 2025 (section III), on tensors at render size.

Tensors of display size enter by pixel unshuffling: r x r display pixels become r^2 channels of a render
pixel. Each 3x3 convolution of the paper may be replaced by a depthwise one between 1x1 ones, which takes a
fraction of the work.
"""

import itertools
from collections.abc import Sequence
from functools import partial
from typing import NamedTuple

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from supersampler.methods.gbuffer.spec import Attention, GBufferNetworkConfig
from supersampler_model import ops
from supersampler_model.methods.classifier_network import Block, Pointwise, padded

SURFACES = 10  # base colour, normal, roughness, metallic, specular, relative depth
GRADIENTS = 2  # of base colour and of normals
CURRENT = 6  # of a frame: toned colour, relative depth, jitter
REFINER_INPUTS = 18  # inputs of the refiner, without the features of a previous frame
SAMPLES = 6  # of the frame's samples: motion, jitter, 1 where usable, relative depth
COLORS = 15  # toned colours at display size, sample count, visibility, similarity


class NetworkInputs(NamedTuple):
    """The network inputs; field names are tensor names of released graphs."""

    surfaces: Tensor  # (n, SURFACES, H, W)
    gradients: Tensor  # (n, GRADIENTS, H, W)
    current: Tensor  # (n, CURRENT, h, w)
    previous: Tensor  # (n, CURRENT, h, w) the previous frame, warped and masked
    refiner_inputs: Tensor  # (n, REFINER_INPUTS, h, w)
    earlier: Tensor  # (n, CURRENT, h, w) the frame before the previous one
    earlier_refiner_inputs: Tensor  # (n, REFINER_INPUTS, h, w)
    samples: Tensor  # (n, SAMPLES, h, w)
    colors: Tensor  # (n, COLORS, H, W)


_CHANNELS = (SURFACES, GRADIENTS, CURRENT, CURRENT, REFINER_INPUTS, CURRENT, REFINER_INPUTS, SAMPLES, COLORS)
INPUT_CHANNELS = dict(zip(NetworkInputs._fields, _CHANNELS, strict=True))
DISPLAY_INPUTS = ("surfaces", "gradients", "colors")
"""Inputs of display size; the others are of render size."""


class GatedEncoder(nn.Module):
    """Encodes all G-buffers, and adds features of base colour and depth times a learned gate (III.A)."""

    def __init__(self, config: GBufferNetworkConfig, ratio: int) -> None:
        super().__init__()
        self.ratio = ratio
        self.all = _encoder(SURFACES * ratio**2, config.surfaces, separable=config.separable)
        self.gate: nn.Parameter | None = None
        if config.gated:
            self.detailed = _encoder(4 * ratio**2, config.detailed, separable=config.separable)
            self.gate = nn.Parameter(torch.tensor(0.5))

    def forward(self, surfaces: Tensor) -> Tensor:
        """Map (n, SURFACES, H, W) to (n, width, h, w)."""
        features: Tensor = self.all(F.pixel_unshuffle(surfaces, self.ratio))
        if self.gate is None:
            return features
        color_and_depth = torch.cat([surfaces[:, :3], surfaces[:, -1:]], dim=1)
        detailed: Tensor = self.detailed(F.pixel_unshuffle(color_and_depth, self.ratio))
        return features + self.gate * detailed


class FrameEncoder(nn.Module):
    """Four convolutions; the output of the first is also an input of the network's last layer (III.B)."""

    def __init__(self, width: int, *, separable: bool) -> None:
        super().__init__()
        layer = _separable if separable else Convolved
        self.shallow = Convolved(CURRENT, width)
        self.deep = nn.Sequential(*(layer(width, width) for _ in range(3)))

    def forward(self, frame: Tensor) -> tuple[Tensor, Tensor]:
        """Map (n, CURRENT, h, w) to features and shallow features, (n, width, h, w) each."""
        shallow = self.shallow(frame)
        return self.deep(shallow), shallow


class Enhancer(nn.Module):
    """Attention between a frame and the gradients of its G-buffers, pixel by pixel (III.B, figure 3)."""

    def __init__(self, ratio: int, width: int, attention: Attention) -> None:
        super().__init__()
        self.ratio, self.attention = ratio, attention
        self.embed = Pointwise(GRADIENTS * ratio**2, width)
        directions = {"both": 2, "one": 1, "none": 0}[attention]
        self.projections = nn.ModuleList(nn.Conv2d(width, width, 1) for _ in range(3 * directions))

    def forward(self, frame: Tensor, gradients: Tensor) -> Tensor:
        """Map (n, width, h, w) and (n, GRADIENTS, H, W) to (n, width, h, w)."""
        if not self.projections:
            return frame
        edges = self.embed(F.pixel_unshuffle(gradients, self.ratio))
        enhanced = frame
        pairs = [(frame, edges), (edges, frame)]  # source of the query, source of key and value
        layers = iter(self.projections)  # three for each pair
        for (asking, asked), query, key, value in zip(pairs, layers, layers, layers, strict=False):
            enhanced = enhanced + torch.sigmoid(query(asking) * key(asked)) * value(asked)
        return enhanced


class Refiner(nn.Module):
    """UNet of two levels that restores features of previous frames where these were masked (III.C)."""

    def __init__(self, width: int, *, separable: bool) -> None:
        super().__init__()
        self.down = _block(width + REFINER_INPUTS, width, separable=separable)
        self.below = _block(width, width, separable=separable)
        self.up = _block(2 * width, width, separable=separable)

    def forward(self, features: Tensor, refiner_inputs: Tensor) -> Tensor:
        """Map (n, width, h, w) and (n, REFINER_INPUTS, h, w) to (n, width, h, w)."""
        fine = self.down(padded(torch.cat([features, refiner_inputs], dim=1)))
        coarse = doubled(self.below(F.max_pool2d(fine, 2)))
        return ops.cut_to(self.up(torch.cat([fine, coarse], dim=1)), ops.size_of(features))


class FusionNetwork(nn.Module):
    """UNet with a block per level and direction; only the first and the last are at render size (III.D)."""

    def __init__(self, channels: int, levels: Sequence[int], *, separable: bool) -> None:
        super().__init__()
        block = partial(_block, separable=separable)
        self.down = nn.ModuleList(block(a, b) for a, b in itertools.pairwise([channels, *levels]))
        self.deepest = block(levels[-1], levels[-1])
        widths = zip(reversed(levels[1:]), reversed(levels[:-1]), strict=True)
        self.up = nn.ModuleList(block(coarse + fine, fine) for coarse, fine in widths)

    def forward(self, features: Tensor) -> Tensor:
        """Map (n, channels, h, w) to (n, levels[0], h, w)."""
        x = padded(features)
        kept: list[Tensor] = []
        for block in self.down:
            x = block(F.max_pool2d(x, 2) if kept else x)
            kept.append(x)
        x = self.deepest(kept.pop())
        for block in self.up:
            x = block(torch.cat([kept.pop(), doubled(x)], dim=1))
        return ops.cut_to(x, ops.size_of(features))


class GBufferNetwork(nn.Module):
    """Figure 2 of the paper; `ratio` is display over render size, blend parameters are per display pixel."""

    def __init__(self, config: GBufferNetworkConfig, *, ratio: int, blend_parameters: int) -> None:
        super().__init__()
        self.config, self.ratio = config, ratio
        surfaces, frame, fusion = config.surfaces[-1], config.frame, config.levels[0]
        self.surfaces = GatedEncoder(config, ratio)
        self.frame = FrameEncoder(frame, separable=config.separable)
        self.enhancer = Enhancer(ratio, frame, config.attention)
        self.refiner: nn.Module = Pointwise(frame + REFINER_INPUTS, frame)
        if config.refined:
            self.refiner = Refiner(frame, separable=config.separable)
        self.colors = Pointwise(COLORS * ratio**2 + SAMPLES, surfaces)
        channels = 2 * surfaces + 3 * frame
        self.fusion = FusionNetwork(channels, config.levels, separable=config.separable)
        self.blend = nn.Conv2d(fusion + frame + surfaces, blend_parameters * ratio**2, 1)
        for parameter in self.blend.parameters():
            nn.init.zeros_(parameter)  # zeros: the blend then has its initial weights

    def forward(
        self,
        surfaces: Tensor,
        gradients: Tensor,
        current: Tensor,
        previous: Tensor,
        refiner_inputs: Tensor,
        earlier: Tensor,
        earlier_refiner_inputs: Tensor,
        samples: Tensor,
        colors: Tensor,
    ) -> tuple[Tensor]:
        """Return the blend parameters (n, blend_parameters, H, W) of the fields of `NetworkInputs`."""
        n = current.shape[0]
        features, shallow = self.frame(torch.cat([current, previous, earlier]))  # in one pass
        now, previous_features = features[:n], features[n:]
        beside = torch.cat([refiner_inputs, earlier_refiner_inputs])
        if self.config.refined:
            refined = self.refiner(previous_features, beside)
        else:
            refined = self.refiner(torch.cat([previous_features, beside], dim=1))
        known = self.colors(torch.cat([F.pixel_unshuffle(colors, self.ratio), samples], dim=1))
        parts = [self.surfaces(surfaces), self.enhancer(now, gradients), refined[:n], refined[n:], known]
        fused = self.fusion(torch.cat(parts, dim=1))
        blend = self.blend(torch.cat([fused, shallow[:n], known], dim=1))
        return (F.pixel_shuffle(blend, self.ratio),)


class Convolved(nn.Sequential):
    """3x3 convolution, batch normalisation and ReLU."""

    def __init__(self, channels: int, out: int) -> None:
        convolution = nn.Conv2d(channels, out, 3, padding=1, bias=False)
        super().__init__(convolution, nn.BatchNorm2d(out), nn.ReLU())


def _separable(channels: int, out: int) -> nn.Sequential:
    depthwise = nn.Conv2d(channels, channels, 3, padding=1, groups=channels, bias=False)
    return nn.Sequential(depthwise, Pointwise(channels, out))


def _block(channels: int, out: int, *, separable: bool) -> nn.Sequential:
    if separable:
        return Block(channels, out)
    return nn.Sequential(Convolved(channels, out), Convolved(out, out))


def _encoder(channels: int, widths: Sequence[int], *, separable: bool) -> nn.Sequential:
    pairs = list(itertools.pairwise([channels, *widths]))
    if not separable:
        return nn.Sequential(*(Convolved(a, b) for a, b in pairs))
    return nn.Sequential(Pointwise(*pairs[0]), *(Block(a, b) for a, b in pairs[1:]))


def doubled(image: Tensor) -> Tensor:
    """Repeat each pixel 2x2 times by pixel shuffling: providers round the sizes of Resize differently."""
    n, c, h, w = image.shape
    return F.pixel_shuffle(image[:, :, None].expand(n, c, 4, h, w).reshape(n, 4 * c, h, w), 2)
