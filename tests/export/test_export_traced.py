"""Shipped graphs have the operators and constants of freshly traced ones."""

import os
from collections import Counter
from typing import Any

import onnx
import pytest

from supersampler.methods.model_file import find_model, model_names
from supersampler.methods.registry import methods
from supersampler_export.folder import aovs_graph
from supersampler_export.graph import export_graph
from supersampler_model.methods import load_method

SHIPPED = [name for name, spec in methods().items() if spec.ships]
TRACED = SHIPPED if "SUPERSAMPLER_TRACES" in os.environ else ["bilinear"]
"""`make traces` takes all; most take minutes. On merge, test_shipped_steps compares what
torch and the shipped graphs compute in all methods."""


def structure(model: onnx.ModelProto) -> tuple[Counter[str], list[Any]]:
    """Return operators and constants, without names; of weights their shapes, as folding them rounds."""
    arrays = [onnx.numpy_helper.to_array(t) for t in model.graph.initializer]
    constants = [array.tolist() if array.size <= 16 else array.shape for array in arrays]
    return Counter(node.op_type for node in model.graph.node), sorted(constants, key=str)


@pytest.mark.timeout(900)  # a trace of `classifier` takes two to six minutes, by machine
@pytest.mark.parametrize("name", TRACED)
def test_the_shipped_graph_is_up_to_date_and_its_trace_prints_no_errors(
    name: str, capfd: pytest.CaptureFixture[str]
) -> None:
    folder = find_model(name)
    hint = f"run: supersampler export {name} -o {folder}"
    assert structure(onnx.load(folder / "step.onnx")) == structure(export_graph(load_method(name))), hint
    assert "Error" not in capfd.readouterr().err


def test_the_graph_that_blends_aovs_is_up_to_date() -> None:
    fresh = structure(onnx.load_from_string(aovs_graph()))
    assert all(structure(onnx.load(find_model(name) / "aovs.onnx")) == fresh for name in model_names())
