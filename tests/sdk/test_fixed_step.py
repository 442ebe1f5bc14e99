"""Steps on fixed buffers, which graph capture needs, compute the same images as all others."""

import functools
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import onnxruntime as ort
import pytest
import torch
from numpy.typing import NDArray
from onnx import TensorProto

from cuda_kernels import CPU_INPUTS, CUDA_KERNELS
from noise import noise
from shared_models import shared_model
from supersampler import ArgumentError, Frame, FrameError, Model, Upscaler
from supersampler.backends.onnx.cuda_graph import with_display_size
from supersampler.backends.onnx.executor import OnnxExecutor
from supersampler.backends.onnx.runtime import NAMES, capturing, precise
from supersampler.backends.onnx.tensors import tensors_of_frame
from supersampler.errors import ProviderError
from supersampler.methods.model_file import extrapolation_names, find_model, model_names, read_model_info
from supersampler.methods.model_info import extents

DISPLAY = (63, 35)
METHODS = ["bilinear", "taau", "classifier-small"]


@functools.cache
def load(method: str, *, capture: bool = False) -> Model:
    return shared_model(method, providers="cpu", executor="onnx", capture=capture)


@pytest.fixture(scope="module", params=METHODS)
def models(request: pytest.FixtureRequest) -> tuple[Model, Model]:
    """One that runs steps on what comes, and one that runs them on what stays where it is."""
    return load(request.param), load(request.param, capture=True)


def upscaler(model: Model, **options: Any) -> Upscaler:
    return Upscaler(model, **{"display_size": DISPLAY, **options}, validate="off")


def image_of(one: Upscaler, frame: Frame, **options: Any) -> NDArray[np.float32]:
    """The image of a frame in tensors that are new each time."""
    tensors = tensors_of_frame(frame, "cpu")
    image = one.step_tensors(
        tensors, jitter=frame.jitter, exposure=frame.exposure, reset=frame.reset, **options
    )
    return np.array(np.from_dlpack(image))


def test_a_fixed_step_computes_bit_for_bit_what_a_step_computes(models: tuple[Model, Model]) -> None:
    plain, fixed = map(upscaler, models)
    for seed in (1, 2, 3, 0, 4, 5):  # the frame of seed 0 resets
        frame = noise(seed, exposure=None if seed == 2 else 0.5 + seed)
        np.testing.assert_array_equal(image_of(fixed, frame), image_of(plain, frame))
    for name, history in plain.save_state().history.items():  # type: ignore[union-attr]
        np.testing.assert_array_equal(fixed.save_state().history[name], history)  # type: ignore[index]


def test_the_render_size_may_change_and_change_back(models: tuple[Model, Model]) -> None:
    plain, fixed = map(upscaler, models)
    for seed, size in enumerate([(32, 18), (32, 18), (40, 23), (40, 23), (32, 18), (32, 18)], start=1):
        frame = noise(seed, size)
        np.testing.assert_array_equal(image_of(fixed, frame), image_of(plain, frame))


def test_a_state_goes_on_where_it_was_saved(models: tuple[Model, Model]) -> None:
    plain, fixed = map(upscaler, models)
    for one in (plain, fixed):
        image_of(one, noise(1))
    plain_state, fixed_state = plain.save_state(), fixed.save_state()
    expected = image_of(plain, noise(2))
    image_of(fixed, noise(3))
    fixed.load_state(plain_state)
    np.testing.assert_array_equal(image_of(fixed, noise(2)), expected)
    plain.load_state(fixed_state)
    np.testing.assert_array_equal(image_of(plain, noise(2)), expected)


@pytest.mark.parametrize("other", [DISPLAY, (80, 45)])
def test_upscalers_that_share_a_model_do_not_see_each_other(
    models: tuple[Model, Model], other: tuple[int, int]
) -> None:
    plain = [upscaler(models[0]), upscaler(models[0], display_size=other)]
    fixed = [upscaler(models[1]), upscaler(models[1], display_size=other)]
    for seed in range(1, 4):
        for which in (0, 1):
            frame = noise(10 * which + seed, (40, 23))
            np.testing.assert_array_equal(image_of(fixed[which], frame), image_of(plain[which], frame))


def test_upscalers_that_share_a_model_may_step_in_parallel() -> None:
    model, frames = load("taau", capture=True), [noise(seed) for seed in range(1, 6)]

    def shot(_: int) -> list[NDArray[np.float32]]:
        one = upscaler(model)
        return [image_of(one, frame) for frame in frames]

    with ThreadPoolExecutor(3) as pool:
        alone, *others = pool.map(shot, range(4))
    plain = upscaler(load("taau"))
    for index, frame in enumerate(frames):
        expected = image_of(plain, frame)
        assert all(np.array_equal(images[index], expected) for images in (alone, *others))


def test_an_image_is_kept_by_who_has_it_or_written_where_it_is_wanted() -> None:
    fixed, out = upscaler(load("taau", capture=True)), torch.zeros(1, 3, *DISPLAY[::-1])
    first = fixed.step_tensors(tensors_of_frame(noise(1), "cpu"), jitter=(0.0, 0.0))
    kept = np.from_dlpack(first).copy()
    assert fixed.step_tensors(tensors_of_frame(noise(2), "cpu"), jitter=(0.0, 0.0), out=out) is out
    np.testing.assert_array_equal(np.from_dlpack(first), kept)
    assert not np.array_equal(out.numpy(), kept)


def test_arrays_and_tensors_may_take_turns() -> None:
    plain, fixed = upscaler(load("taau")), upscaler(load("taau", capture=True))
    for seed in range(1, 5):
        frame = noise(seed)
        expected = plain.step(frame)
        image = image_of(fixed, frame)[0].transpose(1, 2, 0) if seed % 2 else fixed.step(frame)
        np.testing.assert_array_equal(image, expected)


def test_a_tensor_that_does_not_fit_leaves_the_history_as_it_was() -> None:
    plain, fixed = upscaler(load("taau")), upscaler(load("taau", capture=True))
    for one in (plain, fixed):
        image_of(one, noise(1))
    tensors = tensors_of_frame(noise(2), "cpu")
    with pytest.raises(FrameError, match=r"frame\.depth is"):
        fixed.step_tensors({**tensors, "depth": tensors["color"]}, jitter=(0.0, 0.0))
    np.testing.assert_array_equal(image_of(fixed, noise(2)), image_of(plain, noise(2)))


def test_warming_up_makes_what_the_first_step_runs(monkeypatch: pytest.MonkeyPatch) -> None:
    fixed = upscaler(load("taau", capture=True), display_size=(50, 30))
    expected = image_of(upscaler(load("taau"), display_size=(50, 30)), noise(1))
    fixed.warm_up((32, 18))
    monkeypatch.setattr("supersampler.backends.onnx.executor.FixedStep", None)  # no other is made
    monkeypatch.setattr("supersampler.backends.onnx.executor.OnnxExecutor._run", None)
    np.testing.assert_array_equal(image_of(fixed, noise(1)), expected)


def test_a_run_may_be_repeated_as_it_is_before_it_is_captured(
    models: tuple[Model, Model], monkeypatch: pytest.MonkeyPatch
) -> None:
    plain, fixed = map(upscaler, models)
    expected = [image_of(plain, noise(seed)) for seed in (1, 2)]
    run = ort.InferenceSession.run_with_iobinding

    def run_thrice(self: ort.InferenceSession, binding: ort.IOBinding) -> None:
        for _ in range(3):
            run(self, binding)

    monkeypatch.setattr(ort.InferenceSession, "run_with_iobinding", run_thrice)
    for seed in (1, 2):
        np.testing.assert_array_equal(image_of(fixed, noise(seed)), expected[seed - 1])


def test_only_graphs_are_captured() -> None:
    assert Model.load("taau", providers="cpu", capture=True).executor == "onnx"
    with pytest.raises(ArgumentError, match=r"capture=True.*Only graphs are captured"):
        Model.load("taau", providers="cpu", executor="cpu", capture=True)
    with pytest.raises(ArgumentError, match="capture is set beside a Model"):
        Upscaler(load("taau"), display_size=DISPLAY, capture=True)


def test_the_first_provider_is_told_to_capture_or_is_refused() -> None:
    cuda, cpu = NAMES["cuda"], NAMES["cpu"]
    assert capturing([cuda, cpu]) == [(cuda, {"enable_cuda_graph": "1"}), (cpu, {})]
    assert capturing([NAMES["tensorrt"], cuda])[1] == (cuda, {})
    assert capturing([cpu]) == [(cpu, {})]
    with pytest.raises(ProviderError, match="DmlExecutionProvider cannot capture a step; CUDA"):
        OnnxExecutor(load("taau").info, 1, [NAMES["directml"]], "fp32", capture=True)


def test_products_on_cuda_are_of_full_precision() -> None:
    cuda, cpu = NAMES["cuda"], NAMES["cpu"]
    captured = (cuda, {"use_tf32": "0", "enable_cuda_graph": "1"})
    assert precise(capturing([cuda, cpu])) == [captured, cpu]
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
    graph = path.read_bytes()
    if "display_size" in [value.name for value in onnx.load(path).graph.input]:
        graph = with_display_size(graph, display)
    ort.InferenceSession(graph, options, providers=["CPUExecutionProvider"])
    return onnx.load(optimized).graph


@pytest.mark.parametrize("path", graphs())
def test_all_that_is_left_of_a_graph_at_one_size_runs_on_cuda(path: Path, tmp_path: Path) -> None:
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
