"""Methods and executors as what is stressed, and what they promise: how soon the past must fade."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache

from supersampler import Frame, Model, Upscaler
from supersampler.errors import ArgumentError
from supersampler.frame import Float32, Size
from supersampler.methods.model_file import ModelInfo
from supersampler.model import ExecutorName, Precision
from supersampler.state import State
from supersampler_bench.compatibility import dressed
from supersampler_bench.specs import parse_spec
from supersampler_bench.stress.scenario import REACH, RECOVERY, Session, Subject
from supersampler_bench.stress.scenes import PERIOD

SLOW: Mapping[str, int] = {"taau": 9 * PERIOD}
"""Frames in which methods forget what was bad that promise no more. `taau` keeps eighteen samples, of which a
frame brings a fifth, and what is wrong by no more than its box is wide fades no faster than they do."""


def subjects(methods: Sequence[str], executors: Sequence[ExecutorName]) -> list[Subject]:
    """Return all methods in all executors that they have.

    Args:
        methods: shipped models or model folders, with a precision as in "classifier:fp16"; "taau+guided-warp"
            hides every second frame from `taau`, and has the other draw its colour.
        executors: of the first.
    """
    return [subject for method in methods for subject in _of(method, executors)]


def _of(method: str, executors: Sequence[ExecutorName]) -> Iterator[Subject]:
    upscaler, _, drawing = method.partition("+")
    spec = parse_spec(upscaler)
    for executor in executors:
        begin = _Begin(spec.model, executor, spec.precision, drawing or None)
        try:
            model = begin.model(1)
        except ArgumentError:  # the method has no such executor
            continue
        is_exact = (model.executor, model.precision) == ("onnx", "fp32")
        yield Subject(
            method=method,
            executor=model.executor,
            precision=model.precision,
            remembers=bool(model.info.history),
            reach=REACH + _sight(model.info),
            begin=begin,
            exact=None if is_exact else replace(begin, executor="onnx", precision="fp32"),
            recovery=SLOW.get(spec.model, RECOVERY),
            ratios=model.info.ratios,
        )


@dataclass(frozen=True)
class _Begin:
    method: str
    executor: ExecutorName
    precision: Precision
    drawing: str | None

    def model(self, threads: int) -> Model:
        return _model(self.method, self.executor, self.precision, threads)

    def __call__(self, display: Size, threads: int) -> Session:
        upscaler = Upscaler(
            self.model(threads),
            display_size=display,
            skip="exact",
            extrapolation=self.drawing,
            validate="off",
        )
        if self.drawing is not None:
            return _Alternating(upscaler, display)
        return _Dressed(upscaler, display) if upscaler.gbuffers else upscaler


class _Dressed:
    """An Upscaler of a method that reads G-buffers, which frames to stress with lack."""

    def __init__(self, upscaler: Upscaler, display: Size) -> None:
        self._upscaler, self._display = upscaler, display

    def step(self, frame: Frame) -> Float32:
        """See `Upscaler.step`."""
        return self._show(dressed(frame, self._upscaler.gbuffers, self._display))

    def save_state(self) -> State:
        """See `Upscaler.save_state`."""
        return self._upscaler.save_state()

    def load_state(self, state: State) -> None:
        """See `Upscaler.load_state`."""
        self._upscaler.load_state(state)

    def _show(self, frame: Frame) -> Float32:
        return self._upscaler.step(frame)


class _Alternating(_Dressed):
    """One that is not shown the colour of every second frame; what comes after a cut or a load is shaded."""

    _hides = False

    def load_state(self, state: State) -> None:
        """See `Upscaler.load_state`."""
        super().load_state(state)
        self._hides = False

    def _show(self, frame: Frame) -> Float32:
        hidden = self._hides and not frame.reset
        image = self._upscaler.extrapolate(replace(frame, color=None)) if hidden else super()._show(frame)
        self._hides = not hidden
        return image


@cache
def _model(method: str, executor: ExecutorName, precision: Precision, threads: int) -> Model:
    return Model.load(method, providers="cpu", executor=executor, precision=precision, threads=threads)


def _sight(info: ModelInfo) -> int:
    """Display pixels that a network sees to either side; 0 without one.

    Each level sees one of its own pixels farther, of 2, 4, 8, ... display pixels, and where the largest of
    them begin depends on the place.
    """
    levels = len(info.config["network"]["levels"]) if "network" in info.config else 0
    strides = [2 << level for level in range(levels)]
    return sum(strides) + max(strides, default=0)
