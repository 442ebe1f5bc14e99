"""Torch modules, shipped models and kernels agree with the specs of the methods."""

import dataclasses
import inspect
import json
from pathlib import Path

import pytest

from supersampler.methods.aovs.spec import AOVS
from supersampler.methods.extrapolation.spec import EXTRAPOLATE_UNSHADED
from supersampler.methods.model_file import read_model_info
from supersampler.methods.registry import methods
from supersampler.methods.spec import MethodSpec, constants_of
from supersampler_model.methods import method_class
from supersampler_model.methods.aovs import BlendAovs
from supersampler_model.methods.base import Method
from supersampler_model.methods.extrapolate import UnshadedExtrapolate

ROOT = Path(__file__).parents[1]
MODELS = ROOT / "sdk/supersampler/models"
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


@pytest.mark.parametrize("folder", sorted(path.parent for path in MODELS.rglob("model.json")), ids=str)
def test_a_shipped_model_is_what_its_spec_says(folder: Path) -> None:
    info = read_model_info(folder)
    spec = ALL[info.method].spec
    assert (info.source, info.ratios, info.image.shape) == (spec.source, spec.ratios, spec.image)
    assert tuple(tensor.name for tensor in info.inputs) == spec.inputs
    assert {h.name: h.shape for h in info.history} == spec.graph_history
    assert [h.output for h in info.history] == [f"next.{tensor}" for tensor in spec.history]
    assert tuple(tensor.name for tensor in info.aux_outputs) == spec.aux_outputs
    assert info.maps == spec.maps
    assert info.only_extrapolated == spec.only_extrapolated
    assert list(info.config) == [field.name for field in dataclasses.fields(spec.config)]
    if not (folder / "network.onnx").exists():  # weights come with the constants that they were trained for
        assert info.config == json.loads(json.dumps(dataclasses.asdict(spec.config())))


@pytest.mark.parametrize("spec", KERNELS, ids=lambda spec: spec.name)
def test_the_default_constants_are_in_their_ranges(spec: MethodSpec) -> None:
    config = vars(spec.config())
    for name, (least, most) in constants_of(spec).items():
        assert least <= config[name] <= most, name
