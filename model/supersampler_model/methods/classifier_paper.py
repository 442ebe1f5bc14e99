"""`classifier-paper`: Guo et al. 2022 as their supplement describes it, for comparison with `classifier`.

Comments mark where the supplement leaves a choice open. The weights are in bench/weights, not in the package;
docs/methods.md lists departures from the supplement.
"""

import itertools
from typing import ClassVar

import torch
from torch import Tensor, nn

from supersampler.methods.classifier.spec import CLASSES, CLASSIFIER_PAPER, NetworkConfig
from supersampler_model import ops
from supersampler_model.methods import classifier_network
from supersampler_model.methods.base import NetworkSubgraph
from supersampler_model.methods.classifier import Classifier, Finished
from supersampler_model.methods.classifier_inputs import Gathered, History, WarpedHistory

PLANES = 20  # section 3: colour 3, depth 1, motion 2, count 1, range 6, depth change 1, classes 6
COMPOSITOR_INPUTS = 14  # colour 3, history 3, classes 6, count 1, depth change 1


class PaperNetwork(nn.Module):
    """Network of section 1: a classifier at half size, a compositor of two 1x1 layers at full size."""

    def __init__(self, config: NetworkConfig) -> None:
        super().__init__()
        self.encoder = classifier_network.Encoder(4 * PLANES, config.levels)
        widths = [self.encoder.out_channels, *[config.decoder] * config.decoder_layers]
        self.decoder = nn.Sequential(
            *(classifier_network.Pointwise(a, b) for a, b in itertools.pairwise(widths))
        )
        self.classes = classifier_network.Pointwise(config.decoder, CLASSES, rectified=False)
        hidden = nn.Conv2d(COMPOSITOR_INPUTS, config.hidden, 1)
        self.compositor = nn.Sequential(hidden, nn.ReLU(), nn.Conv2d(config.hidden, 1, 1), nn.Sigmoid())

    def forward(self, packed: Tensor, half_inputs: Tensor) -> tuple[Tensor, Tensor]:
        """Return the logits (n, 6, h, w), and no blend parameters: the compositor runs in `finish`."""
        del half_inputs
        logits = self.classes(self.decoder(classifier_network.encode(self.encoder, packed)))
        return logits, logits[:, :0]


class PaperClassifier(Classifier):
    """Classify at half size, upsample the logits, blend history and frame by one weight per pixel."""

    spec: ClassVar = CLASSIFIER_PAPER

    def make_network(self) -> nn.Module:
        """Return the network of section 1."""
        return PaperNetwork(self.config.network)

    def subgraph(self) -> NetworkSubgraph | None:
        """Return None: the upsampling between classifier and compositor is part of `finish`."""
        return None

    def gather_history(
        self,
        history: History,
        by_dilated: ops.Reprojection,
        by_own: ops.Reprojection,
        depth: Tensor,
        before: ops.View,
        exposure: Tensor,
        relit: Tensor | None = None,
    ) -> WarpedHistory:
        """Warp the history: count, range and depth by nearest samples, classes bilinearly (section 3)."""
        del by_own, relit
        nearest = (before.to_render(by_dilated.position) + 0.5).floor()
        depth_before = ops.read(history.depth[:, :1], nearest, mode="nearest")
        difference = ops.relative_depth_change(depth_before, depth)  # equation 10
        state = ops.read(history.state, (by_dilated.position + 0.5).floor(), mode="nearest")
        color = ops.read_cubic(history.color, by_dilated.position)  # "similar to TAA"
        toned = self.toned(ops.sanitize(color, 0.0) * exposure)
        return WarpedHistory(
            color=toned,
            rounded=toned,
            detail=torch.zeros_like(toned),
            undilated=toned,
            samples=state[:, :1] * by_dilated.on_screen,
            range=state[:, 1:7],
            glare=torch.zeros_like(state[:, :1]),
            difference=difference.clamp(-1.0, 1.0) * (depth >= 0.0),
            surface=by_dilated.on_screen,
            classes=ops.read(history.classes, by_dilated.position),
        )

    def infer(self, gathered: Gathered) -> tuple[Tensor, Tensor]:
        """Return the logits, and no blend parameters; see `PaperNetwork`."""
        logits, none = self.net(*self.network_inputs(gathered))
        return logits, none

    def network_inputs(self, gathered: Gathered) -> tuple[Tensor, Tensor]:
        """Return the twenty buffers of section 3, packed."""
        warped = gathered.warped
        planes = [
            gathered.current.frame,
            gathered.depth.clamp(min=0.0),
            gathered.reprojection.motion.permute(0, 3, 1, 2) * 0.1,
            1.0 / (warped.samples + 1.0),  # the count itself has no bound
            warped.range,
            warped.difference,
            warped.classes,
        ]
        return classifier_network.pack(torch.cat(planes, dim=1)), warped.classes[:, :0, ::2, ::2]

    def finish(
        self, gathered: Gathered, logits: Tensor, blend: Tensor, resting: Tensor | None = None
    ) -> Finished:
        """Upsample the logits, compute the weight, blend; update sample count and range."""
        del blend, resting  # there are no blend parameters, and no convergence
        current, warped = gathered.current, gathered.warped
        half = ops.size_of(logits)
        grid = ops.grid_of(ops.size_of(current.frame), half, torch.zeros(1, 2, device=logits.device))
        upsampled = ops.resample(logits, *grid.bands(half, ops.linear, reach=1))
        groups = upsampled[:, :3], upsampled[:, 3:]
        classes = torch.cat([classifier_network.class_probabilities(group) for group in groups], dim=1)

        known = (warped.samples > 0.0).float()
        count = 1.0 / (warped.samples + 1.0)
        weight: Tensor = self.net.get_submodule("compositor")(
            torch.cat([current.frame, warped.color, classes, count, warped.difference], dim=1)
        )
        weight = weight * known * (1.0 - gathered.reactive)  # of the history (WO 2024/043984)
        color = current.frame + weight * (warped.color - current.frame)
        image = ops.bounded(ops.TONES[self.config.tone_space].inverse(color) / gathered.exposure)

        occluded = (classes[:, 1:2] > torch.maximum(classes[:, :1], classes[:, 2:3])).float()
        kept = known * (1.0 - occluded) * (1.0 - gathered.reactive)
        next_count = warped.samples * kept + 1.0
        now = current.frame
        low, high = warped.range[:, :3], warped.range[:, 3:]
        rate = self.config.contraction  # without it the range would only grow
        low = torch.minimum(low, now) + rate * (now - low).clamp(min=0.0)
        high = torch.maximum(high, now) - rate * (high - now).clamp(min=0.0)
        point = torch.cat([now, now], dim=1)  # the range of this frame alone
        range_ = point + kept * (torch.cat([low, high], dim=1) - point)
        state = torch.cat([next_count, range_], dim=1)
        return Finished(*(ops.cut_to(plane, gathered.display) for plane in (image, state, classes, weight)))
