"""The network of Wang et al. 2025 (section III), on tensors at render size.

Everything of display size comes by pixel unshuffling: r x r pixels of a channel as r^2 channels of the render
pixel that they lie in. Where the paper has 3x3 convolutions, blocks of 1x1, depthwise 3x3 and 1x1 do the same
for a fraction of the work.
"""

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, NamedTuple

import torch
from torch import Tensor, nn
from torch.nn import functional as F

from supersampler_model.networks.classifier import Block, Pointwise, cut_to, padded

SURFACES = 10  # base colour, normal, roughness, metallic, specular, relative depth
GRADIENTS = 2  # of base colour and of normals
CURRENT = 6  # of a frame: toned colour, relative depth, jitter
BESIDE = 18  # what the refiner sees beside features of the past
SAMPLES = 6  # of the frame's samples: motion, jitter, use, relative depth
COLORS = 12  # toned colours at display size, and what is known of them

Attention = Literal["both", "one", "none"]


@dataclass(frozen=True)
class GBufferNetworkConfig:
    """Widths, and the parts that the paper takes away one by one (its table IX).

    Attributes:
        surfaces: channels of the G-buffers encoder.
        frame: of the frame encoder.
        levels: of the fusion network, from render size down.
        gated: whether base colour and depth have a branch of their own.
        attention: between the frame and the gradients of the G-buffers: "both" ways, "one", or "none".
        refined: whether features of the past are refined by the present.
    """

    surfaces: int = 32
    frame: int = 24
    levels: tuple[int, ...] = (48, 64, 96, 128)
    gated: bool = True
    attention: Attention = "both"
    refined: bool = True


class Seen(NamedTuple):
    """What the network sees."""

    surfaces: Tensor  # (n, SURFACES, H, W)
    gradients: Tensor  # (n, GRADIENTS, H, W)
    current: Tensor  # (n, CURRENT, h, w)
    past: Sequence[tuple[Tensor, Tensor]]  # of each frame of the past: (n, CURRENT, h, w), (n, BESIDE, h, w)
    samples: Tensor  # (n, SAMPLES, h, w)
    colors: Tensor  # (n, COLORS, H, W)


class GatedEncoder(nn.Module):
    """Features of the G-buffers: of all, and of base colour and depth times a learned gate (III.A)."""

    def __init__(self, ratio: int, width: int, *, gated: bool) -> None:
        super().__init__()
        self.ratio = ratio
        self.all = nn.Sequential(Pointwise(SURFACES * ratio**2, width), Block(width, width))
        self.gate: nn.Parameter | None = None
        if gated:
            self.detailed = nn.Sequential(Pointwise(4 * ratio**2, width), Block(width, width))
            self.gate = nn.Parameter(torch.tensor(0.5))

    def forward(self, surfaces: Tensor) -> Tensor:
        """(n, SURFACES, H, W) to (n, width, h, w)."""
        features: Tensor = self.all(F.pixel_unshuffle(surfaces, self.ratio))
        if self.gate is None:
            return features
        few = torch.cat([surfaces[:, :3], surfaces[:, -1:]], dim=1)
        detailed: Tensor = self.detailed(F.pixel_unshuffle(few, self.ratio))
        return features + self.gate * detailed


class FrameEncoder(nn.Module):
    """Four convolutions; the first's output is kept for the end of the network (III.B)."""

    def __init__(self, width: int) -> None:
        super().__init__()
        first = nn.Conv2d(CURRENT, width, 3, padding=1, bias=False)
        self.shallow = nn.Sequential(first, nn.BatchNorm2d(width), nn.ReLU())
        self.deep = nn.Sequential(*itertools.chain.from_iterable(_separable(width) for _ in range(3)))

    def forward(self, frame: Tensor) -> tuple[Tensor, Tensor]:
        """(n, CURRENT, h, w) to features and shallow features, (n, width, h, w) each."""
        shallow = self.shallow(frame)
        return self.deep(shallow), shallow


class Enhancer(nn.Module):
    """Attention between a frame and the gradients of its G-buffers, pixel by pixel (III.B, figure 3)."""

    def __init__(self, ratio: int, width: int, attention: Attention) -> None:
        super().__init__()
        self.ratio, self.attention = ratio, attention
        self.embed = Pointwise(GRADIENTS * ratio**2, width)
        ways = {"both": 2, "one": 1, "none": 0}[attention]
        self.projections = nn.ModuleList(nn.Conv2d(width, width, 1) for _ in range(3 * ways))

    def forward(self, frame: Tensor, gradients: Tensor) -> Tensor:
        """(n, width, h, w) and (n, GRADIENTS, H, W) to (n, width, h, w)."""
        if not self.projections:
            return frame
        edges = self.embed(F.pixel_unshuffle(gradients, self.ratio))
        enhanced = frame
        turns = [(frame, edges), (edges, frame)]  # who asks whom
        for (asking, asked), (query, key, value) in zip(turns, _threes(self.projections), strict=False):
            enhanced = enhanced + torch.sigmoid(query(asking) * key(asked)) * value(asked)
        return enhanced


class Refiner(nn.Module):
    """A UNet of two levels that repairs features of the past where they were masked (III.C)."""

    def __init__(self, width: int) -> None:
        super().__init__()
        self.down, self.below, self.up = (
            Block(width + BESIDE, width),
            Block(width, width),
            Block(2 * width, width),
        )

    def forward(self, features: Tensor, beside: Tensor) -> Tensor:
        """(n, width, h, w) and (n, BESIDE, h, w) to (n, width, h, w)."""
        here = self.down(padded(torch.cat([features, beside], dim=1)))
        below = _doubled(self.below(F.max_pool2d(here, 2)))
        return cut_to(self.up(torch.cat([here, below], dim=1)), features)


class FusionNetwork(nn.Module):
    """A UNet of as many blocks down as up, of which the first and last alone are at render size (III.D)."""

    def __init__(self, channels: int, levels: Sequence[int]) -> None:
        super().__init__()
        self.down = nn.ModuleList(Block(a, b) for a, b in itertools.pairwise([channels, *levels]))
        self.deepest = Block(levels[-1], levels[-1])
        below = reversed(levels[1:])
        beside = reversed(levels[:-1])
        self.up = nn.ModuleList(Block(a + b, b) for a, b in zip(below, beside, strict=True))

    def forward(self, features: Tensor) -> Tensor:
        """(n, channels, h, w) to (n, levels[0], h, w)."""
        x = padded(features)
        kept: list[Tensor] = []
        for block in self.down:
            x = block(F.max_pool2d(x, 2) if kept else x)
            kept.append(x)
        x = self.deepest(kept.pop())
        for block in self.up:
            x = block(torch.cat([kept.pop(), _doubled(x)], dim=1))
        return cut_to(x, features)


class GBufferNetwork(nn.Module):
    """Figure 2 of the paper, up to the pixel shuffling.

    Args:
        config: widths.
        ratio: display over render size.
        mixing: numbers that are said of each pixel of the display.
    """

    def __init__(self, config: GBufferNetworkConfig, *, ratio: int, mixing: int) -> None:
        super().__init__()
        self.config, self.ratio = config, ratio
        surfaces, frame, fused = config.surfaces, config.frame, config.levels[0]
        self.surfaces = GatedEncoder(ratio, surfaces, gated=config.gated)
        self.frame = FrameEncoder(frame)
        self.enhancer = Enhancer(ratio, frame, config.attention)
        self.refiner = Refiner(frame) if config.refined else Pointwise(frame + BESIDE, frame)
        self.colors = Pointwise(COLORS * ratio**2 + SAMPLES, surfaces)
        self.fusion = FusionNetwork(2 * surfaces + 3 * frame, config.levels)
        self.mixing = nn.Conv2d(fused + frame + surfaces, mixing * ratio**2, 1)
        for parameter in self.mixing.parameters():
            nn.init.zeros_(parameter)  # begins as the means that the method takes it for

    def forward(self, seen: Seen) -> Tensor:
        """What is said of each pixel: (n, mixing, H, W)."""
        features, shallow = self.frame(seen.current)
        parts = [self.surfaces(seen.surfaces), self.enhancer(features, seen.gradients)]
        parts += [self._past(frame, beside) for frame, beside in seen.past]
        colors = self.colors(torch.cat([F.pixel_unshuffle(seen.colors, self.ratio), seen.samples], dim=1))
        fused = self.fusion(torch.cat([*parts, colors], dim=1))
        return F.pixel_shuffle(self.mixing(torch.cat([fused, shallow, colors], dim=1)), self.ratio)

    def _past(self, frame: Tensor, beside: Tensor) -> Tensor:
        features, _ = self.frame(frame)
        parts = (features, beside) if self.config.refined else (torch.cat([features, beside], dim=1),)
        refined: Tensor = self.refiner(*parts)
        return refined


def _separable(width: int) -> tuple[nn.Module, nn.Module]:
    depthwise = nn.Conv2d(width, width, 3, padding=1, groups=width, bias=False)
    return depthwise, Pointwise(width, width)


def _threes(modules: nn.ModuleList) -> list[tuple[nn.Module, ...]]:
    return [tuple(modules[i : i + 3]) for i in range(0, len(modules), 3)]


def _doubled(image: Tensor) -> Tensor:
    return F.interpolate(image, scale_factor=2.0, mode="nearest")
