"""Methods in half floats: near single precision, never infinite."""

import itertools
import math

import onnx
import pytest
import torch
from onnx import TensorProto
from torch import nn

from hostile_frames import RENDER, display_of, frames
from supersampler.io.display import MAX_HALF
from supersampler.methods.model_file import find_model
from supersampler_export import parity
from supersampler_export.graph import ExportError
from supersampler_export.half import to_half
from supersampler_export.parity import check_half
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
def test_a_method_that_half_floats_spoil_is_not_exported() -> None:
    method, half = halved("classifier-small")
    blend = half.get_submodule("net.blend")
    assert isinstance(blend, nn.Conv2d)
    assert blend.bias is not None
    blend.bias.data[:4] += 3.0  # weight of the history
    with pytest.raises(ExportError, match="in half floats"):
        check_half(method, half)


@pytest.mark.parametrize("name", ["classifier", "gbuffer-small"])
def test_whatever_comes_all_outputs_are_finite_and_in_single_precision(name: str) -> None:
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
def test_whatever_the_network_infers_images_are_finite(name: str, bias: float) -> None:
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
