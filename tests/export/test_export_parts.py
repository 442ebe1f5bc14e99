"""Parts of the exporter that need no tracing."""

from typing import ClassVar

import onnx
import pytest
import torch
from onnx import TensorProto, helper
from torch import Tensor, nn

from supersampler.methods.spec import DISPLAY, HALF, PREVIOUS, RENDER, SHADED, MethodSpec, Shape
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
from supersampler_model.methods.base import Fused, Method, Size


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

    def forward(
        self, color: Tensor, display_size: Tensor, aovs: Tensor, gbuffer_display_depth: Tensor,
        history_color: Tensor, history_classes: Tensor, history_depth: Tensor, history_old: Tensor,
        history_jitter: Tensor,
    ) -> Tensor:  # fmt: skip
        raise NotImplementedError


def test_example_arguments_have_the_shapes_of_the_contract_and_sizes_that_differ() -> None:
    arguments = example_arguments(Kept(), Size(26, 18), Size(53, 37), Size(22, 15))
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
    assert traced_sizes(Kept()) == (Size(26, 18), Size(*display))


def test_a_ratio_that_no_size_has_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Kept, "ratios", (1.3, 1.3))
    with pytest.raises(ExportError, match="kept"):
        traced_sizes(Kept())


@pytest.mark.parametrize("ratio", [2, 4])
def test_example_inputs_of_a_network_are_of_render_half_and_display_size(ratio: int) -> None:
    inputs: dict[str, Shape] = {"a": (1, 5, *RENDER), "b": (1, 2, *DISPLAY), "c": (1, 7, *HALF)}
    made = example_inputs(Fused(nn.Identity(), inputs, {}, ratio), Size(21, 13))
    assert [tuple(t.shape) for t in made] == [(1, 5, 13, 21), (1, 2, 13 * ratio, 21 * ratio), (1, 7, 13, 21)]


def test_multiply_adds_are_counted_for_each_pixel_of_the_display() -> None:
    """A 3x3 convolution of 4 to 8 channels at render size: 288 a pixel there, 72 a pixel of the display."""
    inputs: dict[str, Shape] = {"image": (1, 4, *RENDER)}
    fused = Fused(nn.Conv2d(4, 8, 3, padding=1, bias=False), inputs, {}, 2)
    assert multiply_adds_of(fused) == pytest.approx(4 * 8 * 9 / 4)
    assert multiply_adds_of(fused, (64, 32)) == pytest.approx(4 * 8 * 9 / 4)
    half = Fused(fused.module, {"image": (1, 4, *HALF)}, {}, 1)
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
