"""Scenarios: disturbances of a method, whose figures have bounds."""

import inspect
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from supersampler import Frame, State
from supersampler.frame import Float32, Size
from supersampler_bench.stress import scenes

STEP = 1.0 / 255.0
"""One step of an 8-bit image: bound of the mean difference between images that should look the same."""
REST = 0.5 / 255.0
"""Bound of the mean change of an image at rest in a jitter period: half a step of an 8-bit image."""
ROUNDING = 1e-5
"""Bound of the mean difference that single precision causes, without int8."""
RECOVERY = 48
"""Frames in which most methods recover from bad input: one and a half jitter periods at ratio 2."""
REACH = 8.0
"""Display pixels around a bad one that may look different, in addition to a network's receptive field."""
DECAY = 0.1
"""PSNR, dB, that an image may lose from one loop to a later one, or against another method's image."""
LARGEST = 65504.0


class Session(Protocol):
    """An `Upscaler`, or an object that behaves like one."""

    def step(self, frame: Frame) -> Float32:
        """See `Upscaler.step`."""

    def save_state(self) -> State:
        """See `Upscaler.save_state`."""

    def load_state(self, state: State) -> None:
        """See `Upscaler.load_state`."""


Begin = Callable[[Size, int], Session]
"""Returns a session for a display size and a number of threads."""
Sequences = Callable[[Sequence[Frame], Size, int], Iterable[Float32]]
"""Returns the images of a sequence of frames, at a display size, in one pass or in two."""


@dataclass(frozen=True)
class Subject:
    """A method on one executor."""

    method: str
    executor: str  # "cpu" or "onnx"
    precision: str  # of the network: "fp32", "fp16" or "int8"
    remembers: bool  # whether it has a history
    reach: float  # display pixels around a bad one that may look different
    begin: Begin  # with default settings
    exact: Begin | None = None  # on the ONNX backend in single precision; None if `begin` is
    own: Begin | None = None  # with `at_rest="off"`
    recovery: int = RECOVERY  # frames in which it recovers from bad input
    every: int = 1  # frames from one shaded frame to the next
    ratios: tuple[float, float] = (1.0, 4.0)  # smallest and largest
    sequences: Sequences | None = None  # upscales whole sequences, for methods of two passes

    @property
    def tolerance(self) -> float:
        """Bound of the mean difference between two ways to compute the same image."""
        return ROUNDING if self.precision == "fp32" else STEP


def bad_values(image: Float32) -> int:
    """Return the number of values that are not in [0, 65504]."""
    return int(image.size - np.count_nonzero((image >= 0.0) & (image <= LARGEST)))


@dataclass
class Trial:
    """One run of a scenario."""

    subject: Subject
    display: Size
    frames: int  # approximate number to step
    bad_values: int = 0  # in all images so far

    @property
    def render(self) -> Size:
        """Render size at ratio 2, or at the nearest ratio that the subject supports."""
        low, high = self.subject.ratios
        ratio = min(max(2.0, low), high)
        return round(self.display[0] / ratio), round(self.display[1] / ratio)

    @property
    def still(self) -> Sequence[Frame]:
        """One jitter period of the static scene."""
        return scenes.still(self.render, self.subject.every)

    @property
    def moving(self) -> Sequence[Frame]:
        """One loop of the moving scene."""
        return scenes.moving(self.render, self.subject.every)

    @property
    def watched(self) -> int:
        """Number of frames to watch after a disturbance: more than recovery may take."""
        return max(self.frames, self.subject.recovery + 8)

    def begin(self, display: Size | None = None, *, threads: int = 1) -> Session:
        """Begin a session."""
        return Watched(self.subject.begin(display or self.display, threads), self)

    def begin_own(self) -> Session:
        """Begin a session that does not converge at rest: after a disturbance, that would take long."""
        return Watched((self.subject.own or self.subject.begin)(self.display, 1), self)


class Watched:
    """A session whose bad values are counted by a trial."""

    def __init__(self, session: Session, trial: Trial) -> None:
        self._session, self._trial = session, trial
        self.save_state, self.load_state = session.save_state, session.load_state

    def step(self, frame: Frame) -> Float32:
        """Step, and count bad values."""
        image = self._session.step(frame)
        self._trial.bad_values += bad_values(image)
        return image


@dataclass(frozen=True)
class Figure:
    """A measured value and its largest allowed value."""

    name: str
    value: float
    bound: float

    @property
    def passed(self) -> bool:
        """Whether the value is within its bound; NaN is not."""
        return self.value <= self.bound


Figures = Sequence[Figure]
Run = Callable[..., Figures]
"""A function of a trial and other arguments, which runs a scenario."""


@dataclass(frozen=True)
class Scenario:
    """A disturbance of a method, and its figures."""

    name: str
    run: Callable[[Trial], Figures]
    description: str  # of `run`, a sentence or two
    cpu: int  # frames on the CPU backend
    onnx: int  # frames on the ONNX backend, which is much slower
    quick: int = 0  # frames of a short run on any backend; 0: not part of short runs
    remembers: bool = True  # whether it is only for methods with a history
    pairs: bool = False  # whether it is only for subjects with `exact`
    two_passes: bool = False  # whether it is for subjects of two passes, and only for these
    same_size: bool = False  # whether images are as large on the ONNX backend as on the CPU backend
    ratios: tuple[float, float] | None = (2.0, 2.0)  # smallest and largest; None: any

    def suits(self, subject: Subject) -> bool:
        """Return whether the scenario is for this subject."""
        if not self.supports(subject) or self.two_passes != (subject.sequences is not None):
            return False
        if self.pairs:
            return subject.exact is not None
        return subject.remembers or not self.remembers

    def supports(self, subject: Subject) -> bool:
        """Return whether the subject supports all ratios of the scenario."""
        low, high = self.ratios or subject.ratios
        return subject.ratios[0] <= low and high <= subject.ratios[1]

    def trial(self, subject: Subject, *, quick: bool) -> Trial:
        """Return a run: 96x64 pixels on the CPU backend, 48x32 on the ONNX backend and in short runs."""
        onnx = subject.executor == "onnx"
        small = quick or self.pairs or (onnx and not self.same_size)
        frames = self.quick if quick else self.onnx if onnx else self.cpu
        return Trial(subject, (48, 32) if small else (96, 64), frames)


FAMILIES: dict[str, list[Scenario]] = {
    family: []
    for family in ("steady", "hostile", "recovery", "light", "travel", "sampling", "sessions", "two-passes")
}
"""All scenarios, by family."""


def scenario(
    family: str, name: str, *arguments: object, cpu: int, onnx: int = 0, description: str = "", **traits: Any
) -> Callable[[Run], Run]:
    """Return a decorator that adds a function of (trial, *arguments) to a family.

    Keywords are fields of `Scenario`. `onnx` is by default `cpu`, the description the function's docstring.
    """

    def add(run: Run) -> Run:
        text = description or " ".join((inspect.getdoc(run) or "").split())

        def bound(trial: Trial) -> Figures:
            return run(trial, *arguments)

        FAMILIES[family].append(Scenario(name, bound, text, cpu=cpu, onnx=onnx or cpu, **traits))
        return run

    return add
