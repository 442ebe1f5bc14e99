"""Quantised networks: layers, ranges and graphs."""

import itertools
from collections.abc import Sequence
from functools import cache

import numpy as np
import onnx
import pytest
import torch
from numpy.typing import NDArray
from onnx import numpy_helper
from torch import nn

from network_passes import Pass, inputs_of, pass_of
from shared_models import shared_model
from supersampler import Shot
from supersampler.backends.onnx.runtime import ort
from supersampler.methods.classifier.spec import DEFAULT_INPUTS
from supersampler.methods.model_file import find_model, model_names, read_model_info
from supersampler.methods.spec import half_size
from supersampler_bench.specs import with_default_gbuffers
from supersampler_export.half import HalfNetwork, folded
from supersampler_export.quantize import (
    BLOCK,
    BYTE,
    EIGHT,
    KEPT,
    MIDDLE,
    SIGNED,
    WORD,
    ByteLayout,
    by_output,
    depthwise,
    packed_bytes,
    pixelwise,
    unpacked,
)
from supersampler_export.quantize import folded as folded_pointwise
from supersampler_export.quantized_graph import quantized_network
from supersampler_model.methods import load_method
from supersampler_model.methods.classifier import Classifier
from supersampler_model.methods.classifier_network import Pointwise

RANDOM = np.random.default_rng(0)
GIVEN = (
    ByteLayout.of(6, 0.01)
    .beside(ByteLayout.of(3, 0.02, 128.0))
    .followed_by(1)
    .beside(ByteLayout.of(2, 0.005))
)
"""Bytes of eleven channels from three sources, with one of no channel between them."""
NAMES = [name for name in model_names() if "int8" in read_model_info(find_model(name)).networks]
DISPLAYS = [(321, 181), (322, 180)]
"""Odd, so that the last packed row and column repeat, and in no multiple of 8 packed pixels; even."""
FRAMES = 2
TORCH = (1e-6, 1e-5, 1e-4)
"""Bounds for float networks, over the largest value: mean difference, 99.9 % quantile, and the largest."""
AS_WRITTEN, OPTIMIZED = (0.002, 0.1), (0.03, 0.25)
"""Bounds for blend parameters, about -6 to 6: mean difference and its 99.9 % quantile. A session without
optimizations computes convolutions in floats; the default one rounds biases to int32."""
EQUAL, NEAR = {False: 0.98, True: 0.8}, 0.999
"""Share of logits that are equal (True: optimized), and within one step of their last bit."""


def values_of(bytes_: NDArray[np.uint8], layout: ByteLayout) -> NDArray[np.float64]:
    """Values by channel, (channels, n), of bytes (bytes, n)."""
    at = [int(np.flatnonzero(layout.channel == c)[0]) for c in range(layout.channel.max() + 1)]
    return np.asarray((bytes_[at] - layout.zero[at, None]) * layout.scale[at, None])


def test_channels_of_two_sources_lie_one_after_the_other() -> None:
    assert GIVEN.channel.tolist() == [0, 1, 2, 3, 4, 5, 6, 7, 8, -1, 9, 10]
    assert GIVEN.scale.tolist() == [0.01] * 6 + [0.02] * 3 + [1.0] + [0.005] * 2
    assert GIVEN.zero.tolist() == [0.0] * 6 + [128.0] * 3 + [0.0] * 3


@pytest.mark.parametrize(("length", "multiple", "room"), [(12, 4, 0), (13, 4, 3), (1, 32, 31)])
def test_room_fills_up_to_a_multiple(length: int, multiple: int, room: int) -> None:
    made = ByteLayout.of(length, 0.5, 3.0).up_to(multiple)
    assert len(made.channel) == length + room
    assert (made.channel[length:] == -1).all()
    assert (made.channel[:length] >= 0).all()


@pytest.mark.parametrize("order", [list(range(8)), [3, 1, -1, 0, 2, 7, 6, 5, 4]])
def test_a_1x1_convolution_of_bytes_is_that_of_floats(order: list[int]) -> None:
    weights, bias = RANDOM.normal(size=(8, 11)), RANDOM.normal(size=8)
    made = ByteLayout.of(order, 0.02, MIDDLE)
    layer = pixelwise(weights, bias, GIVEN, made)
    assert layer["weights"].dtype == np.int8
    assert layer["weights"].shape == (1, 12 // WORD, BLOCK, WORD)
    given = RANDOM.integers(0, 256, (12, 50)).astype(np.uint8)
    flat = layer["weights"].transpose(0, 2, 1, 3).reshape(BLOCK, 12).astype(np.int64)
    there = [place for place, channel in enumerate(order) if channel >= 0]
    assert (np.abs(flat[there]).max(axis=1) == SIGNED).all(), "the range is used"
    got = (flat @ given) * layer["scale"][:, None] + layer["bias"][:, None]
    want = weights @ values_of(given, GIVEN) + bias[:, None]
    for place, channel in enumerate(order):
        if channel < 0:
            assert not got[place].any()
            continue
        step = np.abs(weights[channel] * np.append(GIVEN.scale[:9], GIVEN.scale[10:])).max() / SIGNED
        off = np.abs((got[place] - MIDDLE) * 0.02 - want[channel])
        assert off.max() <= 0.5 * step * 255 * 11
        assert off.mean() <= 0.5 * step * 255 * 11**0.5
    assert not got[len(order) :].any()


def test_the_last_layer_lies_output_by_output() -> None:
    layer = pixelwise(
        RANDOM.normal(size=(11, 8)), RANDOM.normal(size=11), ByteLayout.of(8, 0.1), ByteLayout.of(11, 1.0)
    )
    turned = by_output(layer, 11)
    assert turned["weights"].shape == (2 * EIGHT, 8 // WORD, WORD)
    assert turned["scale"].shape == turned["bias"].shape == (2 * EIGHT,)
    for output in range(11):
        np.testing.assert_array_equal(turned["weights"][output], layer["weights"][0, :, output])


def test_a_3x3_convolution_of_each_channel_of_bytes_is_that_of_floats() -> None:
    weights = RANDOM.normal(size=(32, 3, 3))
    layer = depthwise(weights, 0.02, 0.05)
    assert layer["weights"].shape == (2, 3, 16, WORD)
    assert (layer["bias"] == MIDDLE).all()
    around = RANDOM.integers(0, 256, (32, 3, 3))
    columns = layer["weights"].transpose(0, 2, 3, 1).reshape(32, WORD, 3)  # (channel, row, column)
    assert not columns[:, 3].any()
    got = (columns[:, :3].astype(int) * around).sum(axis=(1, 2)) * layer["scale"]
    want = (weights * around).sum(axis=(1, 2)) * 0.02 / 0.05
    np.testing.assert_allclose(got, want, atol=9 * 255 * 0.5 * np.abs(weights).max() / SIGNED * 0.4)
    assert np.corrcoef(got, want)[0, 1] > 0.999


def test_batch_normalisation_is_within_the_weights() -> None:
    torch.manual_seed(0)
    layer = Pointwise(5, 7, rectified=False).eval()
    for name, value in layer.named_buffers():
        if "running" in name:
            value.copy_(0.5 + torch.rand(7))
    torch.nn.init.normal_(layer.get_parameter("1.weight"))
    torch.nn.init.normal_(layer.get_parameter("1.bias"))
    weights, bias = folded_pointwise(layer)
    given = torch.randn(1, 5, 1, 4)
    want = layer(given)[0, :, 0].detach().numpy()
    np.testing.assert_allclose(weights @ given[0, :, 0].numpy() + bias[:, None], want, rtol=1e-4, atol=1e-5)


def test_packed_pixels_are_from_0_to_1_but_for_the_difference_of_depth() -> None:
    packed, at = packed_bytes(), DEFAULT_INPUTS.index("depth_difference")
    values = np.stack([(b - packed.zero) * packed.scale for b in (0.0, BYTE)])
    assert len(packed.channel) == 4 * len(DEFAULT_INPUTS)
    np.testing.assert_allclose(values[1], 1.0)
    low = np.zeros(4 * len(DEFAULT_INPUTS))
    low[4 * at : 4 * at + 4] = -1.0
    np.testing.assert_allclose(values[0], low)


@pytest.mark.parametrize("level", range(len(KEPT)))
def test_every_channel_of_a_level_is_read_once_in_its_bytes(level: int) -> None:
    parts = 4**level
    channels = parts * max(KEPT[level] // 2, 1)
    order = unpacked(channels, level)
    assert len(order) == parts * KEPT[level]
    assert sorted(c for c in order if c >= 0) == list(range(channels))
    for part in range(parts):
        own = order[part * KEPT[level] : (part + 1) * KEPT[level]]
        assert all(c % parts == part for c in own if c >= 0)


def test_a_half_precision_network_has_folded_normalisation_and_similar_outputs() -> None:
    torch.manual_seed(0)
    network = nn.Sequential(
        Pointwise(3, 4), nn.Conv2d(4, 4, 3, padding=1), Pointwise(4, 2, rectified=False)
    ).eval()
    for name, value in network.named_buffers():
        if "running" in name:
            value.copy_(0.5 + torch.rand(value.shape))
    given = torch.rand(1, 3, 6, 5)
    want = network(given)

    class Tupled(nn.Module):
        def __init__(self) -> None:
            super().__init__()
            self.inner = network

        def forward(self, image: torch.Tensor) -> tuple[torch.Tensor]:
            return (self.inner(image),)

    half = HalfNetwork(Tupled())
    (got,) = half(given)
    assert got.dtype == torch.float32
    torch.testing.assert_close(got, want, rtol=2e-2, atol=2e-2)
    kinds = [type(module) for module in half.modules()]
    assert nn.BatchNorm2d not in kinds
    assert {p.dtype for p in half.parameters()} == {torch.float16}
    assert {p.dtype for p in network.parameters()} == {torch.float32}, "the one given stays as it is"
    torch.testing.assert_close(folded(network)(given), want, rtol=1e-4, atol=1e-5)


@cache
def passes(name: str, display: tuple[int, int]) -> list[Pass]:
    model = shared_model(name, executor="cpu")
    frames = [item.frame for item in itertools.islice(Shot.open("plaza"), FRAMES)]
    frames = [with_default_gbuffers(frame, model.info.gbuffers, display) for frame in frames]
    method = load_method(name)
    assert isinstance(method, Classifier)
    with pytest.MonkeyPatch.context() as patch:
        return [pass_of(model, codes) for codes in inputs_of(method.eval(), frames, display, patch)]


@cache
def hostile_pass(name: str) -> Pass:
    """Inputs at both ends of their ranges: areas of each value, and noise of both."""
    random, (width, height) = np.random.default_rng(0), half_size(DISPLAYS[0])
    blocks = 255 * random.integers(0, 2, (height // 16 + 1, width // 16 + 1, 72), np.uint8)
    codes = blocks.repeat(16, axis=0).repeat(16, axis=1)[:height, :width]
    codes[: height // 4] = 255 * random.integers(0, 2, codes[: height // 4].shape, np.uint8)
    return pass_of(shared_model(name, executor="cpu"), codes)


def all_passes(name: str) -> list[Pass]:
    return [*(p for display in DISPLAYS for p in passes(name, display)), hostile_pass(name)]


def session_of(graph: bytes, *, optimized: bool) -> ort.InferenceSession:
    options, levels = ort.SessionOptions(), ort.GraphOptimizationLevel
    options.graph_optimization_level = levels.ORT_ENABLE_ALL if optimized else levels.ORT_DISABLE_ALL
    options.add_session_config_entry("session.x64quantprecision", "1")
    options.intra_op_num_threads = 1
    return ort.InferenceSession(graph, options, providers=["CPUExecutionProvider"])


def is_equal(graph: bytes, given: Sequence[Pass], *, optimized: bool) -> bool:
    session = session_of(graph, optimized=optimized)
    steps, blends = [], []
    for one in given:
        logits, blend = session.run(["logits", "blend_parameters"], one.feeds)
        assert logits.shape == one.logits.shape
        assert blend.shape == one.blend_parameters.shape
        steps.append(np.abs(logits - one.logits).ravel() / step_of(graph))
        blends.append(np.abs(blend - one.blend_parameters).ravel())
    step, off = np.concatenate(steps), np.concatenate(blends)
    mean, quantile = OPTIMIZED if optimized else AS_WRITTEN
    logits_agree = (step < 0.5).mean() >= EQUAL[optimized] and (step < 1.5).mean() >= NEAR
    return bool(logits_agree and off.mean() <= mean and np.quantile(off, 0.999) <= quantile)


@cache
def step_of(graph: bytes) -> float:
    """Last bit of the logits: the scale that they are dequantized by."""
    model = onnx.load_from_string(graph)
    [node] = [node for node in model.graph.node if node.output[0] == "logits"]
    assert node.op_type == "DequantizeLinear"
    return float(constants_of(model)[node.input[1]])


def constants_of(model: onnx.ModelProto) -> dict[str, NDArray[np.generic]]:
    return {tensor.name: numpy_helper.to_array(tensor) for tensor in model.graph.initializer}


@pytest.mark.parametrize("name", NAMES)
def test_the_shipped_int8_graph_is_made_of_the_shipped_network_and_its_int8_weights(name: str) -> None:
    folder = find_model(name)
    made = quantized_network(onnx.load(folder / "network.onnx"), (folder / "network.npz").read_bytes())
    hint = f"run: supersampler export {name} -o {folder}"
    assert (folder / "network.int8.onnx").read_bytes() == made.SerializeToString(deterministic=True), hint


@pytest.mark.parametrize("name", NAMES)
def test_the_int8_graph_has_the_inputs_and_outputs_of_the_network(name: str) -> None:
    float_graph, int8_graph = (
        onnx.load(find_model(name) / file).graph for file in ("network.onnx", "network.int8.onnx")
    )
    assert list(int8_graph.input) == list(float_graph.input)
    assert list(int8_graph.output) == list(float_graph.output)


@pytest.mark.parametrize("name", NAMES)
def test_the_network_computes_what_torch_computes_on_the_inputs_of_real_frames(name: str) -> None:
    fused = load_method(name).subgraph()
    assert fused is not None
    session = session_of((find_model(name) / "network.onnx").read_bytes(), optimized=True)
    for one in all_passes(name):
        with torch.no_grad():
            ours = fused.module(*map(torch.from_numpy, (one.packed, one.half_inputs)))
        for tensor, other in zip(ours, session.run(list(fused.outputs), one.feeds), strict=True):
            off = np.abs(tensor.numpy() - other) / np.abs(other).max()
            assert off.mean() <= TORCH[0]
            assert np.quantile(off, 0.999) <= TORCH[1]
            assert off.max() <= TORCH[2]


@pytest.mark.parametrize("optimized", [False, True])
@pytest.mark.parametrize("name", NAMES)
def test_the_int8_graph_computes_what_the_cpu_backend_computes(name: str, optimized: bool) -> None:
    graph = (find_model(name) / "network.int8.onnx").read_bytes()
    assert is_equal(graph, all_passes(name), optimized=optimized)


def test_a_scale_that_is_off_by_two_percent_is_noticed_in_every_layer() -> None:
    content, given = (
        (find_model("classifier") / "network.int8.onnx").read_bytes(),
        passes("classifier", DISPLAYS[0]),
    )
    scales = [name for name in constants_of(onnx.load_from_string(content)) if name.endswith("weight.scale")]
    assert len(scales) == 16
    for name in scales:
        model = onnx.load_from_string(content)
        [tensor] = [tensor for tensor in model.graph.initializer if tensor.name == name]
        tensor.CopyFrom(numpy_helper.from_array(numpy_helper.to_array(tensor) * np.float32(1.02), name))
        assert not is_equal(model.SerializeToString(), given, optimized=False), name
