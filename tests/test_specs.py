"""Torch modules, shipped models and kernels agree with the specs of the methods."""

import inspect

import pytest

from supersampler.methods.aovs.spec import AOVS
from supersampler.methods.extrapolation.spec import EXTRAPOLATE_UNSHADED
from supersampler.methods.registry import methods
from supersampler.methods.spec import MethodSpec, constants_of
from supersampler_model.methods import method_class
from supersampler_model.methods.aovs import BlendAovs
from supersampler_model.methods.base import Method
from supersampler_model.methods.extrapolate import UnshadedExtrapolate

ALL: dict[str, type[Method]] = {
    **{name: method_class(name) for name in methods()},
    EXTRAPOLATE_UNSHADED.name: UnshadedExtrapolate,
    AOVS.name: BlendAovs,
}
KERNELS = [spec for spec in methods().values() if spec.cpu]


@pytest.mark.parametrize("name", ALL)
def test_a_step_takes_what_its_spec_names_in_that_order(name: str) -> None:
    spec = ALL[name].spec
    _, *parameters = map(str, inspect.signature(ALL[name].forward).parameters.values())
    names = [parameter.split(":")[0] for parameter in parameters]
    one_by_one = [*spec.inputs, *(f"history_{tensor}" for tensor in spec.history)]
    assert spec.name == name
    if names[-1].startswith("*"):  # the rest, in the order of the spec
        names[-1:] = one_by_one[len(names) - 1 :]
    assert names == one_by_one


@pytest.mark.parametrize("spec", KERNELS, ids=lambda spec: spec.name)
def test_the_default_constants_are_in_their_ranges(spec: MethodSpec) -> None:
    config = vars(spec.config())
    for name, (least, most) in constants_of(spec).items():
        assert least <= config[name] <= most, name
