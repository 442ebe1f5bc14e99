"""Models in the CPU library with other options than `Model.load` sets."""

from typing import Any

from shared_models import shared_model
from supersampler import Model
from supersampler.backends.cpu.executor import CpuExecutor, CpuModel
from supersampler.backends.cpu.library import Options, cpu_library
from supersampler.backends.cpu.model_bytes import model_bytes
from supersampler.methods.registry import find_method


def bytes_of(method: str) -> bytes:
    spec = find_method(method)
    assert spec is not None
    return model_bytes(shared_model(method, "onnx").info, spec)


def cpu_executor(method: str, threads: int = 1, instructions: str = "", **options: Any) -> CpuExecutor:
    """Return an executor of a shipped model; see `ss_options`."""
    given = Options(threads=threads, instructions=instructions.encode() or None, **options)
    return CpuExecutor(CpuModel(cpu_library(), bytes_of(method), given), "fp32")


def cpu_model(method: str, threads: int = 1, **options: Any) -> Model:
    """Return a shipped model; see `ss_options`."""
    info = shared_model(method, "onnx").info
    return Model(info, cpu_executor(method, threads, **options), threads)
