"""`network.npz` is written only for networks whose sizes the CPU kernels support."""

from dataclasses import replace

import pytest

from supersampler.methods.classifier.spec import ClassifierConfig, NetworkConfig
from supersampler_export.quantize import _fits, cpu_network
from supersampler_model.methods.classifier import Classifier
from supersampler_model.methods.classifier_paper import PaperClassifier
from supersampler_model.methods.taau import Taau

LARGEST = NetworkConfig(levels=(32, 64, 128, 256), decoder=32, decoder_layers=1, hidden=58)


def fits(**widths: object) -> bool:
    return _fits(ClassifierConfig(network=replace(LARGEST, **widths)))  # type: ignore[arg-type]


def test_the_largest_network_fits() -> None:
    assert fits()


@pytest.mark.parametrize(
    "widths",
    [
        {"levels": (48, 64, 128, 256)},
        {"levels": (32, 80, 128, 256)},
        {"levels": (32, 64, 160, 256)},
        {"levels": (32, 64, 128, 320)},
        {"levels": (24, 64, 128, 256)},
        {"levels": (32, 64, 128, 248)},
        {"levels": (32, 64, 128)},
        {"levels": (32, 64, 128, 256, 256)},
        {"decoder": 33},
        {"decoder_layers": 2},
        {"decoder_layers": 0},
        {"hidden": 59},
    ],
)
def test_a_network_that_is_larger_or_of_uneven_widths_does_not(widths: dict[str, object]) -> None:
    assert not fits(**widths)


def test_smaller_networks_fit() -> None:
    assert fits(levels=(16, 16, 16, 16), decoder=8, hidden=1)


@pytest.mark.parametrize("method", [Taau(), PaperClassifier(), Classifier(ClassifierConfig(recurrent=False))])
def test_there_is_none_for_other_methods_and_other_constants(method: object) -> None:
    assert cpu_network(method) is None  # type: ignore[arg-type]
