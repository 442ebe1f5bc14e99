"""The network of the classifiers on pixels that are not packed."""

import pytest
import torch

from supersampler.methods.classifier.spec import NetworkConfig
from supersampler_model.methods.classifier.network import (
    ClassifierNetwork,
    pack,
    padded,
    padded_pixels,
    unpack,
)

SIZES = [(16, 32), (31, 20), (1, 1), (36, 50)]


@pytest.mark.parametrize(("height", "width"), SIZES)
def test_padded_pixels_are_those_of_padded_packed_pixels(height: int, width: int) -> None:
    image = torch.rand(1, 2, height, width)
    torch.testing.assert_close(pack(padded_pixels(image)), padded(pack(image)), rtol=0.0, atol=0.0)


@pytest.mark.parametrize(("height", "width"), SIZES)
def test_the_network_infers_the_same_from_pixels_as_from_packed_ones(height: int, width: int) -> None:
    torch.manual_seed(0)
    config = NetworkConfig(levels=(8, 8, 32, 64), decoder=8, hidden=8)
    network = ClassifierNetwork(config, packed=12, half_inputs=2, blend_parameters=3).eval()
    torch.nn.init.normal_(network.blend.weight)
    pixels = torch.rand(1, 3, height, width)
    half_inputs = torch.rand(1, 2, (height + 1) // 2, (width + 1) // 2)
    with torch.no_grad():
        logits, blend = network(pack(pixels), half_inputs)
        logits_of_pixels, blend_of_pixels = network.on_pixels(pixels, half_inputs)
    torch.testing.assert_close(logits_of_pixels, logits, rtol=1e-4, atol=1e-5)
    torch.testing.assert_close(
        unpack(blend_of_pixels, height, width), unpack(blend, height, width), rtol=1e-4, atol=1e-5
    )
