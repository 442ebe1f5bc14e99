"""Choose the GPU backend of a model, if there is one."""

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

_EXECUTORS: Mapping[str, str] = {"classifier": "ClassifierGpu", "taa": "TaaGpu", "taau": "TaauGpu"}
"""Classes by folder; only the one in use is imported."""


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
    shaders = kernels_of(info)
    if shaders is None or not has_known_history(info, shaders):
        want = f"'onnx' for {info.method!r}: {', '.join(_EXECUTORS)} and their relatives have shaders"
        raise ArgumentError("executor", got="'gpu'", want=want)
    own = "int8" if shaders == "classifier" else "fp32"
    if precision not in ("auto", own):
        raise ArgumentError("precision", got=repr(precision), want=f"'auto' or {own!r} on the GPU")
    if capture:
        raise ArgumentError("capture", got=True, want="False", hint="Only graphs are captured.")
    check_constants(info, shaders)
    made = getattr(import_module(f"supersampler.methods.{shaders}.gpu"), _EXECUTORS[shaders])
    executor: Executor = made(info, device)
    return executor
