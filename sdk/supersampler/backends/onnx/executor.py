"""`OnnxExecutor`: runs a step as one graph in ONNX Runtime; the history stays on the device."""

import math
from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from supersampler.backends.base import ForkSafeLock, StepReport
from supersampler.backends.onnx.cuda_graph import FixedStep
from supersampler.backends.onnx.providers import capturing, check_provider_in_use, device_of
from supersampler.backends.onnx.runtime import ort
from supersampler.backends.onnx.session import (
    VECTORS,
    frame_inputs,
    open_session,
    running,
    session_options,
)
from supersampler.backends.onnx.tensors import check_tensor, render_size_of
from supersampler.frame import Float32, Frame, Size
from supersampler.methods.model_info import ModelInfo

Tensors = dict[str, ort.OrtValue]


class OnnxExecutor:
    """Runs a graph of the whole step; see `Executor`.

    Args:
        info: the model.
        threads: number of CPU threads; 0 uses every core.
        providers: execution providers, in order of preference.
        precision: key of the graph in `ModelInfo.steps`.
        capture: see `Model.load`.

    Attributes:
        capture: see `Model.load`.
        providers: the providers in use.
        device: device of the buffers; see `device_of`.
    """

    name = "onnx"

    def __init__(
        self, info: ModelInfo, threads: int, providers: Sequence[str], precision: str, *, capture: bool
    ) -> None:
        if capture:
            capturing(providers)  # raises before a graph is loaded
        self._info, self._threads, self.precision, self.capture = info, threads, precision, capture
        self._path, options = info.steps[precision], session_options(threads)
        self._session = open_session(self._path, options, providers, takes=info.takes, gives=info.gives)
        self.providers: list[str] = self._session.get_providers()
        check_provider_in_use(providers[0], self.providers)
        self.device = device_of(self.providers[0])
        self._fixed: FixedStep | None = None
        self._lock = ForkSafeLock()  # of `_fixed`

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

    def step(
        self,
        frame: Frame,
        display: Size,
        history: Tensors,
        next_history: Tensors,
        image: Float32,
        aux_outputs: Collection[str],
        *,
        adds_samples: float,
        skip: bool,  # noqa: ARG002  # a graph computes every pixel
    ) -> StepReport:
        """See `Executor`."""
        planes = np.empty((1, 3, *display[::-1]), np.float32)
        outputs = {
            t.name: np.empty(t.shape_for(render=display, display=display, previous=display), np.float32)
            for t in self._info.aux_outputs
            if t.name in aux_outputs
        }
        names = [t.name for t in self._info.inputs]
        given = frame_inputs(frame, display, names, adds_samples=adds_samples)
        results = _values({**outputs, self._info.image.name: planes})
        self._run(_values(given), history, next_history, results)
        np.copyto(image, planes[0].transpose(1, 2, 0))
        return StepReport(outputs)

    def step_tensors(
        self,
        given: Tensors,
        display: Size,
        history: Tensors,
        next_history: Tensors,
        image: ort.OrtValue | None,
    ) -> ort.OrtValue:
        """Upscale a frame on the device to an image on the device.

        Args:
            given: inputs of the graph.
            display: (W, H).
            history: history after the previous frame; not changed.
            next_history: written to; not `history`.
            image: (1, 3, H, W), written to; None allocates it.

        Raises:
            FrameError: an input or `image` has a wrong type or shape, or is on another device.
        """
        info = self._info
        render = render_size_of(given["color"])
        sizes = {"render": render, "display": display, "previous": render}
        if image is None:
            shape = info.image.shape_for(**sizes)
            image = ort.OrtValue.ortvalue_from_shape_and_type(list(shape), np.float32, self.device, 0)
        for tensor in (*(t for t in info.inputs if t.name not in VECTORS), info.image):
            value = image if tensor is info.image else given[tensor.name]
            check_tensor(value, tensor, tensor.shape_for(**sizes), self.device)
        if self.capture and self.fits(history, display, render):  # else the render size has changed
            with self._lock.lock:
                fixed = self._fixed_step(display, render)
                fixed.run({**given, **history}, {**next_history, info.image.name: image})
        else:
            self._run(given, history, next_history, {info.image.name: image})
        return image

    def _fixed_step(self, display: Size, render: Size) -> FixedStep:
        if self._fixed is None or self._fixed.sizes != (display, render):
            self._fixed = None  # frees its memory first
            setup = self._info, self._path, self.providers, self._threads, self.device
            self._fixed = FixedStep(*setup, display=display, render=render)
        return self._fixed

    def _run(self, given: Tensors, history: Tensors, next_history: Tensors, results: Tensors) -> None:
        binding = self._session.io_binding()
        for name, value in given.items():
            binding.bind_ortvalue_input(name, value)
        for h in self._info.history:
            binding.bind_ortvalue_input(h.input.name, history[h.input.name])
            binding.bind_ortvalue_output(h.output, next_history[h.input.name])
        for name, value in results.items():
            binding.bind_ortvalue_output(name, value)
        with running(self._path):
            binding.synchronize_inputs()  # other libraries may have written on their own streams
            self._session.run_with_iobinding(binding)
            binding.synchronize_outputs()

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
        sizes = {"render": render, "display": display, "previous": render}
        return {h.input.name: h.input.shape_for(**sizes) for h in self._info.history}


def _values(arrays: Mapping[str, np.ndarray[Any, Any]]) -> Tensors:
    """Return arrays as values of ONNX Runtime, which share their memory."""
    return {name: ort.OrtValue.ortvalue_from_numpy(array) for name, array in arrays.items()}
