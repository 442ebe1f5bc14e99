"""Methods in half floats: near single precision, never infinite."""

import itertools
from collections.abc import Callable
from typing import Any

import numpy as np
import onnx
import pytest
import torch
from onnx import TensorProto, helper, numpy_helper
from torch import nn

from hostile_frames import RENDER, display_of, frames
from supersampler.backends.onnx.runtime import ort
from supersampler.io.display import MAX_HALF
from supersampler_export import parity
from supersampler_export.graph import ExportError
from supersampler_export.half import to_half
from supersampler_export.parity import check_half
from supersampler_export.simplify import joined_slices, simplified_gathers, without_detours
from supersampler_model import ops
from supersampler_model.methods import load_method
from supersampler_model.methods.base import Method
from torch_inputs import step_by_name

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
        image, history, others = step_by_name(half, frame, history)
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
        image, history, _ = step_by_name(half, frame, history)
        assert all(made.isfinite().all() for made in (image, *history))
        assert image.mean() > 0.1  # black where all weights are 0


def node(operator: str, inputs: str, output: str, **attributes: Any) -> onnx.NodeProto:
    return helper.make_node(operator, inputs.split(), [output], **attributes)


CONSTANTS = {
    "flat": [-1], "parts": [1, 3, 2, 5, 6], "turned": [1, 2, 3, 5, 6], "zero": [0], "one": [1], "two": [2],
    "four": [4], "down": [2], "across": [3],
}  # fmt: skip
FLATTEN = node("Reshape", "rows flat", "indices")
GATHER = node("Gather", "image indices", "picked", axis=1)
TO_SINGLE = node("Cast", "image", "single", to=FLOAT)
ABS, TO_HALF = node("Abs", "single", "positive"), node("Cast", "positive", "half", to=HALF)
FEWER_ROWS = node("Slice", "image one four down one", "first")
GRAPHS: dict[str, tuple[Callable[[onnx.ModelProto], onnx.ModelProto], list[onnx.NodeProto], str]] = {
    "rows at indices of two axes": (
        simplified_gathers, [FLATTEN, GATHER, node("Reshape", "picked parts", "out")], "Gather",
    ),
    "rows in another shape": (
        simplified_gathers, [FLATTEN, GATHER, node("Reshape", "picked turned", "out")],
        "Reshape Gather Reshape",
    ),
    "rows with another reader": (
        simplified_gathers,
        [
            FLATTEN, GATHER, node("Reshape", "picked parts", "split"), node("Reshape", "split flat", "all"),
            node("Reshape", "picked flat", "again"), node("Add", "all again", "out"),
        ],
        "Reshape Gather Reshape Reshape Reshape Add",
    ),
    "casts around Abs": (
        without_detours,
        [
            TO_SINGLE, ABS, TO_HALF, node("Cast", "half", "again", to=FLOAT), node("Exp", "again", "large"),
            node("Cast", "large", "out", to=HALF),
        ],
        "Abs Cast Exp Cast",
    ),
    "a result that is read in single precision": (
        without_detours,
        [
            TO_SINGLE, ABS, TO_HALF, node("Exp", "positive", "large"),
            node("Cast", "large", "other", to=HALF), node("Add", "half other", "out"),
        ],
        "Cast Abs Cast Exp Cast Add",
    ),
    "an output in single precision": (without_detours, [TO_SINGLE, node("Abs", "single", "out")], "Cast Abs"),
    "slices of two axes": (
        joined_slices, [FEWER_ROWS, node("Slice", "first zero two across one", "out")], "Slice",
    ),
    "slices of one axis": (
        joined_slices, [FEWER_ROWS, node("Slice", "first one two down one", "out")], "Slice Slice",
    ),
    "slices with another reader": (
        joined_slices,
        [FEWER_ROWS, node("Slice", "first one two across one", "second"),
         node("Concat", "first second", "out", axis=3)],
        "Slice Slice Concat",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", GRAPHS)
def test_a_graph_is_simplified_only_where_its_result_stays_the_same(case: str) -> None:
    simplify, nodes, operators = GRAPHS[case]
    sides: list[str | int | None] = ["n", 4, "h", "w"]
    shape = None if simplify is simplified_gathers else sides
    kind = HALF if simplify is without_detours else FLOAT
    inputs = [
        helper.make_tensor_value_info("image", kind, [1, 4, 5, 6]),
        helper.make_tensor_value_info("rows", LONG, [3, 2]),
    ]
    tensors = [numpy_helper.from_array(np.array(v, np.int64), name) for name, v in CONSTANTS.items()]
    out = helper.make_tensor_value_info("out", FLOAT if "an output" in case else kind, shape)
    graph = helper.make_graph(nodes, "g", inputs, [out], tensors)
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)
    if simplify is simplified_gathers:  # the only one that reads the shapes of values
        model = onnx.shape_inference.infer_shapes(model)
    image = np.random.default_rng(0).random((1, 4, 5, 6)).astype(np.float16 if kind == HALF else np.float32)
    feeds = {"image": image, "rows": np.array([[0, 2], [2, 1], [1, 0]])}
    before = model.SerializeToString()
    after = simplify(model).SerializeToString()
    onnx.checker.check_model(model, full_check=True)
    assert " ".join(node.op_type for node in model.graph.node) == operators
    ours, theirs = (
        ort.InferenceSession(content, providers=["CPUExecutionProvider"]).run(None, feeds)[0]
        for content in (before, after)
    )
    np.testing.assert_array_equal(ours, theirs)
