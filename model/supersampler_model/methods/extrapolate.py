"""`extrapolate`: upscales shaded and extrapolated frames on one history (Wu et al. 2023).

The stages are those of `classifier`, except for the network. The network has two encoders (section 4.4): one
for shaded frames (E0 in the paper), and one for extrapolated frames (E1), which also reads their base colour.
The errors of extrapolated colours differ from those of shaded ones; E1 learns how far to trust them. In the
paper, E1 reads the warped and the refined colour; here, it reads their combination by equation 5.
"""

from typing import ClassVar, Self

import torch
from torch import Tensor

from supersampler.errors import ArgumentError
from supersampler.methods.classifier.spec import NetworkConfig
from supersampler.methods.extrapolation.spec import EXTRAPOLATE, EXTRAPOLATE_UNSHADED
from supersampler.methods.spec import HALF
from supersampler_model import ops
from supersampler_model.methods.base import NetworkSubgraph, Trained, config_of
from supersampler_model.methods.classifier import Classifier, SmallClassifier
from supersampler_model.methods.classifier_network import ClassifierNetwork, Encoder, encode, pack, unpack

SURFACE = 3  # channels of an extrapolated pixel's surface in the network inputs: base colour


class ExtraSSNetwork(ClassifierNetwork):
    """`ClassifierNetwork` for both kinds of frames; extrapolated ones also have packed surfaces."""

    def __init__(self, config: NetworkConfig, *, packed: int, half_inputs: int, **outputs: int) -> None:
        super().__init__(config, packed=packed, half_inputs=half_inputs, **outputs)
        self.extrapolated_encoder = Encoder(packed + half_inputs + 4 * SURFACE, config.levels)

    def forward(
        self, packed: Tensor, half_inputs: Tensor, surface: Tensor | None = None
    ) -> tuple[Tensor, Tensor]:
        """Infer classes and blend parameters; see `ClassifierNetwork`.

        Args:
            packed: (n, 4 c, h, w).
            half_inputs: (n, d, h, w).
            surface: (n, 4 s, h, w) of extrapolated frames; None: the frames are shaded.
        """
        return self.decode(packed, self.encode(packed, half_inputs, surface))

    def encode(self, packed: Tensor, half_inputs: Tensor, surface: Tensor | None = None) -> Tensor:
        """Return the features of the encoder for this kind of frame, its four levels concatenated."""
        if surface is None:
            return encode(self.encoder, packed, half_inputs)
        return encode(self.extrapolated_encoder, packed, half_inputs, surface)

    def copy_shaded_encoder(self) -> None:
        """Copy the weights of the encoder of shaded frames to the other one; surfaces get weights of 0."""
        shaded = self.encoder.state_dict()
        first = next(iter(shaded))  # the first 1x1 convolution; its last inputs are the surfaces
        own = self.extrapolated_encoder.state_dict()[first]
        zeros = own.new_zeros(own.shape[0], own.shape[1] - shaded[first].shape[1], 1, 1)
        self.extrapolated_encoder.load_state_dict({**shaded, first: torch.cat([shaded[first], zeros], dim=1)})


class TwoEncoders(Classifier):
    """`Classifier` with a network for both kinds of frames."""

    net: ExtraSSNetwork
    network_class: ClassVar = ExtraSSNetwork


class Extrapolate(TwoEncoders):
    """Steps on shaded frames; `on_extrapolated` returns the method for extrapolated ones."""

    spec: ClassVar = EXTRAPOLATE

    @classmethod
    def from_classifier(cls, trained: Trained) -> Self:
        """Return the method before its training: both encoders have the classifier's weights and widths.

        Raises:
            ArgumentError: the weights are of neither `classifier` nor `classifier-small`.
        """
        names = (Classifier.name, SmallClassifier.name)
        if trained.method not in names:
            raise ArgumentError("weights", got=f"of {trained.method}", want=f"of {' or '.join(names)}")
        method = cls(config_of(cls.spec.config, trained.config))
        method.load_state_dict(trained.tensors, strict=False)
        method.net.copy_shaded_encoder()
        method.provenance = trained.facts
        return method.eval()

    def on_extrapolated(self) -> "UnshadedExtrapolate":
        """Return the method for extrapolated frames, with these weights."""
        unshaded = UnshadedExtrapolate(self.config)
        unshaded.load_state_dict(self.state_dict())
        unshaded.provenance = dict(self.provenance)
        return unshaded.eval()


class UnshadedExtrapolate(TwoEncoders):
    """Steps on extrapolated frames: `extrapolate` with the other encoder."""

    spec: ClassVar = EXTRAPOLATE_UNSHADED

    def subgraph(self) -> NetworkSubgraph | None:
        """Return the network of `Classifier` with a third input, the packed base colour."""
        found = super().subgraph()
        return found and found._replace(inputs={**found.inputs, "surface": (1, 4 * SURFACE, *HALF)})

    def compute(  # type: ignore[override]  # one more input
        self,
        color: Tensor,  # (1, 3, h, w) linear RGB, extrapolated
        depth: Tensor,  # (1, 1, h, w) reversed
        motion: Tensor,  # (1, 2, h, w) render pixels, previous minus current
        reactive: Tensor,  # (1, 1, h, w) in [0, 1]
        jitter: Tensor,  # (1, 2) render pixels
        exposure: Tensor,  # (1,) 0: measure
        display_size: Tensor,  # (2,) int64
        gbuffer_base_color: Tensor,  # (1, 3, h, w)
        *history: Tensor,  # as in `Classifier.history`
    ) -> tuple[Tensor, ...]:
        """Return the results of `Classifier.compute`."""
        grouped, now, before = self.group_history(history, color, jitter, display_size)
        gathered = self.gather(color, depth, motion, exposure, grouped, now, before)
        gathered = gathered._replace(reactive=ops.reactive_at(reactive, ops.valid(color), gathered.grid))
        surface = packed_base_color(gbuffer_base_color, now).to(self.dtype)
        logits, blend = self.net(*self.network_inputs(gathered), surface)
        return self.step_outputs(gathered, logits, unpack(blend), jitter)


def packed_base_color(base_color: Tensor, view: ops.View) -> Tensor:
    """Return the square root of the nearest sample's base colour, packed: (1, 4 SURFACE, H / 2, W / 2).

    Args:
        base_color: (1, 3, h, w); NaN and Inf count as black.
        view: view of the display.
    """
    known = ops.finite(base_color).clamp(0.0, 1.0)
    return pack(view.grid(ops.size_of(base_color), aligned=True).pick(known).sqrt())
