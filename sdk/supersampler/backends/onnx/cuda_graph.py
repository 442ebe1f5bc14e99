"""A step of one size, always from and to the same memory, as a provider asks that is to capture it."""

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from supersampler.backends.onnx.providers import capturing, check_provider_in_use
from supersampler.backends.onnx.runtime import ort
from supersampler.backends.onnx.session import open_session, running, session_options
from supersampler.frame import Size
from supersampler.methods.model_info import ModelInfo, extents


class FixedStep:
    """Runs a graph at one size on buffers of its own; what goes in and comes out is copied.

    CUDA and TensorRT capture its first run as a CUDA graph, after some that warm up, and launch that from
    then on. They want memory that stays where it is. It is one graph, and the history is copied: of two, for
    histories that take turns, one overwrites pointers that the other reads (onnxruntime pull request 32121),
    and TensorRT has but one. The copies are little beside what the operators of a step move.

    Nothing that a result depends on is kept between runs. Not for use from two threads at once.

    Args:
        info: the model.
        path: its graph.
        providers: execution providers, in order.
        threads: on the CPU; 0 takes every core.
        device: that the first provider's buffers lie on, as ONNX Runtime calls it.
        display: (width, height) of the images.
        render: (width, height) of the frame, and of the one before.

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
        check_provider_in_use(providers[0], self._session.get_providers())
        self._binding = self._session.io_binding()
        self._inputs: dict[str, ort.OrtValue] = {}
        self._outputs: dict[str, ort.OrtValue] = {}  # a history by the name of the input that it becomes
        for tensor in (*info.inputs, *(h.input for h in info.history)):
            if tensor.name != "display_size":
                self._inputs[tensor.name] = value = _room(tensor.shape_for(**shapes), device)
                self._binding.bind_ortvalue_input(tensor.name, value)
        outputs = [(h.output, h.input) for h in info.history]
        for output, tensor in [*outputs, (info.image.name, info.image)]:
            self._outputs[tensor.name] = value = _room(tensor.shape_for(**shapes), device)
            self._binding.bind_ortvalue_output(output, value)

    def run(self, given: Mapping[str, ort.OrtValue], made: Mapping[str, ort.OrtValue]) -> None:
        """Upscale a frame.

        Args:
            given: all inputs, those of the history too; on the device or, of some numbers, in CPU memory.
            made: where to write the image and the history, by the names of the inputs that it becomes.
        """
        self._binding.synchronize_inputs()  # others have written on streams of their own
        for name, value in self._inputs.items():
            value.update_inplace(given[name])
        with running(self._path):
            self._binding.synchronize_inputs()  # a copy within the device is not waited for
            self._session.run_with_iobinding(self._binding)
        for name, value in made.items():
            value.update_inplace(self._outputs[name])
        self._binding.synchronize_outputs()


def with_display_size(graph: bytes, display: Size) -> bytes:
    """Return a graph, as its file has it, with a constant for its input `display_size`.

    With shapes that are numbers, ONNX Runtime then folds all that leads to shapes, and nothing is left of it
    to be computed on the CPU. Protobuf reads messages that follow one another as one, so this appends an
    initializer of that name, and version 3 of ONNX's format, the last in which an initializer is what the
    input is, and not its default.
    """
    values = np.array(display, "<i8").tobytes()
    tensor = b"\x08\x02\x10\x07" + _delimited(8, b"display_size") + _delimited(9, values)  # int64[2]
    return graph + b"\x08\x03" + _delimited(7, _delimited(5, tensor))  # ModelProto.graph.initializer


def _delimited(field: int, content: bytes) -> bytes:
    return bytes([field << 3 | 2, len(content)]) + content  # of less than 128 bytes


def _room(shape: Sequence[int], device: str) -> ort.OrtValue:
    return ort.OrtValue.ortvalue_from_shape_and_type(list(shape), np.float32, device, 0)
