"""Choose the CPU backend of a model, if there is one and its kernels compile."""

import os
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from importlib import import_module
from typing import TYPE_CHECKING

from supersampler.backends.base import Executor
from supersampler.backends.cpu.threads import ThreadPool
from supersampler.errors import ArgumentError, BackendWarning, KernelError
from supersampler.methods.cpu_checks import check_constants, has_known_history
from supersampler.methods.model_info import ModelInfo
from supersampler.methods.spec import constants_of
from supersampler.methods.taa.spec import TAA, TaaConfig

if TYPE_CHECKING:
    from supersampler.methods.extrapolation.cpu import GuidedWarpCpu

_SALVIS = {name: value for name, value in asdict(TaaConfig()).items() if name not in constants_of(TAA)}
"""Options of `taa` that its kernels are written for."""
_EXECUTORS: Mapping[str, str] = {
    "classifier": "ClassifierCpu",
    "classifier_large": "LargeCpu",
    "gbuffer_fast": "GuidedCpu",
    "taa": "TaaCpu",
    "taau": "TaauCpu",
}
"""Classes by folder; only the one in use is imported."""


def cpu_executor(info: ModelInfo, threads: int, *, required: bool = False) -> Executor | None:
    """Return the CPU backend of a model; None where it has no kernels, or they do not compile.

    Args:
        info: the model.
        threads: number of threads; 0: one per core that this process may use.
        required: raise instead of falling back to ONNX Runtime.

    Raises:
        KernelError: kernels cannot be compiled, and are required.

    Warns:
        BackendWarning: kernels cannot be compiled; once in a process.
    """
    kernels = kernels_of(info)
    if kernels is None or not has_known_history(info, kernels):
        return None
    check_constants(info, kernels)
    try:
        made = getattr(import_module(f"supersampler.methods.{kernels}.cpu"), _EXECUTORS[kernels])
        executor: Executor = made(info, ThreadPool(threads or len(_cores())))
        return executor
    except KernelError as error:
        _fall_back(error, required=required)
        return None


def cpu_onnx_executor(info: ModelInfo, providers: Sequence[str], threads: int, precision: str) -> Executor:
    """Return the CPU backend of a classifier whose network runs in ONNX Runtime.

    Args:
        info: the model.
        providers: execution providers of the network.
        threads: of kernels, and of ONNX Runtime; 0: one per core that this process may use.
        precision: of the network: "fp32" (also "auto") or "int8".

    Raises:
        ArgumentError: the model has no kernels around a network, or no network of this precision.
        ModelError, ProviderError: the network cannot be loaded, or not by this provider.
        KernelError: kernels cannot be compiled.
    """
    kernels, kind = kernels_of(info), "fp32" if precision == "auto" else precision
    if kernels is None or not has_known_history(info, kernels) or kind not in info.networks:
        got = f"'cpu+onnx' with {precision=} for {info.method!r}"
        want = "a classifier, whose network is in fp32 (network.onnx) or int8 (network.int8.onnx)"
        raise ArgumentError("executor", got=got, want=want)
    check_constants(info, kernels)
    from supersampler.methods.classifier.onnx_network import NetworkSession
    from supersampler.methods.classifier.variant import Variant

    parameters = Variant.of(info.config).blend_parameters
    session = NetworkSession(info, kind, providers, threads, parameters)
    made = getattr(import_module(f"supersampler.methods.{kernels}.cpu"), _EXECUTORS[kernels])
    executor: Executor = made(info, ThreadPool(threads or len(_cores())), session)
    return executor


def cpu_extrapolation(info: ModelInfo, threads: int, *, required: bool = False) -> "GuidedWarpCpu | None":
    """Return the CPU backend of a model that extrapolates unshaded frames; see `cpu_executor`."""
    kernels = "guided-warp"
    if info.method != kernels or not has_known_history(info, kernels):
        return None
    from supersampler.methods.extrapolation.cpu import GuidedWarpCpu

    if not GuidedWarpCpu.supports(info.config):
        return None
    check_constants(info, kernels)
    try:
        return GuidedWarpCpu(info, ThreadPool(threads or len(_cores())))
    except KernelError as error:
        _fall_back(error, required=required)
        return None


_warned: list[str] = []


def _fall_back(error: KernelError, *, required: bool) -> None:
    if required:
        raise error
    if not _warned:
        _warned.append(str(error))
        warnings.warn(
            f"{error}. Steps run in ONNX Runtime instead: same images, several times slower, and tiles that "
            "stand still are not reused. `pip install numba` brings the kernels back.",
            BackendWarning,
            stacklevel=2,
        )


def kernels_of(info: ModelInfo) -> str | None:
    """Return the folder of the method whose kernels and shaders run a model; None where none do."""
    if "network.npz" in info.files:
        own = {"gbuffer-fast": "gbuffer_fast", "classifier-large": "classifier_large"}
        return own.get(info.method, "classifier")
    if info.method == "taau":
        return "taau"
    config = info.config
    if info.method == "taa" and config.get("gamma") is not None and _SALVIS.items() <= config.items():
        return "taa"
    return None


def _cores() -> set[int]:
    if hasattr(os, "sched_getaffinity"):
        return os.sched_getaffinity(0)
    return set(range(os.cpu_count() or 1))
