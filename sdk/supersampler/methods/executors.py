"""Choice of a model's backend, and checks that its kernels or shaders support the model."""

import os
from collections.abc import Sequence
from dataclasses import fields
from typing import TYPE_CHECKING, Any
from weakref import WeakValueDictionary

from supersampler.arguments import ExecutorName, Precision
from supersampler.backends.base import Executor, ExtrapolationExecutor
from supersampler.backends.cpu.executor import CpuExecutor, CpuExtrapolation, CpuModel
from supersampler.backends.cpu.library import Options, cpu_library
from supersampler.backends.cpu.model_bytes import model_bytes
from supersampler.backends.onnx.executor import OnnxExecutor, OnnxExtrapolation
from supersampler.backends.onnx.runtime import CPU
from supersampler.errors import ArgumentError, BackendWarning, LibraryError, warn
from supersampler.methods.gbuffers import GBUFFERS
from supersampler.methods.model_info import ModelInfo
from supersampler.methods.registry import find_method, load, methods
from supersampler.methods.spec import MethodSpec, constants_of, flags_of

if TYPE_CHECKING:
    import wgpu

    from supersampler.backends.gpu.program import GpuProgram

_opened: WeakValueDictionary[tuple[object, ...], OnnxExtrapolation] = WeakValueDictionary()
"""Extrapolations in use, which keep no state: Upscalers of the same model share one."""


def choose_executor(
    info: ModelInfo,
    providers: Sequence[str],
    threads: int,
    executor: ExecutorName,
    precision: Precision,
    *,
    device: "wgpu.GPUDevice | None",
) -> Executor:
    """Return the backend that `Model.load` describes; see there for arguments and errors."""
    if executor == "gpu":
        return _gpu_executor(info, precision, device)
    if device is not None:
        raise ArgumentError("device", got=f"given with {executor=}", want="executor='gpu'")
    if executor != "onnx" and list(providers) == [CPU]:
        required = executor == "cpu" or precision == "int8"
        model = _cpu_model(info, threads, required=required)
        own = "int8" if info.multiply_adds else "fp32"
        if model is not None and precision in ("auto", own):
            return CpuExecutor(model, own)
    kind = "fp32" if precision == "auto" else precision
    if executor == "cpu" or kind not in info.steps:
        name, got, other = "precision", repr(precision), f"executor {executor!r}"
        if executor == "cpu":
            name, got, other = "executor", repr(executor), f"precision {precision!r}"
        want = f"a graph of {info.method!r} ({' or '.join(info.steps)}), or its kernels, if any, on the CPU"
        raise ArgumentError(name, got=f"{got} with {other} and {', '.join(providers)}", want=want)
    return OnnxExecutor(info, threads, providers, kind)


def choose_extrapolation(
    info: ModelInfo,
    providers: Sequence[str],
    threads: int,
    executor: ExecutorName,
    device: "wgpu.GPUDevice | None" = None,
) -> ExtrapolationExecutor:
    """Return the backend of a model that extrapolates unshaded frames.

    `device` is that of the GPU backend, which models without shaders do not use.

    Raises:
        DeviceError: there is no GPU, or it does not compile the shaders, and `executor` is "gpu".
        LibraryError: the CPU library cannot be loaded, and `executor` is "cpu".
        ModelError, ProviderError: ONNX Runtime cannot load the graph, or the provider cannot start.
    """
    spec = _supported(info)
    if executor == "gpu" and spec is not None and spec.gpu:
        from supersampler.backends.gpu.extrapolation import GpuExtrapolation

        _check_constants(info, spec)
        return GpuExtrapolation(load(spec.gpu)(info), device)
    if executor != "onnx" and list(providers) == [CPU]:
        model = _cpu_model(info, threads, required=executor == "cpu")
        if model is not None:
            return CpuExtrapolation(model)
    graph = info.files["step.onnx"], *info.graph_inputs, *info.graph_outputs
    key = graph, tuple(providers), threads, os.getpid()  # a forked child cannot use its parent's threads
    opened = _opened.get(key)
    if opened is None:
        opened = _opened[key] = OnnxExtrapolation(info, providers, threads)
    return opened


def gpu_program(info: ModelInfo) -> "GpuProgram | None":
    """Return passes, memory and weights of a model's step on a GPU; None without shaders.

    Raises:
        ModelError: a constant is out of range, or the weights cannot be read.
    """
    spec = _supported(info)
    if spec is None or not spec.gpu or spec.extrapolates:
        return None
    _check_constants(info, spec)
    program: GpuProgram = load(spec.gpu)(info)
    return program


def with_shaders(*, gbuffers: bool = True) -> list[str]:
    """Return the names of the shipped methods that upscale in shaders.

    `gbuffers`: also those that read G-buffers.
    """
    return [
        name
        for name, spec in methods().items()
        if spec.gpu
        and spec.ships
        and not spec.extrapolates
        and (gbuffers or GBUFFERS.keys().isdisjoint(spec.inputs))
    ]


def _gpu_executor(info: ModelInfo, precision: Precision, device: "wgpu.GPUDevice | None") -> Executor:
    program = gpu_program(info)
    if program is None:
        want = f"'onnx' for {info.method!r}: {', '.join(with_shaders())} have shaders"
        raise ArgumentError("executor", got="'gpu'", want=want)
    if precision not in ("auto", program.precision):
        want = f"'auto' or {program.precision!r} on the GPU"
        raise ArgumentError("precision", got=repr(precision), want=want)
    from supersampler.backends.gpu.executor import GpuExecutor

    return GpuExecutor(program, device)


_warned: list[str] = []


def _cpu_model(info: ModelInfo, threads: int, *, required: bool) -> CpuModel | None:
    """Return a model in the CPU library; None if the library does not support it, or cannot be loaded.

    Raises:
        LibraryError: the library cannot be loaded, and is required.
        ModelError: a constant is out of range, or the weights cannot be read.

    Warns:
        BackendWarning: the library cannot be loaded; once per process.
    """
    spec = _supported(info)
    if spec is None or not spec.cpu:
        return None
    _check_constants(info, spec)
    try:
        library = cpu_library()
    except LibraryError as error:
        if required:
            raise
        if not _warned:
            _warned.append(str(error))
            slower = "Steps run in ONNX Runtime instead: same images, several times slower, and static tiles"
            warn(BackendWarning(f"{error} {slower} are not reused."))
        return None
    return CpuModel(library, model_bytes(info, spec), Options(threads=threads))


def _supported(info: ModelInfo) -> MethodSpec | None:
    """Return the spec of a model's method; None if its kernels and shaders do not support this model."""
    spec = find_method(info.method)
    if spec is None or not info.files.keys() >= {*spec.kernel_files}:
        return None
    if not spec.kernels_support(info.config):
        return None
    shapes = {h.name: h.shape for h in info.history}
    outputs = {tensor.name for tensor in info.aux_outputs}
    return spec if shapes == spec.graph_history and outputs <= {*spec.aux_outputs} else None


def _check_constants(info: ModelInfo, spec: MethodSpec) -> None:
    """Raise ModelError if kernels and shaders do not support the constants of model.json.

    Another version of the method has other constants, and computes other images.
    """
    named = {constant.name for constant in fields(spec.config)}
    for name in sorted(named ^ info.config.keys()):
        want = "a constant" if name in named else "none"
        raise info.config_error(name, info.config.get(name), f"{want}, as in this version of {spec.name!r}")
    for name, (low, high) in constants_of(spec).items():
        value: Any = info.config.get(name)
        if type(value) not in (int, float) or not low <= value <= high:
            raise info.config_error(name, value, f"a number from {low:g} to {high:g}")
    for name in flags_of(spec):
        if type(info.config.get(name)) is not bool:
            raise info.config_error(name, info.config.get(name), "true or false")
