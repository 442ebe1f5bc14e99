"""Methods and executors as what is stressed, and what they promise: how soon the past must fade."""

from collections.abc import Iterator, Mapping, Sequence
from functools import cache

from supersampler import Frame, Model, Upscaler
from supersampler.errors import ArgumentError
from supersampler.frame import Float32, Size
from supersampler.model import ExecutorName
from supersampler.model_info import ModelInfo
from supersampler_bench.fitting import dressed
from supersampler_bench.stress.scenario import REACH, RECOVERY, Session, Subject
from supersampler_bench.stress.scenes import PERIOD

SLOW: Mapping[str, int] = {"taau": 9 * PERIOD}
"""Frames in which methods forget what was bad that promise no more. `taau` keeps eighteen samples, of which a
frame brings a fifth, and what is wrong by no more than its box is wide fades no faster than they do."""


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
            remembers=bool(model.info.history),
            reach=REACH + _sight(model.info),
            begin=_Begin(method, executor),
            exact=None if executor == "graph" else _Begin(method, "graph"),
            recovery=SLOW.get(method, RECOVERY),
            ratios=model.info.ratios,
        )


class _Begin:
    def __init__(self, method: str, executor: ExecutorName) -> None:
        self._method, self._executor = method, executor

    def __call__(self, display: Size, threads: int) -> Session:
        model = _model(self._method, self._executor, threads)
        upscaler = Upscaler(model, display_size=display, skip="exact", validate="off")
        return _Dressed(upscaler, display) if model.info.gbuffers else upscaler


class _Dressed:
    """An Upscaler of a method that reads G-buffers, which frames to stress with lack."""

    def __init__(self, upscaler: Upscaler, display: Size) -> None:
        self._upscaler, self._display = upscaler, display
        self.save_state, self.load_state = upscaler.save_state, upscaler.load_state

    def step(self, frame: Frame) -> Float32:
        """See `Upscaler.step`."""
        return self._upscaler.step(dressed(frame, self._upscaler.model.info.gbuffers, self._display))


@cache
def _model(method: str, executor: ExecutorName, threads: int) -> Model:
    return Model.load(method, providers="cpu", executor=executor, threads=threads)


def _sight(info: ModelInfo) -> int:
    """Display pixels that a network sees to either side; 0 without one.

    Each level sees one of its own pixels farther, of 2, 4, 8, ... display pixels, and where the largest of
    them begin depends on the place.
    """
    levels = len(info.config["network"]["levels"]) if "network" in info.config else 0
    strides = [2 << level for level in range(levels)]
    return sum(strides) + max(strides, default=0)
