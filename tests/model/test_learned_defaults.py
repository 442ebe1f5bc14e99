"""The registry names all parts of each method; the defaults are the configuration of the shipped weights."""

from typing import Any

import pytest

from supersampler.errors import ArgumentError
from supersampler.methods.model_file import extrapolation_names, model_names
from supersampler.methods.registry import load, methods
from supersampler_model.methods import learned_method, load_method, method_class
from supersampler_model.methods.base import load_trained, shipped_weights


@pytest.mark.parametrize("name", [name for name, spec in methods().items() if spec.weights])
def test_the_default_configuration_is_that_of_the_shipped_weights(name: str) -> None:
    assert learned_method(name)().config == load_method(name).config


def test_weights_of_another_version_are_refused_by_name() -> None:
    trained = load_trained(shipped_weights("classifier-small"))
    config = {"around": [], **trained.config}
    tensors = {name.replace("net.blend.", "net.mixing."): value for name, value in trained.tensors.items()}
    changes: list[dict[str, Any]] = [{"config": config}, {"tensors": tensors}, {"config": {"network": 5}}]
    for change in changes:
        with pytest.raises(ArgumentError, match=r"weights is of another version .*(around|mixing|'int')"):
            learned_method("classifier-small").of(trained._replace(**change))


@pytest.mark.parametrize("name", methods())
def test_every_entry_of_the_registry_exists(name: str) -> None:
    spec = methods()[name]
    assert method_class(name).spec is spec
    assert all(callable(load(entry)) for entry in (spec.task, spec.gpu) if entry)


def test_the_registry_names_all_released_weights_and_all_shipped_models() -> None:
    named = {spec.weights for spec in methods().values() if spec.weights}
    assert named == {path.name for path in shipped_weights("classifier").parent.iterdir()}
    ships = [name for name, spec in methods().items() if spec.ships]
    assert sorted(ships) == sorted([*model_names(), *extrapolation_names()])


def test_an_unknown_or_untrainable_method_is_refused() -> None:
    with pytest.raises(ArgumentError, match="Did you mean 'classifier'"):
        method_class("clasifier")
    with pytest.raises(ArgumentError, match="taau; want one of classifier,"):
        learned_method("taau")
    with pytest.raises(ArgumentError, match="none ship for gbuffer"):
        load_method("gbuffer")
