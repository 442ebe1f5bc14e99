"""`extrapolate`: upscales shaded frames and frames whose colour was drawn, on one history (Wu et al. 2023).

All around the network is the `classifier`'s, and so is the network, but that there are two encoders: one sees
shaded frames, the other drawn ones, whose base colour it sees as well. Drawn samples lie where shaded ones
would, and are wrong in other ways: an encoder of their own learns how far to trust them (section 4.4). The
paper's second one sees the warped colour and the refined one apart; ours sees what equation 5 makes of both.
"""

from typing import ClassVar, Self

from torch import Tensor, nn

from supersampler.errors import ArgumentError
from supersampler.methods.classifier.spec import CLASSES
from supersampler.methods.extrapolation.spec import EXTRAPOLATE, EXTRAPOLATE_UNSHADED
from supersampler.methods.spec import HALF
from supersampler_model.methods.base import Fused, display_size_of, render_size_of
from supersampler_model.methods.classifier.buffers import History
from supersampler_model.methods.classifier.model import Classifier
from supersampler_model.methods.classifier.network import pack
from supersampler_model.methods.classifier.small import SmallClassifier
from supersampler_model.methods.extrapolation.network import ExtraSSNetwork
from supersampler_model.methods.weights_file import Trained
from supersampler_model.ops.color import finite
from supersampler_model.ops.sampling import View, pick

SURFACE = 3
"""Channels of a drawn pixel's surface that the network sees: base colour."""


class TwoEncoders(Classifier):
    """The weights that both kinds of frames are stepped on with."""

    net: ExtraSSNetwork

    def make_network(self) -> nn.Module:
        """Return the network, untrained."""
        c = self.config
        return ExtraSSNetwork(
            c.network, packed=4 * c.planes, carried=c.carried, surface=4 * SURFACE, mixing=c.blend_parameters
        )


class Extrapolate(TwoEncoders):
    """Steps on shaded frames; `on_extrapolated` returns what steps on the others."""

    spec: ClassVar = EXTRAPOLATE

    @classmethod
    def begun(cls, trained: Trained) -> Self:
        """Return the method as it is before any training: it draws what a classifier draws, of either kind.

        Args:
            trained: weights of `classifier` or `classifier-small`, whose width the method then has.

        Raises:
            ArgumentError: they are of another method.
        """
        names = (Classifier.name, SmallClassifier.name)
        if trained.method not in names:
            raise ArgumentError("weights", got=f"of {trained.method}", want=f"of {' or '.join(names)}")
        method = cls.configured(trained.config)
        method.load_state_dict(trained.tensors, strict=False)
        method.net.begin_drawn_as_shaded()
        method.learned = trained.facts
        return method.eval()

    def on_extrapolated(self) -> "DrawnExtrapolate":
        """Return what steps on drawn frames, with these weights."""
        drawn = DrawnExtrapolate(self.config)
        drawn.load_state_dict(self.state_dict())
        drawn.learned = dict(self.learned)
        return drawn.eval()


class DrawnExtrapolate(TwoEncoders):
    """Steps on frames whose colour was drawn: `extrapolate` with its other encoder."""

    spec: ClassVar = EXTRAPOLATE_UNSHADED

    def fused(self) -> Fused:
        """See `Classifier`; the third input is base colour, packed."""
        c = self.config
        inputs = {
            "packed": (1, 4 * c.planes, *HALF),
            "carried": (1, c.carried, *HALF),
            "surface": (1, 4 * SURFACE, *HALF),
        }
        return Fused(
            self.net, inputs, {"logits": (1, CLASSES, *HALF), "mixing": (1, 4 * c.blend_parameters, *HALF)}
        )

    def forward(  # type: ignore[override]  # it asks for one input more
        self,
        color: Tensor,  # (1, 3, h, w) linear RGB, drawn
        depth: Tensor,  # (1, 1, h, w) reversed
        motion: Tensor,  # (1, 2, h, w) render pixels, previous minus current
        jitter: Tensor,  # (1, 2) render pixels
        exposure: Tensor,  # (1,) 0: measure
        display_size: Tensor,  # (2,) int64
        gbuffer_base_color: Tensor,  # (1, 3, h, w)
        history_color: Tensor,  # (1, 3, H, W)
        history_state: Tensor,  # (1, 3, H, W)
        history_classes: Tensor,  # (1, 6, H / 2, W / 2)
        history_depth: Tensor,  # (1, 2, h', w')
        history_jitter: Tensor,  # (1, 2)
        history_exposure: Tensor,  # (1,)
    ) -> tuple[Tensor, ...]:
        """Return what `Classifier.forward` does."""
        display = display_size_of(display_size)
        now = View(display, render_size_of(color), jitter)
        before = View(display, render_size_of(history_depth), history_jitter)
        history = History(history_color, history_state, history_classes, history_depth, history_exposure)
        gathered = self.gather(color, depth, motion, exposure, history, now, before)
        logits, mixing = self.net(*self.seen(gathered), surface_of(gbuffer_base_color, now))
        return self.left(gathered, logits, mixing, jitter)


def surface_of(base_color: Tensor, view: View) -> Tensor:
    """(1, 4 SURFACE, H / 2, W / 2) base colour of each pixel's nearest sample, its square root, packed.

    Args:
        base_color: (1, 3, h, w), of which what is no number counts as black.
        view: where its samples lie.
    """
    known = finite(base_color).clamp(0.0, 1.0)
    return pack(pick(known, view.grid(render_size_of(base_color))).sqrt())
