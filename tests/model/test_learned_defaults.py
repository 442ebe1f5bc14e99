"""What a training run begins with is what the shipped weights were trained with."""

import pytest

from supersampler.errors import ArgumentError
from supersampler.methods import catalog
from supersampler_model.methods import LEARNED, METHODS
from supersampler_model.methods.weights_file import load_trained, shipped_weights
from supersampler_model.training.tasks import TASKS

SHIPPED = [name for name in LEARNED if shipped_weights(name).exists()]


@pytest.mark.parametrize("name", SHIPPED)
def test_the_default_configuration_is_that_of_the_shipped_weights(name: str) -> None:
    shipped = LEARNED[name].of(load_trained(shipped_weights(name)))
    assert LEARNED[name]().config == shipped.config


def test_weights_of_another_version_are_refused_by_name() -> None:
    trained = load_trained(shipped_weights("classifier-small"))
    config = {"around": [], **trained.config}
    tensors = {name.replace("net.blend.", "net.mixing."): value for name, value in trained.tensors.items()}
    for old in (trained._replace(config=config), trained._replace(tensors=tensors)):
        with pytest.raises(ArgumentError, match=r"weights is of another version .*(around|mixing)"):
            LEARNED["classifier-small"].of(old)


def test_the_catalog_of_the_sdk_says_of_each_method_what_it_is() -> None:
    assert {*catalog.FIXED} == {*METHODS}
    assert {*catalog.LEARNED} == {*LEARNED} == {*TASKS}
    assert {*catalog.UNTRAINED} == {*LEARNED} - {*SHIPPED}
    for name, spec in {**catalog.FIXED, **catalog.LEARNED}.items():
        assert spec is {**METHODS, **LEARNED}[name].spec
