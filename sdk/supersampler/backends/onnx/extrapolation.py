"""Backends that extrapolate unshaded frames: the protocol, and ONNX Runtime."""

from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from supersampler.backends.onnx.providers import check_provider_in_use, device_of
from supersampler.backends.onnx.runtime import ort
from supersampler.backends.onnx.session import frame_inputs, open_session, pixels_of, running, session_options
from supersampler.frame import Float32, Frame
from supersampler.methods.model_info import ModelInfo


class ExtrapolationExecutor(Protocol):
    """Runs a model that extrapolates; keeps no state between calls.

    Attributes:
        name: "onnx" or "cpu".
    """

    name: str

    def upload(self, array: NDArray[Any]) -> Any:
        """Return a history tensor made from an array, which may share its memory."""

    def download(self, tensor: Any) -> NDArray[Any]:
        """Return a copy of a history tensor as an array."""

    def extrapolate(self, frame: Frame, history: Mapping[str, Any]) -> tuple[Float32, Mapping[str, Any]]:
        """Return the colour of a checked unshaded frame, (h, w, 3), and the next history."""


class OnnxExtrapolation:
    """Extrapolates with ONNX Runtime; see `ExtrapolationExecutor`.

    Args:
        info: the model.
        providers: execution providers, in order of preference.
        threads: number of CPU threads; 0 uses every core.

    Raises:
        ModelError: ONNX Runtime cannot load the graph.
        ProviderError: a provider cannot start.
    """

    name = "onnx"

    def __init__(self, info: ModelInfo, providers: Sequence[str], threads: int) -> None:
        self._info = info
        path, options = info.steps["fp32"], session_options(threads)
        self._session = open_session(path, options, providers, takes=info.takes, gives=info.gives)
        used = self._session.get_providers()
        check_provider_in_use(providers[0], used)
        self._device = device_of(used[0])

    def upload(self, array: NDArray[Any]) -> ort.OrtValue:
        """See `ExtrapolationExecutor`."""
        return ort.OrtValue.ortvalue_from_numpy(array, self._device, 0)

    def download(self, tensor: ort.OrtValue) -> NDArray[Any]:
        """See `ExtrapolationExecutor`."""
        return np.array(tensor.numpy())

    def extrapolate(
        self, frame: Frame, history: Mapping[str, ort.OrtValue]
    ) -> tuple[Float32, Mapping[str, ort.OrtValue]]:
        """See `ExtrapolationExecutor`."""
        inputs = frame_inputs(frame, frame.size, [tensor.name for tensor in self._info.inputs])
        planes = np.empty((1, 3, *frame.size[::-1]), np.float32)
        binding = self._session.io_binding()
        for name, array in inputs.items():
            binding.bind_ortvalue_input(name, ort.OrtValue.ortvalue_from_numpy(array))
        for name, value in history.items():
            binding.bind_ortvalue_input(name, value)
        for entry in self._info.history:
            binding.bind_output(entry.output, self._device)
        binding.bind_ortvalue_output(self._info.image.name, ort.OrtValue.ortvalue_from_numpy(planes))
        with running(self._info.steps["fp32"]):
            binding.synchronize_inputs()
            self._session.run_with_iobinding(binding)
            binding.synchronize_outputs()
        names = [entry.input.name for entry in self._info.history]
        return pixels_of(planes), dict(zip(names, binding.get_outputs()[: len(names)], strict=True))
