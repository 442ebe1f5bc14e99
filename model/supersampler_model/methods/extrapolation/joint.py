"""`extrapolate`: upscales shaded and extrapolated frames on one history (Wu et al. 2023).

All stages but the network are those of `classifier`. The network has two encoders: one for shaded frames, one
for extrapolated frames, which also reads their base colour. Extrapolated colours have other errors than
shaded ones; their own encoder learns how far to trust them (section 4.4). The paper's second encoder reads
the warped and the refined colour; ours reads their combination by equation 5.
"""

from typing import ClassVar, Self

from torch import Tensor, nn

from supersampler.errors import ArgumentError
from supersampler.methods.extrapolation.spec import EXTRAPOLATE, EXTRAPOLATE_UNSHADED
from supersampler.methods.spec import HALF
from supersampler_model.methods.base import Fused
from supersampler_model.methods.classifier.model import Classifier
from supersampler_model.methods.classifier.network import pack, unpack
from supersampler_model.methods.classifier.small import SmallClassifier
from supersampler_model.methods.extrapolation.network import ExtraSSNetwork
from supersampler_model.methods.weights_file import Trained
from supersampler_model.ops.color import finite, valid
from supersampler_model.ops.compositing import reactive_at
from supersampler_model.ops.sampling import View, pick
from supersampler_model.ops.size import render_size_of

SURFACE = 3
"""Channels of an extrapolated pixel's surface in the network inputs: base colour."""


class TwoEncoders(Classifier):
    """`Classifier` with a network for both kinds of frames."""

    net: ExtraSSNetwork

    def make_network(self) -> nn.Module:
        """Return the untrained network."""
        c = self.config
        return ExtraSSNetwork(
            c.network,
            packed=4 * c.planes,
            half_inputs=c.half_inputs,
            surface=4 * SURFACE,
            blend_parameters=c.blend_parameters,
        )


class Extrapolate(TwoEncoders):
    """Steps on shaded frames; `on_extrapolated` returns the method for extrapolated ones."""

    spec: ClassVar = EXTRAPOLATE

    @classmethod
    def from_classifier(cls, trained: Trained) -> Self:
        """Return the method before its training: both encoders have the classifier's weights.

        Args:
            trained: weights of `classifier` or `classifier-small`, whose widths the method takes.

        Raises:
            ArgumentError: they are of another method.
        """
        names = (Classifier.name, SmallClassifier.name)
        if trained.method not in names:
            raise ArgumentError("weights", got=f"of {trained.method}", want=f"of {' or '.join(names)}")
        method = cls.configured(trained.config)
        method.load_state_dict(trained.tensors, strict=False)
        method.net.copy_shaded_encoder()
        method.learned = trained.facts
        return method.eval()

    def on_extrapolated(self) -> "UnshadedExtrapolate":
        """Return the method for extrapolated frames, with these weights."""
        unshaded = UnshadedExtrapolate(self.config)
        unshaded.load_state_dict(self.state_dict())
        unshaded.learned = dict(self.learned)
        return unshaded.eval()


class UnshadedExtrapolate(TwoEncoders):
    """Steps on extrapolated frames: `extrapolate` with its other encoder."""

    spec: ClassVar = EXTRAPOLATE_UNSHADED

    def fused(self) -> Fused | None:
        """See `Classifier`; the third input is packed base colour."""
        fused = super().fused()
        return fused and fused._replace(inputs={**fused.inputs, "surface": (1, 4 * SURFACE, *HALF)})

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
        history_tensors, now, before = self.group_history(history, color, jitter, display_size)
        gathered = self.gather(color, depth, motion, exposure, history_tensors, now, before)
        gathered = gathered._replace(reactive=reactive_at(reactive, valid(color), gathered.grid))
        surface = packed_base_color(gbuffer_base_color, now).to(self.dtype)
        logits, blend = self.net(*self.network_inputs(gathered), surface)
        return self.step_outputs(gathered, logits, unpack(blend), jitter)


def packed_base_color(base_color: Tensor, view: View) -> Tensor:
    """Return the square root of the nearest sample's base colour, packed: (1, 4 SURFACE, H / 2, W / 2).

    Args:
        base_color: (1, 3, h, w); NaN and Inf count as black.
        view: of the display.
    """
    known = finite(base_color).clamp(0.0, 1.0)
    return pack(pick(known, view.grid(render_size_of(base_color), aligned=True)).sqrt())
