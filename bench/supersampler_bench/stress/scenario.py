"""Scenarios: a disturbance of a method, and figures with bounds."""

import inspect
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from typing import Protocol

import numpy as np

from supersampler import Frame
from supersampler.frame import Float32, Size
from supersampler.history import State

STEP = 1.0 / 255.0
"""Of an 8-bit image: what images that should be alike may differ by on average."""
REST = 0.5 / 255.0
"""Largest mean change of an image at rest in a jitter period: half a step of an 8-bit image."""
ROUNDING = 1e-5
"""Mean difference of images that single precision causes, without int8."""
RECOVERY = 48
"""Frames, one and a half periods of the jitter at ratio 2, in which most methods forget what was bad."""
REACH = 8.0
"""Display pixels around a bad one that may look different; of a network, beside what it sees."""
DECAY = 0.1
"""dB of PSNR that an image may lose from one loop to a later one, or be below what it is compared with."""
LARGEST = 65504.0


class Session(Protocol):
    """An `Upscaler`, or anything that behaves like one."""

    def step(self, frame: Frame) -> Float32:
        """See `Upscaler.step`."""

    def save_state(self) -> State:
        """See `Upscaler.save_state`."""

    def load_state(self, state: State) -> None:
        """See `Upscaler.load_state`."""


Sequences = Callable[[Sequence[Frame], Size, int], Iterable[Float32]]
"""Returns the images of a sequence of frames, at a display size, in one pass or in two."""


@dataclass(frozen=True)
class Subject:
    """A method in one executor.

    Attributes:
        method: its name.
        executor: "cpu" or "onnx".
        precision: of what is learned, "fp32", "fp16" or "int8".
        remembers: whether anything goes from frame to frame.
        reach: display pixels around a bad one that may look different.
        begin: makes a session for a display size, on so many threads.
        exact: the same method in the graph, in single precision; None where this is it.
        own: the same with `at_rest="off"`.
        recovery: frames in which what was bad is forgotten.
        every: frames from one shaded frame to the next; 1: all are shaded.
        ratios: of display to render size, the least and the largest.
        sequences: upscales whole sequences, for methods of two passes; None for others, which are stepped.
    """

    method: str
    executor: str
    precision: str
    remembers: bool
    reach: float
    begin: Callable[[Size, int], Session]
    exact: Callable[[Size, int], Session] | None = None
    own: Callable[[Size, int], Session] | None = None
    recovery: int = RECOVERY
    every: int = 1
    ratios: tuple[float, float] = (1.0, 4.0)
    sequences: Sequences | None = None

    @property
    def tolerance(self) -> float:
        """What two ways to the same image may differ by on average, as a screen shows it."""
        return ROUNDING if self.precision == "fp32" else STEP


def bad_values(image: Float32) -> int:
    """Return how many values of an image are not numbers in [0, 65504]."""
    return int(image.size - np.count_nonzero((image >= 0.0) & (image <= LARGEST)))


@dataclass
class Watched:
    """A session that counts invalid values of its images.

    Attributes:
        session: the one.
        bad_values: how many were not numbers in [0, 65504] so far.
    """

    session: Session
    bad_values: int = 0

    def step(self, frame: Frame) -> Float32:
        """Step, and count."""
        image = self.session.step(frame)
        self.bad_values += bad_values(image)
        return image

    def save_state(self) -> State:
        """See `Session`."""
        return self.session.save_state()

    def load_state(self, state: State) -> None:
        """See `Session`."""
        self.session.load_state(state)


@dataclass(frozen=True)
class Trial:
    """One run of a scenario.

    Attributes:
        subject: what is stressed.
        display: (width, height) of the images.
        frames: how many to step, about.
        opened: all sessions that the scenario began.
    """

    subject: Subject
    display: Size
    frames: int
    opened: list[Watched] = field(default_factory=list)

    @property
    def render(self) -> Size:
        """Render size at ratio 2, or the ratio nearest to it that the subject supports."""
        low, high = self.subject.ratios
        ratio = min(max(2.0, low), high)
        return round(self.display[0] / ratio), round(self.display[1] / ratio)

    @property
    def every(self) -> int:
        """Frames from one shaded frame to the next."""
        return self.subject.every

    @property
    def watched(self) -> int:
        """Frames to watch after a disturbance: some more than it may be seen in."""
        return max(self.frames, self.subject.recovery + 8)

    def begin(self, display: Size | None = None, *, threads: int = 1) -> Watched:
        """Begin a session."""
        self.opened.append(Watched(self.subject.begin(display or self.display, threads)))
        return self.opened[-1]

    def pair(self) -> tuple[Watched, Watched]:
        """Begin two sessions of the method's own images: one to disturb, and one to compare it with.

        With `at_rest="converge"` they would differ until the disturbed blocks have converged again.
        """
        begin = self.subject.own or self.subject.begin
        both = Watched(begin(self.display, 1)), Watched(begin(self.display, 1))
        self.opened.extend(both)
        return both


@dataclass(frozen=True)
class Figure:
    """What was measured; within its bound where `value` <= `bound`."""

    name: str
    value: float
    bound: float

    @property
    def passed(self) -> bool:
        """False of NaN, too."""
        return self.value <= self.bound


@dataclass(frozen=True)
class Measured:
    """Figures of one run, and a curve to look at.

    Attributes:
        figures: with their bounds.
        curve: values to plot, by frame or by shot.
        bad_values: number of invalid values in images that were not made by a session of the trial.
    """

    figures: tuple[Figure, ...]
    curve: list[float]
    bad_values: int = 0


@dataclass(frozen=True)
class Scenario:
    """A disturbance of a method, and the figures that are taken.

    Attributes:
        name: of a few words.
        curve: what its curve shows, over what: "y / x".
        run: runs it; its docstring is the description.
        cpu, onnx: frames on that backend; the ONNX backend is much slower.
        quick: frames of a short run in any; 0: it is left out there.
        remembers: only of methods with a history.
        pairs: only of subjects that are compared with single precision.
        two_passes: of subjects of two passes, and only of these.
        same_size: the ONNX backend has images as large as the CPU backend.
        logarithmic: whether its curve has a logarithmic axis.
        ratios: of display to render size, the least and the largest that it asks for; None: it takes any.
    """

    name: str
    curve: str
    run: Callable[[Trial], Measured]
    cpu: int
    onnx: int
    quick: int = 0
    remembers: bool = True
    pairs: bool = False
    two_passes: bool = False
    same_size: bool = False
    logarithmic: bool = True
    ratios: tuple[float, float] | None = (2.0, 2.0)

    @property
    def done(self) -> str:
        """What is done, in a sentence or two."""
        return " ".join((inspect.getdoc(self.run) or "").split())

    def suits(self, subject: Subject) -> bool:
        """Whether it makes sense for this subject, and at its ratios."""
        if not self.supports(subject) or self.two_passes != (subject.sequences is not None):
            return False
        if self.pairs:
            return subject.exact is not None
        return subject.remembers or not self.remembers

    def supports(self, subject: Subject) -> bool:
        """Whether the subject supports all ratios that it asks for."""
        if self.ratios is None:
            return True
        return subject.ratios[0] <= self.ratios[0] and self.ratios[1] <= subject.ratios[1]

    def trial(self, subject: Subject, *, quick: bool) -> Trial:
        """Return a run of it: 96x64 pixels on the CPU backend, 48x32 on the ONNX backend or in short runs."""
        onnx = subject.executor == "onnx"
        small = quick or self.pairs or (onnx and not self.same_size)
        frames = self.quick if quick else self.onnx if onnx else self.cpu
        return Trial(subject, (48, 32) if small else (96, 64), frames)
