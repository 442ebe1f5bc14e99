"""What a training run begins with is what the shipped weights were trained with."""

import pytest

from supersampler_model.methods import LEARNED
from supersampler_model.methods.weights_file import load_trained, shipped_weights

SHIPPED = [name for name in LEARNED if shipped_weights(name).exists()]


@pytest.mark.parametrize("name", SHIPPED)
def test_the_default_configuration_is_that_of_the_shipped_weights(name: str) -> None:
    shipped = LEARNED[name].of(load_trained(shipped_weights(name)))
    assert LEARNED[name]().config == shipped.config
