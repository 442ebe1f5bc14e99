"""Parts of the exporter that need no tracing."""

from contextlib import nullcontext
from typing import Any, ClassVar

import onnx
import pytest
import torch
from onnx import TensorProto, helper
from torch import Tensor, nn

from supersampler.methods.spec import DISPLAY, HALF, PREVIOUS, RENDER, SHADED, MethodSpec, Shape
from supersampler_export import graph
from supersampler_export.count import multiply_adds_of
from supersampler_export.graph import (
    ExportError,
    _declare,
    _strip,
    example_arguments,
    example_inputs,
    history_name,
    shape_of,
    traced_sizes,
)
from supersampler_export.parity import check_subgraph
from supersampler_model import ops
from supersampler_model.methods.base import Method, NetworkSubgraph


class Kept(Method):
    """A method of no use."""

    spec: ClassVar = MethodSpec(
        name="kept",
        source="a test",
        inputs=("color", "display_size", "aovs", "gbuffer_display_depth"),
        history={
            "color": (1, 3, *DISPLAY),
            "classes": (1, 6, *HALF),
            "depth": (1, 2, *PREVIOUS),
            "old": (1, 1, *SHADED),
            "jitter": (1, 2),
        },
    )

    def compute(
        self, color: Tensor, display_size: Tensor, aovs: Tensor, gbuffer_display_depth: Tensor,
        history_color: Tensor, history_classes: Tensor, history_depth: Tensor, history_old: Tensor,
        history_jitter: Tensor,
    ) -> tuple[Tensor, ...]:  # fmt: skip
        raise NotImplementedError


def test_example_arguments_have_the_shapes_of_the_contract_and_sizes_that_differ() -> None:
    arguments = example_arguments(Kept(), ops.Size(26, 18), ops.Size(53, 37), ops.Size(22, 15))
    color, display_size, aovs, depth, *history = arguments
    assert color.shape == (1, 3, 18, 26)
    assert display_size.tolist() == [53, 37]
    assert aovs.shape == (1, 3, 18, 26)
    assert depth.shape == (1, 1, 37, 53)
    shapes = [(1, 3, 37, 53), (1, 6, 19, 27), (1, 2, 15, 22), (1, 1, 17, 23), (1, 2)]
    assert [tuple(t.shape) for t in history] == shapes
    assert all(float(t.min()) >= 0.0 and float(t.max()) <= 1.0 for t in (color, aovs, depth, *history))


def test_names_and_shapes_of_history_tensors_are_those_of_the_method() -> None:
    assert history_name("history_classes") == "history.classes"
    assert history_name("history_history_x") == "history.history_x"
    assert shape_of(Kept(), "history_old") == (1, 1, *SHADED)
    assert shape_of(Kept(), "color") == (1, 3, *RENDER)


@pytest.mark.parametrize(
    ("ratios", "display"), [((1.0, 4.0), (52, 37)), ((2.0, 2.0), (52, 36)), ((1.0, 1.0), (26, 18))]
)
def test_a_graph_is_traced_at_no_whole_ratio_where_the_method_may_have_one(
    ratios: tuple[float, float], display: tuple[int, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Kept, "ratios", ratios)
    assert traced_sizes(Kept()) == (ops.Size(26, 18), ops.Size(*display))


def test_a_ratio_that_no_size_has_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Kept, "ratios", (1.3, 1.3))
    with pytest.raises(ExportError, match="kept"):
        traced_sizes(Kept())


@pytest.mark.parametrize("ratio", [2, 4])
def test_example_inputs_of_a_network_are_of_render_half_and_display_size(ratio: int) -> None:
    inputs: dict[str, Shape] = {"a": (1, 5, *RENDER), "b": (1, 2, *DISPLAY), "c": (1, 7, *HALF)}
    made = example_inputs(NetworkSubgraph(nn.Identity(), inputs, {}, ratio), ops.Size(21, 13))
    assert [tuple(t.shape) for t in made] == [(1, 5, 13, 21), (1, 2, 13 * ratio, 21 * ratio), (1, 7, 13, 21)]


def test_a_network_of_any_size_from_one_pixel_on_can_be_traced(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its display size is a whole multiple of its render size."""
    inputs: dict[str, Shape] = {"a": (1, 5, *RENDER), "b": (1, 2, *DISPLAY), "c": (1, 7, *HALF)}
    values = [helper.make_tensor_value_info(name, TensorProto.FLOAT, None) for name in inputs]
    free: list[Any] = []

    def traced(module: nn.Module, arguments: Any, inputs: Any, outputs: Any, dims: Any) -> onnx.ModelProto:
        free.extend(dims)
        return helper.make_model(helper.make_graph([], "g", values, []))

    monkeypatch.setattr(graph, "_traced", traced)
    graph.export_subgraph(NetworkSubgraph(nn.Identity(), inputs, {}, 4))
    render, display, half = free
    for axis in (2, 3):
        assert (render[axis].min, half[axis].min) == (1, 1)
        assert 8192 <= render[axis].max == half[axis].max <= 32768
        assert display[axis].root is render[axis]
        assert display[axis].fn(3) == 12
    assert len({dim.__name__ for dims in (render, half) for dim in dims.values()}) == 4


@pytest.mark.parametrize(("off", "refused"), [(0.5e-4, False), (2e-4, True)])
@pytest.mark.parametrize("largest", [0.5, 300.0])
def test_a_network_may_be_off_by_the_tolerance_of_its_largest_value_or_of_1(
    off: float, refused: bool, largest: float
) -> None:
    class Ramp(nn.Module):
        """Values from 0 to the largest, a little off."""

        def forward(self, image: Tensor) -> tuple[Tensor]:
            return (image * 0.0 + torch.tensor([0.0, largest]).reshape(1, 2, 1, 1) + off * max(largest, 1.0),)

    shape: Shape = (1, 2, *HALF)
    zero = helper.make_node("Sub", ["image", "image"], ["zero"])
    ramp = helper.make_tensor("ramp", TensorProto.FLOAT, (1, 2, 1, 1), [0.0, largest])
    add = helper.make_node("Add", ["zero", "ramp"], ["made"])
    values = [helper.make_tensor_value_info(n, TensorProto.FLOAT, shape) for n in ("image", "made")]
    exact = helper.make_model(
        helper.make_graph([zero, add], "ramp", values[:1], values[1:], [ramp]),
        opset_imports=[helper.make_opsetid("", 17)], ir_version=10,
    )  # fmt: skip
    fused = NetworkSubgraph(Ramp(), {"image": shape}, {"made": shape}, 1)
    with pytest.raises(ExportError, match="ONNX Runtime is off by") if refused else nullcontext():
        check_subgraph(fused, exact.SerializeToString())


def test_multiply_adds_are_counted_for_each_pixel_of_the_display() -> None:
    """A 3x3 convolution of 4 to 8 channels at render size: 288 a pixel there, 72 a pixel of the display."""
    inputs: dict[str, Shape] = {"image": (1, 4, *RENDER)}
    fused = NetworkSubgraph(nn.Conv2d(4, 8, 3, padding=1, bias=False), inputs, {}, 2)
    assert multiply_adds_of(fused) == pytest.approx(4 * 8 * 9 / 4)
    assert multiply_adds_of(fused, (64, 32)) == pytest.approx(4 * 8 * 9 / 4)
    half = NetworkSubgraph(fused.module, {"image": (1, 4, *HALF)}, {}, 1)
    assert multiply_adds_of(half) == pytest.approx(4 * 8 * 9 / 4)
    assert next(fused.module.parameters()).device == torch.device("cpu"), "the module is not moved"


def test_what_the_exporter_says_of_its_own_is_left_out_and_shapes_are_the_contracts() -> None:
    value = [helper.make_tensor_value_info(name, TensorProto.FLOAT, [1, "s0"]) for name in ("x", "y")]
    node = helper.make_node("Relu", ["x"], ["y"])
    graph = helper.make_graph([node], "g", value[:1], value[1:], value_info=[value[0]])
    model = helper.make_model(graph)
    for holder in (model.graph, model.graph.node[0]):
        entry = holder.metadata_props.add()
        entry.key, entry.value = "namespace", "/home/me/src"
    _declare(model.graph.input, [(1, "width")])
    _strip(model)
    assert not model.graph.value_info
    assert not model.graph.metadata_props
    assert not model.graph.node[0].metadata_props
    [dimension] = [d.dim_param for d in model.graph.input[0].type.tensor_type.shape.dim if d.dim_param]
    assert dimension == "width"
    assert model.graph.input[0].type.tensor_type.elem_type == TensorProto.FLOAT
    onnx.checker.check_model(model)
