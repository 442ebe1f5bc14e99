"""What a method is stands in its spec.py alone; all other code reads it there."""

import ast
import dataclasses
import inspect
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from supersampler.methods.aovs.spec import AOVS
from supersampler.methods.extrapolation.spec import EXTRAPOLATE_UNSHADED
from supersampler.methods.model_file import read_model_info
from supersampler.methods.registry import methods
from supersampler.methods.spec import MethodSpec, constant_indices, constants_array, constants_of
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
PACKAGES = ("sdk/supersampler", "model/supersampler_model", "export/supersampler_export")
SHARED_SPEC = Path("sdk/supersampler/methods/at_rest.py")  # of methods that converge
METHOD_FOLDERS = ("model/supersampler_model/methods",)
KERNELS = [spec for spec in methods().values() if spec.cpu]
FACTS = {field.name for field in dataclasses.fields(MethodSpec)}
CONSTANTS = {field.name for spec in KERNELS for field in dataclasses.fields(spec.config)}
HISTORY = {name for method in ALL.values() for name in method.spec.history}
EXTENTS = {"RENDER", "PREVIOUS", "SHADED", "EARLIER", "BETWEEN", "DISPLAY", "HALF"}
TEXT_OF_EXTENTS = {f"{name.lower()}_{side}" for name in EXTENTS for side in ("height", "width")}


def modules(*folders: str) -> Iterator[tuple[Path, ast.Module]]:
    """Yield every module in these folders but the specs themselves."""
    for folder in folders:
        for file in sorted((ROOT / folder).rglob("*.py")):
            if file.name != "spec.py" and file.relative_to(ROOT) != SHARED_SPEC:
                yield file.relative_to(ROOT), ast.parse(file.read_text("utf-8"))


def facts_of_classes(tree: ast.Module) -> Iterator[str]:
    """Yield facts and constants that a class body gives a value."""
    for body in (node.body for node in ast.walk(tree) if isinstance(node, ast.ClassDef)):
        for part in body:
            if isinstance(part, ast.Assign) or (isinstance(part, ast.AnnAssign) and part.value):
                targets = part.targets if isinstance(part, ast.Assign) else [part.target]
                names = {n.id for t in targets for n in ast.walk(t) if isinstance(n, ast.Name)}
                yield from sorted(names & (FACTS | CONSTANTS))


def lists_of_constants(tree: ast.Module) -> Iterator[str]:
    """Yield lists of three constants or more, by name ("gamma") or as indices (GAMMA)."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Tuple | ast.List | ast.Set):
            texts = {part.value for part in node.elts if isinstance(part, ast.Constant)}
            indices = {p.id.lower() for p in node.elts if isinstance(p, ast.Name) and p.id.isupper()}
            if len((texts | indices) & CONSTANTS) >= 3:
                yield ast.unparse(node)


def shapes_of_history(tree: ast.Module) -> Iterator[str]:
    """Yield dictionaries from names of history tensors to shapes."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Dict):
            keys = {k.value for k in node.keys if isinstance(k, ast.Constant) and isinstance(k.value, str)}
            spread = [s for v in node.values for s in ast.walk(v) if isinstance(s, ast.Starred)]
            used = {n.id for s in spread for n in ast.walk(s) if isinstance(n, ast.Name)}
            prefixed = any(key.startswith("history.") for key in keys)
            if (prefixed or len(keys & HISTORY) >= 2) and used & EXTENTS:
                yield ast.unparse(node)


def names_of_extents(tree: ast.Module) -> Iterator[str]:
    """Yield names of free extents, such as "render_height"."""
    texts = (node.value for node in ast.walk(tree) if isinstance(node, ast.Constant))
    yield from (text for text in texts if isinstance(text, str) and text in TEXT_OF_EXTENTS)


RULES = (
    (
        facts_of_classes,
        METHOD_FOLDERS,
        "class Taau:\n    ratios: ClassVar = (1.0, 4.0)\n    gamma_still = 1.3",
    ),
    (
        lists_of_constants,
        PACKAGES,
        "A = ('gamma', 'samples', 'contraction')\nW, GAMMA, SAMPLES, CONTRACTION = range(4)",
    ),
    (
        shapes_of_history,
        PACKAGES,
        "A = {'history.color': (1, 3, *DISPLAY)}\nB = {'color': (1, 3, *DISPLAY), 'jitter': (1, 2)}",
    ),
    (names_of_extents, PACKAGES, "A = ('render_height', 'half_width')"),
)
"""Each: what finds them, where, and two that it has to find."""


@pytest.mark.parametrize("rule", RULES, ids=lambda rule: rule[0].__name__)
def test_no_fact_of_a_method_is_written_outside_of_specs(rule: tuple[Any, tuple[str, ...], str]) -> None:
    find, folders, wrong = rule
    assert [(str(file), found) for file, tree in modules(*folders) for found in find(tree)] == []
    assert len(list(find(ast.parse(wrong)))) == 2, "the rule finds nothing"


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
    assert {h.input.name: h.input.shape for h in info.history} == spec.graph_history
    assert [h.output for h in info.history] == [f"next.{tensor}" for tensor in spec.history]
    assert tuple(tensor.name for tensor in info.aux_outputs) == spec.aux_outputs
    assert info.maps == spec.maps
    assert info.only_extrapolated == spec.only_extrapolated
    assert list(info.config) == [field.name for field in dataclasses.fields(spec.config)]
    if not (folder / "network.onnx").exists():  # weights come with the constants that they were trained for
        assert info.config == json.loads(json.dumps(dataclasses.asdict(spec.config())))


@pytest.mark.parametrize("spec", KERNELS, ids=lambda spec: spec.name)
def test_kernels_find_each_constant_where_its_array_has_it(spec: MethodSpec) -> None:
    config = {name: float(place) for place, name in enumerate(vars(spec.config()))}
    array, indices = constants_array(spec, config), constant_indices(spec)
    assert array.dtype == np.float32
    assert len(array) == len(indices) > 0
    assert {name: array[getattr(indices, name)] for name in constants_of(spec)} == {
        name: config[name] for name in constants_of(spec)
    }


@pytest.mark.parametrize("spec", KERNELS, ids=lambda spec: spec.name)
def test_the_default_constants_are_in_their_ranges(spec: MethodSpec) -> None:
    config = vars(spec.config())
    for name, (least, most) in constants_of(spec).items():
        assert least <= config[name] <= most, name
