"""`DeviceRuns`: the calls of a `Model` that take and return images in memory of a device."""

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, cast

from supersampler.backends.base import Executor
from supersampler.backends.onnx.executor import OnnxExecutor
from supersampler.backends.onnx.session import vector_inputs
from supersampler.backends.onnx.tensors import Tensor, checked_tensors, graph_inputs, render_size_of, taken
from supersampler.conventions.jitter import check_ratio
from supersampler.errors import ArgumentError
from supersampler.frame import Size, checked_exposure, checked_jitter, checked_pre_exposure
from supersampler.history import History, check_histories
from supersampler.methods.model_info import ModelInfo

if TYPE_CHECKING:
    import wgpu

    from supersampler.backends.gpu.device_frame import DeviceFrame
    from supersampler.backends.gpu.executor import GpuExecutor


class DeviceRuns:
    """Base of `Model`; its attributes are those of it."""

    info: ModelInfo
    _executor: Executor
    _kind: Any

    @property
    def device(self) -> str:
        """The device of histories and of tensors for `run_tensors`: "cpu", "cuda", "dml"."""
        return self._executor.device if isinstance(self._executor, OnnxExecutor) else "cpu"

    @property
    def capture(self) -> bool:
        """Whether steps with tensors are captured; see `load`."""
        return isinstance(self._executor, OnnxExecutor) and self._executor.capture

    def run_tensors(
        self,
        tensors: Mapping[str, Tensor],
        history: History,
        *,
        jitter: tuple[float, float],
        exposure: float | None = None,
        pre_exposure: float = 1.0,
        out: Tensor | None = None,
        history_out: History | None = None,
        adds_samples: float = 1.0,
    ) -> tuple[Tensor, History]:
        """Upscale a frame on the provider's device; see `Upscaler.step_tensors`.

        Raises:
            FrameError: an input is missing, or has a wrong type, shape, range or device.
            ModelError: the provider cannot capture the step.
            ArgumentError: the executor is not "onnx", or `history_out` is `history`.
        """
        if not isinstance(self._executor, OnnxExecutor):
            want = "'onnx', which takes tensors"
            raise ArgumentError("executor", got=repr(self._executor.name), want=want)
        check_histories(history, history_out, self._kind, self._executor.fits)
        jitter, exposure = checked_jitter(jitter), checked_exposure(exposure)
        pre_exposure = checked_pre_exposure(pre_exposure)
        vectors = vector_inputs(
            jitter, exposure, history.display_size, pre_exposure, adds_samples=adds_samples
        )
        given = graph_inputs(self.info.inputs, checked_tensors(tensors), vectors, self.device)
        render_size = render_size_of(given["color"])
        check_ratio(self.info.ratios, render_size, history.display_size)
        next_history = self._prepared(history_out, history.display_size, render_size)
        target = None if out is None else taken(out, "image")
        if target is not None and target.data_ptr() in {value.data_ptr() for value in given.values()}:
            raise ArgumentError("out", got="memory of the frame", want="memory that the step does not read")
        display = history.display_size
        image = self._executor.step_tensors(given, display, history.buffers, next_history.buffers, target)
        return (image if out is None else out), next_history

    def encode(
        self,
        encoder: "wgpu.GPUCommandEncoder",
        frame: "DeviceFrame",
        history: History,
        image: "wgpu.GPUTexture | wgpu.GPUBuffer",
        history_out: History | None = None,
        *,
        adds_samples: float = 1.0,
        skip: bool = True,
    ) -> History:
        """Encode a step on a frame in memory of the GPU; see `Upscaler.encode_into`.

        Returns:
            The history for the next frame, which holds it once the commands have run.
        """
        check_histories(history, history_out, self._kind, self._executor.fits)
        check_ratio(self.info.ratios, frame.size, history.display_size)
        next_history = self._prepared(history_out, history.display_size, frame.size)
        self.gpu.encode(
            encoder, frame, history.buffers, next_history.buffers, image, adds_samples=adds_samples, skip=skip
        )
        return next_history

    @property
    def gpu(self) -> "GpuExecutor":
        """The GPU backend.

        Raises:
            ArgumentError: the executor is not "gpu".
        """
        if self._executor.name != "gpu":
            want = "'gpu', which takes textures and buffers of wgpu"
            raise ArgumentError("executor", got=repr(self._executor.name), want=want)
        return cast("GpuExecutor", self._executor)

    def _prepared(self, history: History | None, display: Size, render: Size) -> History:
        """Return the next history; it reuses the buffers of `history` if they have the right sizes."""
        if history is not None and self._executor.fits(history.buffers, display, render):
            return History(display, render, history.buffers, kind=self._kind)
        return History(display, render, self._executor.zeros(display, render), kind=self._kind)
