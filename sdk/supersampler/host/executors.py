"""Which models run as kernels on this processor."""

import os

from supersampler.executor import Executor
from supersampler.host.bands import Bands
from supersampler.host.classifier import ClassifierHost
from supersampler.host.guided_warp import GuidedWarpHost
from supersampler.host.taa import TaaHost
from supersampler.host.taau import TaauHost
from supersampler.model_info import ModelInfo

_SALVIS = {"intersect_extent": True, "clip": "sample", "space": "ycocg", "wide_window": False}


def host_executor(info: ModelInfo, threads: int) -> Executor | None:
    """Return the executor of a model, or None where it has no kernels.

    Args:
        info: the model.
        threads: how many; 0 takes every core that this process may use.
    """
    kind = _kind(info)
    return None if kind is None else kind(info, Bands(threads or len(_cores())))


def host_drawing(info: ModelInfo, threads: int) -> GuidedWarpHost | None:
    """Return what draws frames that were not shaded, or None where a model has no kernels; as above."""
    if info.method != "guided-warp" or not GuidedWarpHost.draws(info.config):
        return None
    return GuidedWarpHost(info, Bands(threads or len(_cores())))


def _kind(info: ModelInfo) -> type[ClassifierHost] | type[TaaHost] | type[TaauHost] | None:
    if "network.npz" in info.files:
        return ClassifierHost
    if info.method == "taau":
        return TaauHost
    config = info.config
    if info.method == "taa" and config["gamma"] is not None and _SALVIS.items() <= config.items():
        return TaaHost
    return None


def _cores() -> set[int]:
    if hasattr(os, "sched_getaffinity"):
        return os.sched_getaffinity(0)
    return set(range(os.cpu_count() or 1))
