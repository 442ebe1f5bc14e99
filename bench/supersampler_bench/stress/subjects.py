"""Methods and executors as what is stressed, and what they promise: how soon the past must fade."""

from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from typing import Any

import numpy as np

from supersampler import Model, Upscaler, halton_jitter
from supersampler.errors import ArgumentError
from supersampler.frame import Size
from supersampler.model import ExecutorName
from supersampler.model_info import ModelInfo
from supersampler_bench.stress.scenario import REACH, Session, Subject
from supersampler_bench.stress.scenes import PERIOD, RATIO


def subjects(methods: Sequence[str], executors: Sequence[ExecutorName]) -> list[Subject]:
    """Return all methods in all executors that they have."""
    return [subject for method in methods for subject in _of(method, executors)]


def _of(method: str, executors: Sequence[ExecutorName]) -> Iterator[Subject]:
    for executor in executors:
        try:
            model = _model(method, executor, 1)
        except ArgumentError:  # the method has no such executor
            continue
        yield Subject(
            method=method,
            executor=model.executor,
            precision=model.precision,
            shrinks=shrinks_at_rest(model.info),
            reach=REACH + _sight(model.info),
            begin=_Begin(method, executor),
            exact=None if executor == "graph" else _Begin(method, "graph"),
        )


class _Begin:
    def __init__(self, method: str, executor: ExecutorName) -> None:
        self._method, self._executor = method, executor

    def __call__(self, display: Size, threads: int) -> Session:
        model = _model(self._method, self._executor, threads)
        return Upscaler(model, display_size=display, skip="exact", validate="off")


@cache
def _model(method: str, executor: ExecutorName, threads: int) -> Model:
    return Model.load(method, providers="cpu", executor=executor, threads=threads)


def shrinks_at_rest(info: ModelInfo) -> float | None:
    """Return the factor, a frame, by which a disturbance at rest must shrink by the limit of samples.

    An average of fixed length keeps 1 - alpha. One that counts at most N samples keeps N / (N + c), where
    this frame's sample is worth c, its Gaussian weight: the geometric mean over a period of the jitter, of
    the pixel that shrinks least.
    """
    config: Mapping[str, Any] = info.config
    if "alpha" in config:
        return 1.0 - float(config["alpha"])
    if "samples" not in config:
        return None
    samples, sigma = float(config["samples"]), float(config["sample_sigma"])
    logs = [-np.log1p(_worth(halton_jitter(i, RATIO), sigma) / samples) for i in range(PERIOD)]
    return float(np.exp(np.mean(logs, axis=0).max()))


def _worth(jitter: tuple[float, float], sigma: float) -> Any:
    """(2, 2) what samples are worth to display pixels, of which 2x2 see them alike at ratio 2."""
    samples = np.arange(-3, 5)
    x, y = ((np.arange(2) + 0.5) / RATIO - 0.5 - offset for offset in jitter)
    down, across = (np.exp(-0.5 * ((v[:, None] - samples) * RATIO / sigma) ** 2).sum(axis=1) for v in (y, x))
    return np.minimum(down[:, None] * across, 1.0)


def _sight(info: ModelInfo) -> int:
    """Display pixels that a network sees to either side; 0 without one.

    Each level sees one of its own pixels farther, of 2, 4, 8, ... display pixels, and where the largest of
    them begin depends on the place.
    """
    levels = len(info.config["network"]["levels"]) if "network" in info.config else 0
    strides = [2 << level for level in range(levels)]
    return sum(strides) + max(strides, default=0)
