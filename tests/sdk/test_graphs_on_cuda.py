"""All operators of the shipped graphs, at fixed sizes, have kernels in ONNX Runtime's CUDA provider."""

from pathlib import Path
from typing import Any

import numpy as np
import onnx
import onnxruntime as ort
import pytest
from onnx import TensorProto, numpy_helper

from cuda_kernels import CPU_INPUTS, CUDA_KERNELS
from supersampler.backends.onnx import runtime
from supersampler.backends.onnx.runtime import NAMES, precise
from supersampler.methods.model_file import extrapolation_names, find_model, model_names, read_model_info
from supersampler.methods.model_info import extents

DISPLAY = (63, 35)


def test_products_on_cuda_are_of_full_precision() -> None:
    cuda, cpu = NAMES["cuda"], NAMES["cpu"]
    assert precise([cuda, cpu]) == [(cuda, {"use_tf32": "0"}), cpu]


SIDES = (("width", 32), ("height", 18))
"""Every frame counts, those before included."""


def graphs() -> list[Any]:
    names = [*model_names(), *extrapolation_names()]
    infos = [read_model_info(find_model(name)) for name in names]
    return [
        pytest.param(path, id=f"{info.folder.name}-{kind}")
        for info in infos
        for kind, path in info.steps.items()
    ]


def graph_at_one_size(path: Path, optimized: Path) -> onnx.GraphProto:
    """The graph that ONNX Runtime assigns to providers."""
    ratio = read_model_info(path.parent).only_ratio
    display = DISPLAY if ratio is None else (round(32 * ratio), round(18 * ratio))
    sizes = extents(render=(32, 18), display=display, previous=(32, 18))
    sizes |= {f"{kind}_{side}": many for kind in ("shaded", "earlier", "between") for side, many in SIDES}
    options = ort.SessionOptions()
    for name, extent in sizes.items():
        options.add_free_dimension_override_by_name(name, extent)
    options.graph_optimization_level = ort.GraphOptimizationLevel.ORT_ENABLE_BASIC
    options.optimized_model_filepath = str(optimized)
    model = onnx.load(path)
    for value in [value for value in model.graph.input if value.name == "display_size"]:
        model.graph.input.remove(value)  # a constant: what computes shapes is then gone
        model.graph.initializer.append(numpy_helper.from_array(np.array(display, np.int64), value.name))
    ort.InferenceSession(model.SerializeToString(), options, providers=["CPUExecutionProvider"])
    return onnx.load(optimized).graph


@pytest.mark.parametrize("path", graphs())
def test_a_graph_frozen_to_one_size_runs_on_cuda(path: Path, tmp_path: Path) -> None:
    left = graph_at_one_size(path, tmp_path / "optimized.onnx")
    written = onnx.shape_inference.infer_shapes(onnx.load(path), strict_mode=True).graph
    values = (*written.input, *written.value_info, *written.output)
    types = {value.name: value.type.tensor_type.elem_type for value in values}
    types |= {tensor.name: tensor.data_type for tensor in written.initializer}
    constants = {tensor.name for tensor in left.initializer}
    constants |= {f"InsertedPrecisionFreeCast_{name}" for name in constants}  # by the CPU provider
    as_written = {node.name: node for node in written.node}  # the CPU turns half precision into single
    assert len(left.node) > 40
    for node in left.node:
        assert node.op_type in CUDA_KERNELS, node.op_type  # no Shape, no Range
        on_host = CPU_INPUTS.get(node.op_type, slice(0))
        assert {*node.input[on_host]} <= {*constants, ""}, node.name  # or it would be copied from the device
        if node.name in as_written:
            data = set(as_written[node.name].input) - set(as_written[node.name].input[on_host]) - {""}
            kinds = {TensorProto.DataType.Name(types[name]).lower() for name in data}
            assert kinds <= CUDA_KERNELS[node.op_type], f"{node.op_type} of {kinds}"


# --- without ONNX Runtime ---


def test_other_backends_need_no_onnx_runtime(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(runtime, "find_spec", lambda _: None)
    monkeypatch.setattr(runtime, "_distribution", lambda: None)
    monkeypatch.setattr(runtime, "ort", None)
    assert runtime.resolve_providers("auto") == [runtime.CPU]
