"""Choose the shaders of a model, if there are any."""

from collections.abc import Mapping
from importlib import import_module
from typing import TYPE_CHECKING

from supersampler.backends.base import Executor
from supersampler.errors import ArgumentError
from supersampler.methods.cpu_backends import kernels_of
from supersampler.methods.cpu_checks import check_constants, has_known_history
from supersampler.methods.model_info import ModelInfo

if TYPE_CHECKING:
    import wgpu

    from supersampler.backends.gpu.program import GpuProgram

_PROGRAMS: Mapping[str, str] = {
    "classifier": "classifier_program",
    "classifier_large": "large_program",
    "taa": "taa_program",
    "taau": "taau_program",
}
"""Functions by folder; only the one in use is imported."""


def gpu_program(info: ModelInfo) -> "GpuProgram | None":
    """Return passes, memory and weights of a model's step on a GPU; None where it has no shaders.

    Raises:
        ModelError: a constant is out of its range, or the weights cannot be read.
    """
    shaders = kernels_of(info)
    if shaders is None or shaders not in _PROGRAMS or not has_known_history(info, shaders):
        return None
    check_constants(info, shaders)
    made = getattr(import_module(f"supersampler.methods.{shaders}.gpu"), _PROGRAMS[shaders])
    program: GpuProgram = made(info)
    return program


def with_shaders() -> str:
    """Return the methods that have shaders, for messages."""
    return f"{', '.join(_PROGRAMS).replace('_', '-')} and their relatives"


def gpu_executor(
    info: ModelInfo, precision: str, *, capture: bool, device: "wgpu.GPUDevice | None" = None
) -> Executor:
    """Return the GPU backend of a model.

    Args:
        info: the model.
        precision: "auto", or that of the backend.
        capture: see `Model.load`.
        device: to run on; None is that of the process.

    Raises:
        ArgumentError: the model has no shaders, or they have another precision.
        DeviceError: there is no device, or it does not compile a shader.
    """
    program = gpu_program(info)
    if program is None:
        want = f"'onnx' for {info.method!r}: {with_shaders()} have shaders"
        raise ArgumentError("executor", got="'gpu'", want=want)
    if precision not in ("auto", program.precision):
        raise ArgumentError(
            "precision", got=repr(precision), want=f"'auto' or {program.precision!r} on the GPU"
        )
    if capture:
        raise ArgumentError("capture", got=True, want="False", hint="Only graphs are captured.")
    from supersampler.backends.gpu.executor import GpuExecutor

    return GpuExecutor(program, device)
