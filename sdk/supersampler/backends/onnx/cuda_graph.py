"""`FixedStep`: a step with fixed sizes and buffers, which CUDA and TensorRT capture as a CUDA graph."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from supersampler.backends.onnx.runtime import capturing, ort
from supersampler.backends.onnx.session import open_session, running, session_options
from supersampler.frame import Size
from supersampler.methods.model_info import ModelInfo, extents


class FixedStep:
    """Runs a graph at one size on its own buffers; inputs and outputs are copied.

    CUDA and TensorRT capture its first run, after some warm-up, as a CUDA graph and replay that. They need
    fixed addresses. Two captured graphs that swap their histories would save the copies, but one overwrites
    pointers that the other reads (onnxruntime pull request 32121), and TensorRT allows only one. The copies
    are small compared with the memory traffic of a step.

    Results depend on no state of it. Two threads must not use it at once.

    Args:
        info: the model.
        path: its graph.
        providers: execution providers, in order of preference.
        threads: number of CPU threads; 0 uses every core.
        device: device of the first provider; see `device_of`.
        display: (width, height) of the images.
        render: (width, height) of the frame and of the previous one.

    Raises:
        ModelError, ProviderError: ONNX Runtime cannot load the graph, or the provider cannot capture it.
    """

    def __init__(
        self,
        info: ModelInfo,
        path: Path,
        providers: Sequence[str],
        threads: int,
        device: str,
        *,
        display: Size,
        render: Size,
    ) -> None:
        self.sizes, self._path = (display, render), path
        shapes = {"render": render, "display": display, "previous": render}
        options = session_options(threads)
        for name, extent in extents(**shapes).items():
            options.add_free_dimension_override_by_name(name, extent)
        graph = path.read_bytes()
        if any(tensor.name == "display_size" for tensor in info.inputs):
            graph = with_display_size(graph, display)
        self._session = open_session(path, options, capturing(providers), graph)
        self._binding = self._session.io_binding()
        self._inputs: dict[str, ort.OrtValue] = {}
        self._outputs: dict[str, ort.OrtValue] = {}  # history tensors by the names of their inputs
        for tensor in (*info.inputs, *(h.input for h in info.history)):
            if tensor.name != "display_size":
                self._inputs[tensor.name] = value = _allocated(tensor.shape_for(**shapes), device)
                self._binding.bind_ortvalue_input(tensor.name, value)
        outputs = [(h.output, h.input) for h in info.history]
        for output, tensor in [*outputs, (info.image.name, info.image)]:
            self._outputs[tensor.name] = value = _allocated(tensor.shape_for(**shapes), device)
            self._binding.bind_ortvalue_output(output, value)

    def run(self, given: Mapping[str, ort.OrtValue], results: Mapping[str, ort.OrtValue]) -> None:
        """Upscale a frame.

        Args:
            given: all inputs and history tensors.
            results: written to: the image, and the next history by the names of its inputs.
        """
        self._binding.synchronize_inputs()  # other libraries may have written on their own streams
        for name, value in self._inputs.items():
            value.update_inplace(given[name])
        with running(self._path):
            self._binding.synchronize_inputs()  # copies on the device are asynchronous
            self._session.run_with_iobinding(self._binding)
        for name, value in results.items():
            value.update_inplace(self._outputs[name])
        self._binding.synchronize_outputs()


def with_display_size(graph: bytes, display: Size) -> bytes:
    """Return the content of a graph's file with a constant in place of the input `display_size`.

    With fixed shapes, ONNX Runtime then computes all shapes at load time, so that no operator needs the CPU.
    Protobuf merges concatenated messages, so this appends an initializer of that name, and IR version 3, the
    last one in which an initializer replaces the input instead of being its default.
    """
    values = np.array(display, "<i8").tobytes()
    tensor = b"\x08\x02\x10\x07" + _delimited(8, b"display_size") + _delimited(9, values)  # int64[2]
    return graph + b"\x08\x03" + _delimited(7, _delimited(5, tensor))  # ModelProto.graph.initializer


def _delimited(field: int, content: bytes) -> bytes:
    return bytes([field << 3 | 2, len(content)]) + content  # valid below 128 bytes


def _allocated(shape: Sequence[int], device: str) -> ort.OrtValue:
    return ort.OrtValue.ortvalue_from_shape_and_type(list(shape), np.float32, device, 0)
