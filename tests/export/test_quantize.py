"""Quantised networks: layers, ranges and graphs."""

import itertools
from collections.abc import Callable, Iterable, Sequence
from functools import cache
from typing import Any, NamedTuple, cast

import numpy as np
import onnx
import pytest
import torch
from numpy.typing import NDArray
from onnx import numpy_helper

from shared_models import shared_model
from supersampler import Frame, Model, Shot
from supersampler.backends.cpu.executor import CpuExecutor
from supersampler.backends.onnx.runtime import ort
from supersampler.frame import Float32, Size
from supersampler.methods.classifier.spec import CLASSES, DEFAULT_INPUTS, Variant
from supersampler.methods.model_file import find_model, model_names, read_model_info
from supersampler.methods.spec import half_size, large_size
from supersampler_bench.specs import with_default_gbuffers
from supersampler_export.quantized_graph import quantized_network
from supersampler_model.methods import load_method
from supersampler_model.methods.classifier import Classifier
from supersampler_model.methods.classifier_network import pack
from supersampler_model.ops.images import Size as ModelSize
from torch_inputs import step_by_name, tensors_of

Bytes = NDArray[np.uint8]
SIGNED = slice(4 * DEFAULT_INPUTS.index("depth_difference"), 4 * DEFAULT_INPUTS.index("depth_difference") + 4)
"""Planes of `packed` in [-1, 1]; all other inputs are in [0, 1]."""


class Pass(NamedTuple):
    """One run of the network: inputs and outputs as `network.onnx` has them."""

    packed: Float32
    half_inputs: Float32
    logits: Float32
    blend_parameters: Float32

    @property
    def feeds(self) -> dict[str, Float32]:
        return {"packed": self.packed, "half_inputs": self.half_inputs}


def pass_of(model: Model, codes: Bytes) -> Pass:
    """Run the network on inputs as bytes, (half height, half width, 72)."""
    executor = model._executor
    assert isinstance(executor, CpuExecutor)
    height, width = codes.shape[:2]
    variant = Variant.of(model.info.config)
    outputs = 4 * variant.blend_parameters
    values = np.empty((outputs + CLASSES, height, width), np.float32)
    given = np.ascontiguousarray(codes)
    executor._library.call(
        "ss_run_network", executor._model.handle, given.ctypes.data, width, height, values.ctypes.data
    )
    planes = codes.transpose(2, 0, 1) * np.float32(1.0 / 255.0)
    planes[SIGNED] = 2.0 * planes[SIGNED] - 1.0
    return Pass(planes[None, :64], planes[None, 64:], values[None, outputs:], values[None, :outputs])


def inputs_of(
    method: Classifier, frames: Iterable[Frame], display: Size, patch: pytest.MonkeyPatch
) -> list[Bytes]:
    """Step frames in torch; return the inputs of its network as bytes, (half height, half width, 72)."""
    found: list[Bytes] = []
    infer = cast("Callable[..., tuple[torch.Tensor, torch.Tensor]]", method.net.on_pixels)
    history: Any = None
    width, height = half_size(large_size(display) if method.larger else display)

    def keep(pixels: Sequence[torch.Tensor], half_inputs: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        planes = torch.cat([pack(torch.cat([*pixels], dim=1)), half_inputs], dim=1)[0].numpy().copy()
        planes[SIGNED] = 0.5 + 0.5 * planes[SIGNED]
        codes = np.floor(planes.clip(0.0, 1.0) * 255.0 + 0.5).astype(np.uint8)
        found.append(codes[:, :height, :width].transpose(1, 2, 0))
        return infer(pixels, half_inputs)

    patch.setattr(method.net, "on_pixels", keep)
    for frame in frames:
        if history is None:
            history = method.first_history(ModelSize(*display), ModelSize(*frame.size))
        _, history, _ = step_by_name(method, tensors_of(frame, display, method.inputs()), history)
    return found


NAMES = [name for name in model_names() if "network.int8.onnx" in read_model_info(find_model(name)).files]
DISPLAYS = [(321, 181), (322, 180)]
"""Odd, so that the last packed row and column repeat, and in no multiple of 8 packed pixels; even."""
FRAMES = 2
AS_WRITTEN, OPTIMIZED = (0.002, 0.1), (0.03, 0.25)
"""Bounds for blend parameters, about -6 to 6: mean difference and its 99.9 % quantile. A session without
optimizations computes convolutions in floats; the default one rounds biases to int32."""
EQUAL, NEAR = {False: 0.98, True: 0.8}, 0.999
"""Share of logits that are equal (True: optimized), and within one step of their last bit."""


@cache
def passes(name: str, display: tuple[int, int]) -> list[Pass]:
    model = shared_model(name, "cpu")
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
    return pass_of(shared_model(name, "cpu"), codes)


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


@pytest.mark.long  # opens graphs
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
