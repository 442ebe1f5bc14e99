"""Gathers, casts and slices of traced graphs are simplified, and the result is the same."""

from collections.abc import Sequence

import numpy as np
import onnx
from onnx import TensorProto, helper, numpy_helper

from supersampler.backends.onnx.runtime import ort
from supersampler_export.simplify import joined_slices, simplified_gathers, without_detours

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
