"""Methods in half floats: near single precision, never infinite."""

import itertools
import math
from collections.abc import Sequence

import numpy as np
import onnx
import pytest
import torch
from onnx import TensorProto, helper, numpy_helper
from torch import nn

from hostile_frames import RENDER, display_of, frames
from supersampler.backends.onnx.runtime import ort
from supersampler.io.display import MAX_HALF
from supersampler.methods.model_file import find_model
from supersampler_export import parity
from supersampler_export.graph import ExportError
from supersampler_export.half import to_half
from supersampler_export.parity import check_half
from supersampler_export.simplify import joined_slices, simplified_gathers, without_detours
from supersampler_model import ops
from supersampler_model.methods import load_method
from supersampler_model.methods.base import Method

HALF, FLOAT, LONG = TensorProto.FLOAT16, TensorProto.FLOAT, TensorProto.INT64


def halved(name: str) -> tuple[Method, Method]:
    method = load_method(name)
    half = to_half(method)
    assert half is not None
    return method, half


@pytest.fixture
def one_size(monkeypatch: pytest.MonkeyPatch) -> None:
    """Check at a ratio of 4 alone, where samples are farthest apart."""
    monkeypatch.setattr(parity, "sizes_of", lambda _: [(ops.Size(21, 13), ops.Size(84, 52))])


@pytest.mark.usefixtures("one_size")
@pytest.mark.parametrize("name", ["classifier", "classifier-small", "gbuffer-small-4x"])
def test_half_floats_stay_near_single_precision(name: str) -> None:
    check_half(*halved(name))


@pytest.mark.usefixtures("one_size")
def test_a_method_broken_by_half_floats_is_not_exported() -> None:
    method, half = halved("classifier-small")
    blend = half.get_submodule("net.blend")
    assert isinstance(blend, nn.Conv2d)
    assert blend.bias is not None
    blend.bias.data[:4] += 3.0  # weight of the history
    with pytest.raises(ExportError, match="in half floats"):
        check_half(method, half)


@pytest.mark.parametrize("name", ["classifier", "gbuffer-small"])
def test_outputs_are_always_finite_single_precision(name: str) -> None:
    _, half = halved(name)
    display = display_of(half)
    history = half.first_history(display, RENDER, 3)
    for index, frame in enumerate(frames(display)):
        if index % 2:
            frame["color"] = (frame["color"] * 0.5 * MAX_HALF).clamp(max=MAX_HALF)
        with torch.no_grad():
            image, history, others = half.step(*(frame[name] for name in half.inputs()), *history)
        for made in (image, *history, *others):
            assert made.dtype == torch.float32
            assert made.isfinite().all()
        assert image.min() >= 0.0
        assert image.max() <= MAX_HALF * frame["pre_exposure"]


@pytest.mark.parametrize("bias", [-40.0, 40.0])
@pytest.mark.parametrize("name", ["classifier", "gbuffer-small"])
def test_images_are_finite_for_any_network_output(name: str, bias: float) -> None:
    _, half = halved(name)
    blend = half.get_submodule("net.blend")
    assert isinstance(blend, nn.Conv2d)
    assert blend.bias is not None
    blend.bias.data += bias
    display = display_of(half)
    history = half.first_history(display, RENDER, 3)
    for frame in itertools.islice(frames(display), 2):
        with torch.no_grad():
            image, history, _ = half.step(*(frame[name] for name in half.inputs()), *history)
        assert all(made.isfinite().all() for made in (image, *history))
        assert image.mean() > 0.1  # black where all weights are 0


def test_half_floats_limit_light_that_they_would_round_to_infinite_light() -> None:
    bright = torch.tensor([0.5, 0.99999])
    assert ops.limited(bright) is bright
    assert ops.limited(bright.half()).tolist() == [0.5, 1.0 - 2.0**-10]


def test_small_divisors_and_weights_are_not_rounded_to_zero() -> None:
    zero = torch.zeros(1, dtype=torch.float16)
    assert (zero / zero.clamp(min=ops.min_divisor(zero, 1e-12))).item() == 0.0
    assert ops.min_divisor(zero.float(), 1e-12) == 1e-12
    dark, bright, one = torch.zeros(1, 3, 1, 1), torch.ones(1, 3, 1, 1), torch.ones(1, 1, 1, 1)
    factors = torch.tensor([-16.0, -15.5], dtype=torch.float16).reshape(1, 2, 1, 1)
    mean = ops.composite([(dark, one)], [(bright, one)], factors, torch.zeros(()), dark).color
    assert mean.mean().item() == pytest.approx(1.0 / (1.0 + math.exp(-0.5)), rel=1e-4)


@pytest.mark.parametrize("name", ["classifier", "classifier-small", "gbuffer-small"])
def test_a_shipped_graph_resamples_and_infers_in_half_floats_and_reads_the_history_in_floats(
    name: str,
) -> None:
    model = onnx.shape_inference.infer_shapes(onnx.load(find_model(name) / "step.fp16.onnx"))
    values = (*model.graph.value_info, *model.graph.input, *model.graph.output)
    kinds = {value.name: value.type.tensor_type.elem_type for value in values}
    kinds |= {tensor.name: tensor.data_type for tensor in model.graph.initializer}
    used: dict[str, list[int]] = {}
    for node in model.graph.node:
        used.setdefault(node.op_type, []).append(kinds[node.input[0]])
    assert set(used["GridSample"]) == {FLOAT}
    for operator in ("Relu", "ReduceMax", "Split"):
        assert HALF in used[operator], operator
    assert used["MatMul"].count(HALF) >= 4
    assert used["Conv"].count(HALF) > 0.7 * len(used["Conv"])
    borders = (*model.graph.input, *model.graph.output)
    assert {value.type.tensor_type.elem_type for value in borders} == {FLOAT, LONG}


# --- gathers, casts and slices of traced graphs are simplified, and the result is the same ---


ROWS = [[0, 2], [2, 1], [1, 0]]
FLATTEN = helper.make_node("Reshape", ["rows", "flat"], ["indices"])
GATHER = helper.make_node("Gather", ["image", "indices"], ["picked"], axis=1)
HALF, FLOAT, LONG = TensorProto.FLOAT16, TensorProto.FLOAT, TensorProto.INT64


def graph_of(nodes: list[onnx.NodeProto], rows: Sequence[object], split: list[int]) -> onnx.ModelProto:
    """A graph from image (2, 3, 5) and these row indices to the value "out", with the types of all values."""
    constants = {"flat": np.array([-1]), "split": np.array(split)}
    tensors = [numpy_helper.from_array(value.astype(np.int64), name) for name, value in constants.items()]
    shape = list(np.array(rows).shape)
    inputs = [
        helper.make_tensor_value_info("image", TensorProto.FLOAT, [2, 3, 5]),
        helper.make_tensor_value_info("rows", TensorProto.INT64, shape),
    ]
    out = helper.make_tensor_value_info("out", TensorProto.FLOAT, None)
    graph = helper.make_graph(nodes, "g", inputs, [out], tensors)
    opsets = [helper.make_opsetid("", 17)]
    return onnx.shape_inference.infer_shapes(helper.make_model(graph, opset_imports=opsets, ir_version=8))


def simplified(model: onnx.ModelProto, rows: Sequence[object]) -> list[str]:
    """Return the operators of the simplified graph, whose result is that of the graph."""
    image = np.random.default_rng(0).random((2, 3, 5), np.float32)
    before = model.SerializeToString()
    after = simplified_gathers(model).SerializeToString()
    onnx.checker.check_model(model, full_check=True)
    ours, theirs = (
        ort.InferenceSession(graph, providers=["CPUExecutionProvider"]).run(
            None, {"image": image, "rows": np.array(rows)}
        )[0]
        for graph in (before, after)
    )
    np.testing.assert_array_equal(ours, theirs)
    return [node.op_type for node in model.graph.node]


def test_rows_at_indices_of_two_axes_are_one_gather() -> None:
    nodes = [FLATTEN, GATHER, helper.make_node("Reshape", ["picked", "split"], ["out"])]
    model = graph_of(nodes, ROWS, [2, 3, 2, -1])
    assert simplified(model, ROWS) == ["Gather"]
    assert not model.graph.initializer


def test_indices_of_one_axis_are_not_flattened() -> None:
    out = helper.make_node("Neg", ["picked"], ["out"])
    assert simplified(graph_of([FLATTEN, GATHER, out], ROWS[0], [1]), ROWS[0]) == ["Gather", "Neg"]


def test_a_result_of_unknown_extents_is_reshaped_as_before() -> None:
    nodes = [FLATTEN, GATHER, helper.make_node("Reshape", ["picked", "split"], ["out"])]
    model = graph_of(nodes, ROWS, [2, 3, 2, -1])
    for value, places in ((model.graph.input[1], (0, 1)), (model.graph.output[0], (1, 2))):
        for place in places:
            value.type.tensor_type.shape.dim[place].Clear()
    assert [node.op_type for node in simplified_gathers(model).graph.node] == ["Reshape", "Gather", "Reshape"]


def test_a_result_of_another_shape_or_with_other_readers_is_reshaped_as_before() -> None:
    other = [FLATTEN, GATHER, helper.make_node("Reshape", ["picked", "split"], ["out"])]
    assert simplified(graph_of(other, ROWS, [2, 2, 3, -1]), ROWS) == ["Reshape", "Gather", "Reshape"]
    shared = [
        FLATTEN,
        GATHER,
        helper.make_node("Reshape", ["picked", "split"], ["parts"]),
        helper.make_node("Reshape", ["parts", "flat"], ["all"]),
        helper.make_node("Reshape", ["picked", "flat"], ["again"]),
        helper.make_node("Add", ["all", "again"], ["out"]),
    ]
    assert simplified(graph_of(shared, ROWS, [2, 3, 2, -1]), ROWS)[:3] == ["Reshape", "Gather", "Reshape"]


def image_graph(nodes: list[onnx.NodeProto], kind: int, constants: dict[str, list[int]]) -> onnx.ModelProto:
    shape: list[str | int | None] = ["n", 4, "h", "w"]
    values = [helper.make_tensor_value_info(name, kind, shape) for name in ("image", "out")]
    tensors = [numpy_helper.from_array(np.array(v, np.int64), k) for k, v in constants.items()]
    graph = helper.make_graph(nodes, "g", values[:1], values[1:], tensors)
    return helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)


def test_casts_around_an_operator_of_one_input_are_removed_and_others_stay() -> None:
    nodes = [
        helper.make_node("Cast", ["image"], ["up"], to=FLOAT),
        helper.make_node("Abs", ["up"], ["positive"]),
        helper.make_node("Cast", ["positive"], ["down"], to=HALF),
        helper.make_node("Cast", ["down"], ["again"], to=FLOAT),
        helper.make_node("Exp", ["again"], ["large"]),
        helper.make_node("Cast", ["large"], ["out"], to=HALF),
    ]
    model = without_detours(image_graph(nodes, HALF, {}))
    assert [node.op_type for node in model.graph.node] == ["Abs", "Cast", "Exp", "Cast"]
    onnx.checker.check_model(model, full_check=True)


def test_casts_stay_around_an_operator_whose_result_is_read_in_single_precision() -> None:
    up = helper.make_node("Cast", ["image"], ["up"], to=FLOAT)
    read_so = [
        up,
        helper.make_node("Abs", ["up"], ["positive"]),
        helper.make_node("Cast", ["positive"], ["down"], to=HALF),
        helper.make_node("Exp", ["positive"], ["large"]),
        helper.make_node("Cast", ["large"], ["half"], to=HALF),
        helper.make_node("Add", ["down", "half"], ["out"]),
    ]
    is_output = [up, helper.make_node("Abs", ["up"], ["out"])]
    for nodes in (read_so, is_output):
        model = without_detours(image_graph(nodes, HALF, {}))
        assert [node.op_type for node in model.graph.node] == [node.op_type for node in nodes]


def test_slices_of_both_axes_become_one_of_the_same_pixels() -> None:
    names = ("one", "two", "rows", "columns")
    constants = dict(zip(names, ([1], [2], [2], [3]), strict=True)) | {"four": [4], "none": [0]}
    nodes = [
        helper.make_node("Slice", ["image", "one", "four", "rows", "one"], ["first"]),
        helper.make_node("Slice", ["first", "none", "two", "columns", "one"], ["out"]),
    ]
    before = image_graph(nodes, FLOAT, constants)
    image = np.random.default_rng(0).random((1, 4, 5, 6), np.float32)
    after = joined_slices(onnx.ModelProto.FromString(before.SerializeToString()))
    assert [node.op_type for node in after.graph.node] == ["Slice"]
    assert set(after.graph.node[0].input[1:]) <= {tensor.name for tensor in after.graph.initializer}
    ours, theirs = (
        ort.InferenceSession(model.SerializeToString(), providers=["CPUExecutionProvider"]).run(
            None, {"image": image}
        )[0]
        for model in (before, after)
    )
    np.testing.assert_array_equal(ours, theirs)
    np.testing.assert_array_equal(theirs, image[:, :, 1:4, :2])


def test_slices_along_one_axis_or_with_other_readers_stay() -> None:
    constants = {"one": [1], "two": [2], "four": [4], "rows": [2], "columns": [3]}
    same = [
        helper.make_node("Slice", ["image", "one", "four", "rows", "one"], ["first"]),
        helper.make_node("Slice", ["first", "one", "two", "rows", "one"], ["out"]),
    ]
    read_twice = [
        helper.make_node("Slice", ["image", "one", "four", "rows", "one"], ["first"]),
        helper.make_node("Slice", ["first", "one", "two", "columns", "one"], ["second"]),
        helper.make_node("Concat", ["first", "second"], ["out"], axis=3),
    ]
    for nodes in (same, read_twice):
        model = joined_slices(image_graph(nodes, FLOAT, constants))
        assert [node.op_type for node in model.graph.node] == [node.op_type for node in nodes]
