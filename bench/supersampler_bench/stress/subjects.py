"""Methods and backends under stress, with their bounds of reach and recovery."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache, partial

from supersampler import ArgumentError, Frame, Model, State, Upscaler, upscale_sequence
from supersampler.arguments import AtRest, ExecutorName, Precision
from supersampler.frame import Float32, Size
from supersampler.methods.model_file import find_model
from supersampler.methods.model_info import ModelInfo
from supersampler_bench.specs import parse_spec, with_default_gbuffers
from supersampler_bench.stress.scenario import REACH, RECOVERY, Session, Subject
from supersampler_bench.stress.scenes import PERIOD

SLOW: Mapping[str, int] = {"taau": 9 * PERIOD}
"""Frames in which slower methods recover. `taau` keeps 18 samples, a fifth of which a frame replaces, so an
error within its colour box fades no faster."""


def subjects(methods: Sequence[str], executors: Sequence[ExecutorName]) -> list[Subject]:
    """Return all methods, each on the executors that it has.

    Methods may have a precision ("classifier:fp16") or two passes ("taau:x2"). Of "taau+guided-warp", every
    second frame is unshaded, and the other model extrapolates it.

    Raises:
        ArgumentError: a method runs on none of the executors.
        ModelError: there is no such model.
    """
    found: list[Subject] = []
    for method in methods:
        made = list(_of(method, executors))
        if not made:
            want = f"methods that run on {' or '.join(executors)}"
            raise ArgumentError("--methods", got=repr(method), want=want)
        found += made
    return found


def _of(method: str, executors: Sequence[ExecutorName]) -> Iterator[Subject]:
    upscaler, _, extrapolation = method.partition("+")
    spec = parse_spec(upscaler, two_passes=not extrapolation)
    if extrapolation:
        find_model(extrapolation)
    for executor in executors if spec.executor == "auto" else [spec.executor]:
        begin = _SessionFactory(spec.model, executor, spec.precision, extrapolation or None, spec.at_rest)
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
            reach=REACH + _receptive_radius(model.info),
            begin=begin,
            exact=None if is_exact else replace(begin, executor="onnx", precision="fp32"),
            own=replace(begin, at_rest="off"),
            recovery=SLOW.get(model.info.method, RECOVERY),
            every=2 if extrapolation else 1,
            ratios=model.info.ratios,
            sequences=partial(_sequence, model, spec.at_rest) if spec.passes == 2 else None,
        )


@dataclass(frozen=True)
class _SessionFactory:
    method: str
    executor: ExecutorName
    precision: Precision
    extrapolation: str | None
    at_rest: AtRest = "converge"

    def model(self, threads: int) -> Model:
        return _model(self.method, self.executor, self.precision, threads)

    def __call__(self, display: Size, threads: int) -> Session:
        upscaler = Upscaler(
            self.model(threads),
            display_size=display,
            at_rest=self.at_rest,
            skip=False,
            extrapolation=self.extrapolation,
            validate="off",
        )
        return _Session(upscaler, display, alternates=self.extrapolation is not None)


class _Session:
    """An Upscaler whose frames get the G-buffers that they lack.

    If it `alternates`, every second frame is unshaded. The first one, and one after a cut or a loaded state,
    is shaded.
    """

    def __init__(self, upscaler: Upscaler, display: Size, *, alternates: bool) -> None:
        self._upscaler, self._display, self._alternates = upscaler, display, alternates
        self._next_is_unshaded = False
        self.save_state = upscaler.save_state

    def step(self, frame: Frame) -> Float32:
        """See `Upscaler.step`."""
        frame = with_default_gbuffers(frame, self._upscaler.gbuffers, self._display)
        unshaded = self._next_is_unshaded and not frame.reset
        self._next_is_unshaded = self._alternates and not unshaded
        if unshaded:
            return self._upscaler.extrapolate(replace(frame, color=None))
        return self._upscaler.step(frame)

    def load_state(self, state: State) -> None:
        """See `Upscaler.load_state`."""
        self._upscaler.load_state(state)
        self._next_is_unshaded = False


def _sequence(
    model: Model, at_rest: AtRest, frames: Sequence[Frame], display: Size, passes: int
) -> Iterable[Float32]:
    given = (with_default_gbuffers(frame, model.info.gbuffers, display) for frame in frames)
    return upscale_sequence(
        given, display_size=display, model=model, passes=passes, at_rest=at_rest, validate="off"
    )


@cache
def _model(method: str, executor: ExecutorName, precision: Precision, threads: int) -> Model:
    return Model.load(method, providers="cpu", executor=executor, precision=precision, threads=threads)


def _receptive_radius(info: ModelInfo) -> int:
    """Return the radius of a network's receptive field, display pixels; 0 without a network.

    Each level adds one of its pixels, of 2, 4, 8, ... display pixels. The phase of the largest depends on the
    position.
    """
    levels = len(info.config["network"]["levels"]) if "network" in info.config else 0
    strides = [2 << level for level in range(levels)]
    return sum(strides) + max(strides, default=0)
