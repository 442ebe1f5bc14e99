"""Executors in ONNX Runtime: steps, extrapolation, and the blending of AOVs."""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from supersampler.backends.base import AovRequest, ForkSafeLock, StepReport, StepRequest
from supersampler.backends.onnx import session as sessions
from supersampler.backends.onnx.runtime import device_of, ort
from supersampler.backends.onnx.tensors import check_tensor, render_size_of
from supersampler.errors import ArgumentError, ModelError
from supersampler.frame import Float32, Frame, Size
from supersampler.methods.aovs.spec import AOVS, UNKNOWN
from supersampler.methods.model_info import ModelInfo, TensorInfo
from supersampler.methods.spec import TENSORS, dtype_of

Tensors = dict[str, "ort.OrtValue"]


class OnnxExecutor:
    """Runs a graph of the whole step; see `Executor`.

    `precision` is a key of `ModelInfo.steps`. `device` is the device of the buffers; see `device_of`.
    """

    name = "onnx"

    def __init__(self, info: ModelInfo, threads: int, providers: Sequence[str], precision: str) -> None:
        self._info, self.precision = info, precision
        self._path = info.steps[precision]
        self._session = _open(info, self._path, threads, providers)
        self.providers: list[str] = self._session.get_providers()
        self.device = device_of(self.providers[0])

    def zeros(self, display: Size, render: Size) -> Tensors:
        """See `Executor`."""
        return {
            name: ort.OrtValue.ortvalue_from_numpy(np.zeros(shape, np.float32), self.device, 0)
            for name, shape in self._history_shapes(display, render).items()
        }

    def fits(self, buffers: Tensors, display: Size, render: Size) -> bool:
        """See `Executor`."""
        shapes = {name: tuple(tensor.shape()) for name, tensor in buffers.items()}
        return shapes == self._history_shapes(display, render)

    def step_many(self, steps: Sequence[StepRequest]) -> list[StepReport]:
        """See `Executor`."""
        return [self._step(request) for request in steps]

    def _step(self, request: StepRequest) -> StepReport:
        frame, display = request.frame, request.display
        planes = np.empty((1, 3, *display[::-1]), np.float32)
        outputs = {
            t.name: np.empty(t.shape_for(render=display, display=display), np.float32)
            for t in self._info.aux_outputs
            if t.name in request.aux_outputs
        }
        names = [t.name for t in self._info.inputs]
        given = sessions.frame_inputs(frame, display, names, adds_samples=request.adds_samples)
        results = _values({**outputs, self._info.image.name: planes})
        self._run(_values(given), request.history, request.next_history, results)
        np.copyto(request.image, planes[0].transpose(1, 2, 0))
        return StepReport(outputs)

    def step_tensors(
        self,
        given: Tensors,
        display: Size,
        history: Tensors,
        next_history: Tensors,
        image: "ort.OrtValue | None",
    ) -> "ort.OrtValue":
        """Upscale a frame on the device to an image on the device.

        `given` has all inputs of the graph. The image is (1, 3, H, W); None allocates it.

        Raises:
            FrameError: an input has a wrong type or shape, or is on another device.
            ArgumentError: `image`, which the caller calls "out", has.
        """
        info = self._info
        render = render_size_of(given["color"])
        for tensor in (t for t in info.inputs if t.name not in sessions.VECTORS):
            shape = tensor.shape_for(render=render, display=display)
            check_tensor(given[tensor.name], tensor, shape, self.device, tensor.name)
        shape = info.image.shape_for(render=render, display=display)
        if image is None:
            image = ort.OrtValue.ortvalue_from_shape_and_type(list(shape), np.float32, self.device, 0)
        check_tensor(image, info.image, shape, self.device, "out", ArgumentError)
        self._run(given, history, next_history, {info.image.name: image})
        return image

    def _run(self, given: Tensors, history: Tensors, next_history: Tensors, results: Tensors) -> None:
        written = {h.output: next_history[h.name] for h in self._info.history}
        sessions.run_bound(self._session, self._path, {**given, **history}, {**written, **results})

    def required_bytes(self, display: Size, render: Size) -> tuple[int, int | None]:
        """See `Executor`."""
        shapes = self._history_shapes(display, render).values()
        return sum(math.prod(shape) * np.float32().itemsize for shape in shapes), None

    def tensor(self, buffers: Tensors, name: str) -> Float32:
        """See `Executor`."""
        return np.asarray(buffers[name].numpy())

    def load(self, buffers: Tensors, tensors: Mapping[str, NDArray[Any]]) -> None:
        """See `Executor`."""
        for name, tensor in buffers.items():
            tensor.update_inplace(np.ascontiguousarray(tensors[name], np.float32))

    def _history_shapes(self, display: Size, render: Size) -> dict[str, tuple[int, ...]]:
        return {h.name: h.shape_for(render=render, display=display) for h in self._info.history}


def _open(info: ModelInfo, path: Path, threads: int, providers: Sequence[str]) -> "ort.InferenceSession":
    """Load a graph of a model; see `open_session`."""
    inputs, outputs = info.graph_inputs, info.graph_outputs
    return sessions.open_session(path, threads, providers, method=info.method, inputs=inputs, outputs=outputs)


def _values(arrays: Mapping[str, np.ndarray[Any, Any]]) -> Tensors:
    """Return arrays as values of ONNX Runtime, which share their memory."""
    return {name: ort.OrtValue.ortvalue_from_numpy(array) for name, array in arrays.items()}


class OnnxExtrapolation:
    """Extrapolates with ONNX Runtime; see `ExtrapolationExecutor`."""

    name = "onnx"

    def __init__(self, info: ModelInfo, providers: Sequence[str], threads: int) -> None:
        self._info, self._path = info, info.steps["fp32"]
        self._session = _open(info, self._path, threads, providers)
        self._device = device_of(self._session.get_providers()[0])

    def upload(self, array: NDArray[Any]) -> "ort.OrtValue":
        """See `ExtrapolationExecutor`."""
        return ort.OrtValue.ortvalue_from_numpy(array, self._device, 0)

    def download(self, tensor: "ort.OrtValue") -> NDArray[Any]:
        """See `ExtrapolationExecutor`."""
        return np.array(tensor.numpy())

    def extrapolate(
        self, frame: Frame, history: "Mapping[str, ort.OrtValue]"
    ) -> "tuple[Float32, Mapping[str, ort.OrtValue]]":
        """See `ExtrapolationExecutor`."""
        inputs = sessions.frame_inputs(frame, frame.size, [tensor.name for tensor in self._info.inputs])
        planes = np.empty((1, 3, *frame.size[::-1]), np.float32)
        names = [entry.name for entry in self._info.history]
        outputs: dict[str, Any] = {entry.output: self._device for entry in self._info.history}
        outputs[self._info.image.name] = ort.OrtValue.ortvalue_from_numpy(planes)
        binding = sessions.run_bound(self._session, self._path, {**_values(inputs), **history}, outputs)
        return sessions.pixels_of(planes), dict(zip(names, binding.get_outputs()[: len(names)], strict=True))


_INPUTS = [
    *(TensorInfo(name, dtype_of(name), TENSORS[name]) for name in AOVS.inputs),
    *(TensorInfo(name, "float32", shape) for name, shape in AOVS.graph_history.items()),
]
_OUTPUTS = [TensorInfo("image", "float32", AOVS.image)]


class AovBlender:
    """Runs a model's graph for AOVs, loaded on first use; threads may share it."""

    def __init__(self, info: ModelInfo, threads: int) -> None:
        self._path, self._threads = info.aovs_path, threads
        self._lock = ForkSafeLock()
        self._session: ort.InferenceSession | None = None

    def blend(self, request: AovRequest) -> Float32:
        """Return the AOVs at display size, blended with their history, (1, k, H, W)."""
        frame, display, weight, history = request
        inputs = sessions.frame_inputs(frame, display, ("aovs", "depth", "motion", "jitter", "display_size"))
        shape = (1, inputs["aovs"].shape[1], *display[::-1])
        inputs |= {
            "weight": np.zeros((1, 1, *shape[2:]), np.float32) if weight is None else weight,
            "history.aovs": np.full(shape, UNKNOWN, np.float32) if history is None else history,
        }
        session = self._loaded()
        with sessions.running(self._path):
            image: Float32 = session.run(["image"], inputs)[0]
        if image.shape != shape:
            raise ModelError(f"{self._path}: gives {image.shape} for 'image'; want {shape}.")
        return image

    def _loaded(self) -> "ort.InferenceSession":
        with self._lock.lock:
            if self._session is None:
                self._session = sessions.open_session(
                    self._path, self._threads, ["CPUExecutionProvider"], inputs=_INPUTS, outputs=_OUTPUTS
                )
            return self._session
