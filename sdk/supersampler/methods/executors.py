"""Choose the backend of a model."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Literal

from supersampler.backends.base import Executor
from supersampler.backends.onnx.executor import OnnxExecutor
from supersampler.backends.onnx.providers import CPU
from supersampler.errors import ArgumentError
from supersampler.methods.cpu_backends import cpu_executor, cpu_onnx_executor
from supersampler.methods.gpu_backends import gpu_executor
from supersampler.methods.model_info import ModelInfo

if TYPE_CHECKING:
    import wgpu

ExecutorName = Literal["auto", "onnx", "cpu", "cpu+onnx", "gpu"]
Precision = Literal["auto", "fp32", "fp16", "int8"]


def choose_executor(
    info: ModelInfo,
    providers: Sequence[str],
    threads: int,
    executor: ExecutorName,
    precision: Precision,
    *,
    capture: bool,
    device: "wgpu.GPUDevice | None",
) -> Executor:
    """Return the backend that `Model.load` describes; see there for arguments and errors."""
    if executor == "gpu":
        return gpu_executor(info, precision, capture=capture, device=device)
    if device is not None:
        raise ArgumentError("device", got=f"given with {executor=}", want="executor='gpu'")
    if executor == "cpu+onnx":
        if capture:
            raise ArgumentError("capture", got=f"True with {executor=}", want="executor='onnx'")
        return cpu_onnx_executor(info, providers, threads, precision)
    if executor != "onnx" and not capture and list(providers) == [CPU]:
        required = executor == "cpu" or precision == "int8"
        kernels = cpu_executor(info, threads, required=required)
        if kernels is not None and precision in ("auto", kernels.precision):
            return kernels
    kind = "fp32" if precision == "auto" else precision
    if executor == "cpu" or kind not in info.steps:
        got = f"{executor=}, {precision=}, {capture=}, providers {', '.join(providers)}"
        want = f"what {info.method!r} has: a graph in {' or '.join(info.steps)}, or kernels, on the CPU"
        raise ArgumentError("executor", got=got, want=want, hint="Only graphs are captured." * capture)
    return OnnxExecutor(info, threads, providers, kind, capture=capture)
