"""The network of `extrapolate`: that of Guo et al. 2022 with two encoders (Wu et al. 2023, section 4.4).

One encoder reads shaded frames (E0 of the paper), the other extrapolated frames (E1) with their base colour.
"""

import torch
from torch import Tensor

from supersampler.methods.classifier.spec import NetworkConfig
from supersampler_model.methods.classifier.network import ClassifierNetwork, Encoder, encode


class ExtraSSNetwork(ClassifierNetwork):
    """Classifies packed pixels and infers blend parameters, for shaded and extrapolated frames.

    Args:
        config: widths.
        packed: see `ClassifierNetwork`.
        half_inputs: see `ClassifierNetwork`.
        surface: packed channels of base colour of an extrapolated frame.
        blend_parameters: see `ClassifierNetwork`.
    """

    def __init__(
        self, config: NetworkConfig, *, packed: int, half_inputs: int, surface: int, blend_parameters: int
    ) -> None:
        super().__init__(config, packed=packed, half_inputs=half_inputs, blend_parameters=blend_parameters)
        self.extrapolated_encoder = Encoder(packed + half_inputs + surface, config.levels)

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
        """Copy the encoder of shaded frames to that of extrapolated ones, with zero weights for surfaces."""
        shaded = self.encoder.state_dict()
        first = next(iter(shaded))  # the first 1x1 convolution; its last inputs are the surfaces
        own = self.extrapolated_encoder.state_dict()[first]
        zeros = own.new_zeros(own.shape[0], own.shape[1] - shaded[first].shape[1], 1, 1)
        self.extrapolated_encoder.load_state_dict({**shaded, first: torch.cat([shaded[first], zeros], dim=1)})
