"""The network of the classifiers on pixels that are not packed."""

import pytest
import torch

from supersampler.methods.classifier.spec import NetworkConfig
from supersampler_model.methods.classifier_network import (
    ClassifierNetwork,
    pack,
    unpack,
)


@pytest.mark.parametrize("channels", [8, 2])
def test_the_network_infers_the_same_from_pixels_as_from_packed_ones(channels: int) -> None:
    torch.manual_seed(0)
    config = NetworkConfig(levels=(8, 8, 32, 64), decoder=8, hidden=8)
    network = ClassifierNetwork(config, packed=12, half_inputs=channels, blend_parameters=3).eval()
    torch.nn.init.normal_(network.blend.weight)
    pixels = torch.rand(1, 3, 32, 48)
    half_inputs = torch.rand(1, channels, 16, 24)
    with torch.no_grad():
        logits, blend = network(pack(pixels), half_inputs)
        logits_of_pixels, blend_of_pixels = network.on_pixels([pixels[:, :1], pixels[:, 1:]], half_inputs)
    torch.testing.assert_close(logits_of_pixels, logits, rtol=1e-4, atol=1e-5)
    torch.testing.assert_close(blend_of_pixels, unpack(blend), rtol=1e-4, atol=1e-5)
