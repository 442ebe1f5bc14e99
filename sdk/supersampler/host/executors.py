"""Which models run as kernels on this processor."""

import os
from collections.abc import Mapping

from supersampler.executor import Executor
from supersampler.host.bands import Bands
from supersampler.host.classifier import ClassifierHost
from supersampler.host.guided_warp import GuidedWarpHost
from supersampler.host.model_check import check_constants, has_known_history
from supersampler.host.taa import TaaHost
from supersampler.host.taau import TaauHost
from supersampler.model_info import ModelInfo

_SALVIS = {"intersect_extent": True, "clip": "sample", "space": "ycocg", "wide_window": False}
_HOSTS: Mapping[str, type[ClassifierHost] | type[TaaHost] | type[TaauHost]] = {
    "classifier": ClassifierHost,
    "taa": TaaHost,
    "taau": TaauHost,
}


def host_executor(info: ModelInfo, threads: int) -> Executor | None:
    """Return the executor of a model, or None where it has no kernels.

    Args:
        info: the model.
        threads: how many; 0 takes every core that this process may use.
    """
    kernels = _kernels_of(info)
    if kernels is None or not has_known_history(info, kernels):
        return None
    check_constants(info, kernels)
    return _HOSTS[kernels](info, Bands(threads or len(_cores())))


def host_drawing(info: ModelInfo, threads: int) -> GuidedWarpHost | None:
    """Return what draws frames that were not shaded, or None where a model has no kernels; as above."""
    kernels = "guided-warp"
    if (
        info.method != kernels
        or not GuidedWarpHost.draws(info.config)
        or not has_known_history(info, kernels)
    ):
        return None
    check_constants(info, kernels)
    return GuidedWarpHost(info, Bands(threads or len(_cores())))


def _kernels_of(info: ModelInfo) -> str | None:
    if "network.npz" in info.files:
        return "classifier"
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
