"""Shipped graphs have the operators and constants of freshly traced ones."""

import hashlib
import json
import os
from collections import Counter
from collections.abc import Callable, Iterable
from functools import partial
from pathlib import Path
from typing import Any

import onnx
import pytest
from onnxscript import rewriter

from supersampler.methods.model_file import find_model, model_names
from supersampler.methods.registry import methods
from supersampler_export.folder import aovs_graph
from supersampler_export.graph import export_graph
from supersampler_model.methods import load_method

SHIPPED = [name for name, spec in methods().items() if spec.ships]
ALL = "SUPERSAMPLER_TRACES" in os.environ
TRACED = SHIPPED if ALL else ["bilinear", "bicubic", "taau", "classifier"]
"""`make traces` takes all. Tracing takes 20 to 70 seconds: a graph is traced only where a source of it is not
the recorded one. Of the other methods, test_export compares the images with torch."""
RECORD = Path(__file__).with_name("traced.json")
"""Hash of the sources at the last trace that gave the shipped graph, by name; `make traces` writes it."""
ROOT = Path(__file__).parents[2]
SOURCES = (
    "pyproject.toml", "model/supersampler_model/methods", "model/supersampler_model/ops",
    "export/supersampler_export", "sdk/supersampler/conventions", "sdk/supersampler/methods",
)  # fmt: skip


def sources_of(graphs: Iterable[Path]) -> str:
    """Return a hash of all that a trace and its result depend on."""
    made = hashlib.sha256()
    for place in map(ROOT.joinpath, SOURCES):
        for path in [place] if place.is_file() else sorted(place.rglob("*.py")):
            made.update(path.relative_to(ROOT).as_posix().encode() + path.read_bytes())
    for path in graphs:
        made.update(path.read_bytes())
    return made.hexdigest()


def is_recorded(name: str, sources: str) -> bool:
    return not ALL and json.loads(RECORD.read_text()).get(name) == sources


def record(name: str, sources: str) -> None:
    if ALL:
        RECORD.write_text(json.dumps(json.loads(RECORD.read_text()) | {name: sources}, indent=1) + "\n")


@pytest.fixture(autouse=True)
def _match_slices_with_slices_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """The rule SlicesSplit compares every node with every Slice: a third of the time of a trace."""
    for rule in rewriter._DEFAULT_REWRITE_RULES:
        if rule.name == "SlicesSplit":
            monkeypatch.setattr(rule, "try_rewrite", partial(_rewrite_a_slice, rule.try_rewrite))


def _rewrite_a_slice(rewrite: Callable[..., Any], model: Any, graph: Any, node: Any, **options: Any) -> Any:
    return rewrite(model, graph, node, **options) if node.op_type == "Slice" else None


def structure(model: onnx.ModelProto) -> tuple[Counter[str], list[Any]]:
    """Return operators and constants, without names; of weights their shapes, as folding them rounds."""
    arrays = [onnx.numpy_helper.to_array(t) for t in model.graph.initializer]
    constants = [array.tolist() if array.size <= 16 else array.shape for array in arrays]
    return Counter(node.op_type for node in model.graph.node), sorted(constants, key=str)


@pytest.mark.parametrize("name", TRACED)
def test_the_shipped_graph_is_what_the_exporter_writes_today(name: str) -> None:
    folder = find_model(name)
    sources = sources_of([folder / "step.onnx"])
    if is_recorded(name, sources):
        return
    fresh = export_graph(load_method(name))
    hint = f"run: supersampler export {name} -o {folder}"
    assert structure(onnx.load(folder / "step.onnx")) == structure(fresh), hint
    record(name, sources)


def test_what_carries_channels_along_is_what_the_exporter_writes_today() -> None:
    files = [find_model(name) / "aovs.onnx" for name in model_names()]
    sources = sources_of(files)
    if is_recorded("aovs", sources):
        return
    fresh = structure(onnx.load_from_string(aovs_graph()))
    assert all(structure(onnx.load(file)) == fresh for file in files)
    record("aovs", sources)
