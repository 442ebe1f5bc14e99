"""ExtraSSNet (Wu et al. 2023, section 4.4), on the network of Guo et al. 2022: two encoders, one of the rest.

One encoder sees shaded frames (E0 of the paper), the other those whose colour was drawn (E1), with their base
colour beside it; decoder, classes and compositor are shared.
"""

import torch
from torch import Tensor

from supersampler.methods.classifier.spec import NetworkConfig
from supersampler_model.methods.classifier.network import ClassifierNetwork, Encoder, encode


class ExtraSSNetwork(ClassifierNetwork):
    """Which class each packed pixel is of, and how it is to be composed, in frames of two kinds.

    Args:
        config: widths.
        packed: see `ClassifierNetwork`.
        carried: see there.
        surface: channels of a drawn frame's surfaces, packed.
        mixing: see `ClassifierNetwork`.
    """

    def __init__(
        self, config: NetworkConfig, *, packed: int, carried: int, surface: int, mixing: int
    ) -> None:
        super().__init__(config, packed=packed, carried=carried, mixing=mixing)
        self.drawn_encoder = Encoder(packed + carried + surface, config.levels)

    def forward(
        self, packed: Tensor, carried: Tensor, surface: Tensor | None = None
    ) -> tuple[Tensor, Tensor]:
        """Classify and weigh; see `ClassifierNetwork`.

        Args:
            packed: (n, 4 c, h, w).
            carried: (n, d, h, w).
            surface: (n, 4 s, h, w) of drawn frames; None of shaded ones.
        """
        return self.decode(packed, self.encode(packed, carried, surface))

    def encode(self, packed: Tensor, carried: Tensor, surface: Tensor | None = None) -> Tensor:
        """Return what the encoder of these frames finds, the features of its four levels side by side."""
        if surface is None:
            return encode(self.encoder, packed, carried)
        return encode(self.drawn_encoder, packed, carried, surface)

    def begin_drawn_as_shaded(self) -> None:
        """Have the second encoder find in drawn frames what the first would, whatever their surfaces are."""
        begun = self.encoder.state_dict()
        first = next(iter(begun))  # the 1x1 convolution that sees the inputs, those of surfaces last
        own = self.drawn_encoder.state_dict()[first]
        more = own.new_zeros(own.shape[0], own.shape[1] - begun[first].shape[1], 1, 1)
        self.drawn_encoder.load_state_dict({**begun, first: torch.cat([begun[first], more], dim=1)})
