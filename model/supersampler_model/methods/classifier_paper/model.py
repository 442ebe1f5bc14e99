"""`classifier-paper`: Guo et al. 2022 as their supplement describes it, to measure `classifier` against.

What the supplement leaves open is said at the line.
"""

import itertools
from typing import ClassVar

import torch
from torch import Tensor, nn

from supersampler.methods.classifier.spec import CLASSES, CLASSIFIER_PAPER, NetworkConfig
from supersampler_model.methods.base import Fused
from supersampler_model.methods.classifier.buffers import Finished, Gathered, History, Remembered
from supersampler_model.methods.classifier.model import Classifier
from supersampler_model.methods.classifier.network import (
    Encoder,
    Pointwise,
    cut_to,
    pack,
    padded,
    shares,
)
from supersampler_model.ops.color import TONES, bounded, sanitize
from supersampler_model.ops.motion import Past, read, read_cubic
from supersampler_model.ops.sampling import View, linear, positions, resample, taps

PLANES = 20  # section 3: colour 3, depth 1, motion 2, counter 1, range 6, difference 1, classes 6
PIXEL = 14  # what the compositor sees: colour 3, past 3, classes 6, counter 1, difference 1


class PaperNetwork(nn.Module):
    """Section 1: classifier at half size, compositor of two pixel-wise layers at full size."""

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        self.encoder = Encoder(4 * PLANES, config.levels)
        widths = [self.encoder.out_channels, *[config.decoder] * config.decoder_layers]
        self.decoder = nn.Sequential(*(Pointwise(a, b) for a, b in itertools.pairwise(widths)))
        self.classes = Pointwise(config.decoder, CLASSES, rectified=False)
        self.compositor = nn.Sequential(
            nn.Conv2d(PIXEL, config.hidden, 1), nn.ReLU(), nn.Conv2d(config.hidden, 1, 1), nn.Sigmoid()
        )

    def forward(self, packed: Tensor, carried: Tensor) -> tuple[Tensor, Tensor]:
        """Logits (n, 6, h, w), twice: nothing is decided of single pixels here."""
        del carried
        logits = self.classes(self.decoder(cut_to(self.encoder(padded(packed)), packed)))
        return logits, logits


class PaperClassifier(Classifier):
    """Classify at half size, upsample the logits, blend by one weight a pixel."""

    spec: ClassVar = CLASSIFIER_PAPER

    def make_network(self) -> nn.Module:
        """The network of section 1."""
        return PaperNetwork(self.config.network)

    def fused(self) -> Fused | None:
        """None: the compositor works on what the classifier's logits are upsampled to."""
        return None

    def gather_past(
        self, history: History, past: Past, own: Past, depth: Tensor, before: View, exposure: Tensor
    ) -> Remembered:
        """Warp the history: counter, range and depth as they are nearest, logits bilinear (section 3)."""
        del own
        x, y = before.to_render(past.x, past.y)
        there = read(history.depth[:, :1], (x + 0.5).floor(), (y + 0.5).floor(), mode="nearest")
        difference = (there - depth) / torch.maximum(there, depth).clamp(min=1e-12)  # equation 10
        state = read(history.state, (past.x + 0.5).floor(), (past.y + 0.5).floor(), mode="nearest")
        color = read_cubic(history.color, past.x, past.y)  # "similar to TAA"
        toned = self.toned(sanitize(color, 0.0) * exposure)
        return Remembered(
            color=toned,
            detail=torch.zeros_like(toned),
            own=toned,
            samples=state[:, :1] * past.on_screen,
            range=state[:, 1:7],
            glare=torch.zeros_like(state[:, :1]),
            difference=difference.clamp(-1.0, 1.0) * (depth >= 0.0),
            surface=past.on_screen,
            classes=read(history.classes, past.x, past.y),
        )

    def seen(self, gathered: Gathered) -> tuple[Tensor, Tensor]:
        """The twenty buffers of section 3, packed; the classes of the frame before are among them."""
        past = gathered.past
        planes = [
            gathered.present.frame,
            gathered.depth.clamp(min=0.0),
            gathered.there.motion * 0.1,
            1.0 / (past.samples + 1.0),  # the count itself has no bound
            past.range,
            past.difference,
            past.classes,
        ]
        return pack(torch.cat(planes, dim=1)), past.classes[:, :0, ::2, ::2]

    def finish(self, gathered: Gathered, logits: Tensor, mixing: Tensor) -> Finished:
        """Upsample the logits, weigh, blend; update counter and range."""
        del mixing
        present, past = gathered.present, gathered.past
        height, width = present.frame.shape[2], present.frame.shape[3]
        none = torch.zeros(1, device=logits.device)
        x = taps(positions(width, logits.shape[3], none), logits.shape[3], linear, reach=1)
        y = taps(positions(height, logits.shape[2], none), logits.shape[2], linear, reach=1)
        upsampled = resample(logits, x, y)
        classes = torch.cat([shares(upsampled[:, :3]), shares(upsampled[:, 3:])], dim=1)

        known = (past.samples > 0.0).float()
        count = 1.0 / (past.samples + 1.0)
        weight: Tensor = self.net.get_submodule("compositor")(
            torch.cat([present.frame, past.color, classes, count, past.difference], dim=1)
        )
        weight = weight * known  # of the past (WO 2024/043984)
        color = present.frame + weight * (past.color - present.frame)
        image = bounded(TONES[self.config.tone_space].inverse(color) / gathered.exposure)

        hidden = (classes[:, 1:2] > torch.maximum(classes[:, :1], classes[:, 2:3])).float()
        kept = known * (1.0 - hidden)
        counter = past.samples * kept + 1.0  # 0 says that there is no past
        now = present.frame
        low, high = past.range[:, :3], past.range[:, 3:]
        share = self.config.contraction  # without it the range would only grow
        low = torch.minimum(low, now) + share * (now - low).clamp(min=0.0)
        high = torch.maximum(high, now) - share * (high - now).clamp(min=0.0)
        both = torch.cat([now, now], dim=1)
        range_ = both + kept * (torch.cat([low, high], dim=1) - both)
        return Finished(image, torch.cat([counter, range_], dim=1), classes, weight)
