"""Scenarios: a disturbance of a method, and figures with bounds."""

import inspect
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Protocol

import numpy as np

from supersampler import Frame
from supersampler.frame import Float32, Size
from supersampler.history import State
from supersampler_bench.stress import scenes

STEP = 1.0 / 255.0
"""One step of an 8-bit image: bound of the mean difference of images that should be alike."""
REST = 0.5 / 255.0
"""Largest mean change of an image at rest in a jitter period: half a step of an 8-bit image."""
ROUNDING = 1e-5
"""Mean difference of images that single precision causes, without int8."""
RECOVERY = 48
"""Frames, one and a half jitter periods at ratio 2, in which most methods forget bad input."""
REACH = 8.0
"""Display pixels around a bad one that may look different, apart from a network's receptive field."""
DECAY = 0.1
"""dB of PSNR that an image may lose from one loop to a later one, or to the image it is compared with."""
LARGEST = 65504.0


class Session(Protocol):
    """An `Upscaler`, or anything that behaves like one."""

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
    """A method in one executor.

    Attributes:
        method: its name.
        executor: "cpu" or "onnx".
        precision: precision of the network, "fp32", "fp16" or "int8".
        remembers: whether it has a history.
        reach: display pixels around a bad one that may look different.
        begin: of the method as it runs by default.
        exact: of the method on the ONNX backend in single precision; None where `begin` is that.
        own: of the method with `at_rest="off"`.
        recovery: frames in which bad input is forgotten.
        every: frames from one shaded frame to the next; 1: all are shaded.
        ratios: smallest and largest ratio of display to render size.
        sequences: upscales whole sequences, for methods of two passes; None for others, which are stepped.
    """

    method: str
    executor: str
    precision: str
    remembers: bool
    reach: float
    begin: Begin
    exact: Begin | None = None
    own: Begin | None = None
    recovery: int = RECOVERY
    every: int = 1
    ratios: tuple[float, float] = (1.0, 4.0)
    sequences: Sequences | None = None

    @property
    def tolerance(self) -> float:
        """Mean display difference that two ways to compute the same image may have."""
        return ROUNDING if self.precision == "fp32" else STEP


def bad_values(image: Float32) -> int:
    """Return how many values of an image are not numbers in [0, 65504]."""
    return int(image.size - np.count_nonzero((image >= 0.0) & (image <= LARGEST)))


@dataclass
class Trial:
    """One run of a scenario.

    Attributes:
        subject: the method under stress.
        display: (width, height) of the images.
        frames: approximate number of frames to step.
        bad_values: number of bad values in all images so far.
    """

    subject: Subject
    display: Size
    frames: int
    bad_values: int = 0

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
        """Number of frames to watch after a disturbance: a few more than it may last."""
        return max(self.frames, self.subject.recovery + 8)

    def begin(self, display: Size | None = None, *, threads: int = 1) -> Session:
        """Begin a session."""
        return Watched(self.subject.begin(display or self.display, threads), self)

    def begin_own(self) -> Session:
        """Begin a session of the method's own images.

        Sessions that converge at rest differ until disturbed blocks have converged again.
        """
        return Watched((self.subject.own or self.subject.begin)(self.display, 1), self)


@dataclass(frozen=True)
class Watched:
    """A session that adds the bad values of its images to those of a trial."""

    session: Session
    trial: Trial

    def step(self, frame: Frame) -> Float32:
        """Step, and count."""
        image = self.session.step(frame)
        self.trial.bad_values += bad_values(image)
        return image

    def save_state(self) -> State:
        """See `Session`."""
        return self.session.save_state()

    def load_state(self, state: State) -> None:
        """See `Session`."""
        self.session.load_state(state)


@dataclass(frozen=True)
class Figure:
    """A measured value; within its bound where `value` <= `bound`."""

    name: str
    value: float
    bound: float

    @property
    def passed(self) -> bool:
        """Whether it is within its bound; NaN is not."""
        return self.value <= self.bound


Figures = Sequence[Figure]
Run = Callable[..., Figures]
"""Runs a scenario: a function of a trial and other arguments."""


@dataclass(frozen=True)
class Scenario:
    """A disturbance of a method, and its figures.

    Attributes:
        name: a few words.
        run: runs it.
        description: what `run` does, in a sentence or two.
        cpu, onnx: frames on that backend; the ONNX backend is much slower.
        quick: frames of a short run on any backend; 0: not part of short runs.
        remembers: only for methods with a history.
        pairs: only for subjects that are compared with single precision.
        two_passes: for subjects of two passes, and only for these.
        same_size: images on the ONNX backend are as large as on the CPU backend.
        ratios: smallest and largest ratio that it uses; None: any.
    """

    name: str
    run: Callable[[Trial], Figures]
    description: str
    cpu: int
    onnx: int
    quick: int = 0
    remembers: bool = True
    pairs: bool = False
    two_passes: bool = False
    same_size: bool = False
    ratios: tuple[float, float] | None = (2.0, 2.0)

    def suits(self, subject: Subject) -> bool:
        """Return whether it makes sense for this subject, and at its ratios."""
        if not self.supports(subject) or self.two_passes != (subject.sequences is not None):
            return False
        if self.pairs:
            return subject.exact is not None
        return subject.remembers or not self.remembers

    def supports(self, subject: Subject) -> bool:
        """Return whether the subject supports all ratios of the scenario."""
        if self.ratios is None:
            return True
        return subject.ratios[0] <= self.ratios[0] and self.ratios[1] <= subject.ratios[1]

    def trial(self, subject: Subject, *, quick: bool) -> Trial:
        """Return a run of it: 96x64 pixels on the CPU backend, 48x32 on the ONNX backend or in short runs."""
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
    """Decorate a function of (trial, *arguments), which adds it to a family.

    Args:
        family: one of FAMILIES.
        name: see `Scenario`.
        arguments: arguments of the function, after the trial.
        cpu: frames on the CPU backend.
        onnx: frames on the ONNX backend; 0: as many as on the CPU backend.
        description: by default the function's docstring.
        traits: other fields of `Scenario`.
    """

    def add(run: Run) -> Run:
        text = description or " ".join((inspect.getdoc(run) or "").split())
        bound = partial(_run, run, arguments)
        FAMILIES[family].append(Scenario(name, bound, text, cpu=cpu, onnx=onnx or cpu, **traits))
        return run

    return add


def _run(run: Run, arguments: Sequence[object], trial: Trial) -> Figures:
    return run(trial, *arguments)
