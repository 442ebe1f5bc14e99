"""The whole step as one graph in ONNX Runtime; the history stays on its device."""

import math
from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np
import onnxruntime as ort
from numpy.typing import NDArray

from supersampler.frame import Float32, Frame, Size
from supersampler.graph_session import frame_inputs, open_session
from supersampler.host.layout import TILE
from supersampler.model_info import ModelInfo, TensorInfo
from supersampler.providers import check_provider_in_use

_DEVICES = {
    "CUDAExecutionProvider": "cuda",
    "TensorrtExecutionProvider": "cuda",
    "DmlExecutionProvider": "dml",
}
Tensors = dict[str, ort.OrtValue]


class GraphExecutor:
    """Runs `step.onnx`; see `Executor`.

    Args:
        info: the model.
        options: of the session.
        providers: execution providers, in order.

    Attributes:
        providers: those in use.
    """

    name, precision = "graph", "fp32"

    def __init__(self, info: ModelInfo, options: ort.SessionOptions, providers: Sequence[str]) -> None:
        self._info = info
        self._session = open_session(info.step_path, options, providers)
        self.providers: list[str] = self._session.get_providers()
        check_provider_in_use(providers[0], self.providers)
        self._device = _DEVICES.get(self.providers[0], "cpu")

    def zeros(self, display: Size, render: Size) -> Tensors:
        """See `Executor`."""
        return {h.input.name: self._zeros(h.input, display, render) for h in self._info.history}

    def fits(self, buffers: Tensors, display: Size, render: Size) -> bool:
        """See `Executor`."""
        shapes = [
            h.input.shape_for(render=render, display=display, previous=render) for h in self._info.history
        ]
        return [list(t.shape()) for t in buffers.values()] == [list(shape) for shape in shapes]

    def step(
        self,
        frame: Frame,
        display: Size,
        past: Tensors,
        left: Tensors,
        image: Float32,
        told: Collection[str],
        *,
        tolerance: float | None,  # noqa: ARG002  # a graph draws all
    ) -> Mapping[str, Float32]:
        """See `Executor`."""
        planes = np.empty((1, 3, *display[::-1]), np.float32)
        outputs = {
            t.name: np.empty(t.shape_for(render=display, display=display, previous=display), np.float32)
            for t in self._info.told
            if t.name in told
        }
        binding = self._session.io_binding()
        for name, array in frame_inputs(frame, display, [t.name for t in self._info.inputs]).items():
            binding.bind_cpu_input(name, array)
        for h in self._info.history:
            binding.bind_ortvalue_input(h.input.name, past[h.input.name])
            binding.bind_ortvalue_output(h.output, left[h.input.name])
        for name, array in ((self._info.image.name, planes), *outputs.items()):
            binding.bind_ortvalue_output(name, ort.OrtValue.ortvalue_from_numpy(array))
        self._session.run_with_iobinding(binding)
        np.copyto(image, planes[0].transpose(1, 2, 0))
        return outputs

    def needs(self, display: Size, render: Size) -> tuple[int, int | None]:
        """See `Executor`."""
        shapes = (
            h.input.shape_for(render=render, display=display, previous=render) for h in self._info.history
        )
        return sum(math.prod(shape) * np.float32().itemsize for shape in shapes), None

    def note_stages(self) -> Mapping[str, float]:
        """See `Executor`."""
        return {}

    def tensor(self, buffers: Tensors, name: str) -> Float32:
        """See `Executor`."""
        return np.asarray(buffers[name].numpy())

    def memory(self, buffers: Tensors) -> Mapping[str, NDArray[Any]]:  # noqa: ARG002  # nothing
        """See `Executor`."""
        return {}

    def work(self, buffers: Tensors, display: Size) -> Float32:  # noqa: ARG002  # all of it
        """See `Executor`."""
        return np.ones([-(-extent // TILE) for extent in display[::-1]], np.float32)

    def load(self, buffers: Tensors, tensors: Mapping[str, NDArray[Any]]) -> None:
        """See `Executor`."""
        for name, tensor in buffers.items():
            tensor.update_inplace(np.ascontiguousarray(tensors[name], np.float32))

    def _zeros(self, tensor: TensorInfo, display: Size, render: Size) -> ort.OrtValue:
        shape = tensor.shape_for(render=render, display=display, previous=render)
        return ort.OrtValue.ortvalue_from_numpy(np.zeros(shape, np.float32), self._device, 0)
