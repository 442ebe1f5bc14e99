"""Differences from an undisturbed session and from an earlier loop; growth of errors in a history."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import cycle, islice
from typing import Any

import numpy as np
from numpy.typing import NDArray

from supersampler import Frame, State
from supersampler.frame import Float32
from supersampler.io.display import decibels, display_transform
from supersampler_bench.stress.scenario import DECAY, REST, STEP, Figure, Figures, Session, Trial

OUTLIER = 0.1
"""Difference at 99.9 % of the values below which a disturbance is no longer visible."""


@dataclass(frozen=True)
class VisibleDifference:
    """Absolute difference of two images after the display transform, [0, 1]: mean and 99.9th percentile."""

    mean: float
    p999: float

    @property
    def invisible(self) -> bool:
        """Whether the difference is too small to see."""
        return self.mean <= STEP and self.p999 <= OUTLIER


def difference(one: Float32, other: Float32, exposure: float = 1.0) -> VisibleDifference:
    """Compare two images."""
    apart = np.abs(display_transform(one, exposure) - display_transform(other, exposure))
    return VisibleDifference(float(apart.mean()), float(np.quantile(apart, 0.999)))


class Disturbance:
    """A session that is disturbed, and a baseline session, on frames that repeat."""

    def __init__(self, trial: Trial, frames: Sequence[Frame]) -> None:
        self._trial, self.frames = trial, cycle(frames)
        self.disturbed, self.baseline = trial.begin_own(), trial.begin_own()

    def step(self, pairs: Iterable[tuple[Frame, Frame]], exposure: float = 1.0) -> list[VisibleDifference]:
        """Step the disturbed session with the first frame of each pair, the baseline with the second."""
        return [
            difference(self.disturbed.step(one), self.baseline.step(other), exposure) for one, other in pairs
        ]

    def step_same(self, count: int) -> list[VisibleDifference]:
        """Step both sessions with the next frames."""
        return self.step((frame, frame) for frame in islice(self.frames, count))

    def measured(self, after: Sequence[VisibleDifference] | None = None, more: int = 0) -> Figures:
        """Return the number of frames for which a disturbance was visible after its end.

        `after` has the differences after its end; None steps `Trial.watched` frames. `more` is added to the
        bound.
        """
        after = self.step_same(self._trial.watched) if after is None else after
        return [Figure("frames until clean", recovery(after), self._trial.subject.recovery + more)]


def recovery(after: Sequence[VisibleDifference]) -> float:
    """Return the number of frames up to the last visible difference."""
    return float(max((index + 1 for index, one in enumerate(after) if not one.invisible), default=0))


@dataclass(frozen=True)
class Repeated:
    """Figures of the images of frames that repeat; differences are mean absolute ones of display values."""

    change: float  # between the last two loops
    mean_abs_difference: float  # between the settled loop and the last
    psnr: float  # dB, of the last loop; NaN without references
    lost: float  # PSNR, dB, from the settled loop to the last
    swing: float  # PSNR, dB, from the worst to the best image of the last loop
    flicker: float  # of the last loop

    def measured(self) -> Figures:
        """Return the change in the last loop, and the PSNR lost."""
        return [Figure("change in a loop", self.change, REST), Figure("PSNR lost, dB", self.lost, DECAY)]


def repeat(trial: Trial, frames: Sequence[Frame], truths: Sequence[Float32] = ()) -> Repeated:
    """Step through the same frames in whole loops: `trial.frames` frames, or at least three loops."""
    session, loops = trial.begin(), max(trial.frames // len(frames), 3)
    references = [display_transform(truth) for truth in truths]
    settled = min(12, loops // 2)  # the loop after which nothing should change
    scores = np.full((loops, len(frames)), np.nan)
    before: list[Float32] = []
    last: list[Float32] = []
    early: list[Float32] = []
    for loop in range(loops):
        before, last = last, [display_transform(session.step(frame)) for frame in frames]
        if references:
            pairs = zip(last, references, strict=True)
            scores[loop] = [decibels(float(np.mean((a - b) ** 2))) for a, b in pairs]
        if loop == settled:
            early = last
    psnr = scores.mean(axis=1)
    return Repeated(
        change=_mean_apart(last, before),
        mean_abs_difference=_mean_apart(last, early),
        psnr=float(psnr[-1]),
        lost=float(psnr[settled] - psnr[-1]),
        swing=float(np.ptp(scores[-1])) if references else 0.0,
        flicker=flicker(last),
    )


def flicker(images: Sequence[Float32]) -> float:
    """Return the standard deviation of display values over time: the root mean square over all pixels."""
    return float(np.sqrt(np.var(np.stack(images), axis=0).mean()))


def _mean_apart(one: Sequence[Float32], other: Sequence[Float32]) -> float:
    return float(np.mean([np.abs(a - b).mean() for a, b in zip(one, other, strict=True)]))


EVERY = 16
"""Frames per round of `contraction`, few enough that the difference stays far above rounding."""
COLOR = "history.color"
_NOTHING = 1e-12


@dataclass(frozen=True)
class Contraction:
    """Factors by which one frame multiplies a difference: means over rounds. Above 1, differences grow."""

    rates: list[float]

    @property
    def last(self) -> list[float]:
        """The second half of the rounds, where only the most persistent error is left."""
        return self.rates[len(self.rates) // 2 :]

    @property
    def rate(self) -> float:
        """The geometric mean of the second half."""
        return float(np.exp(np.log(np.maximum(self.last, _NOTHING)).mean()))


def contraction(
    base: Session, other: Session, frames: Sequence[Frame], rounds: int, size: float, warm_up: int
) -> Contraction:
    """Measure the largest Lyapunov exponent of a recursion (Benettin et al. 1980).

    Two sessions of a subject step through the same frames, which repeat. After `warm_up` frames, the history
    of one gets a difference of RMS `size`, linear RGB: small, yet far above rounding. After each round of
    EVERY frames, the difference is measured and scaled back to its size, in the whole history.
    """
    endless = cycle(frames)
    for frame in islice(endless, warm_up):
        base.step(frame)
    state = base.save_state()
    colors = np.asarray(_history(state)[COLOR])
    noise = size * np.random.default_rng(11).standard_normal(colors.shape)
    _load(other, state, {COLOR: np.maximum(colors + noise, 0.0).astype(np.float32)})
    rates = []
    for _ in range(rounds):
        for frame in islice(endless, EVERY):
            base.step(frame)
            other.step(frame)
        state, changed = base.save_state(), other.save_state()
        apart = _rms(_history(changed)[COLOR] - _history(state)[COLOR])
        rates.append(float((apart / size) ** (1.0 / EVERY)))
        if apart < _NOTHING:
            break  # bit for bit the same: everything has faded
        _load(other, changed, dict(_scaled(_history(state), _history(changed), size / apart)))
    return Contraction(rates)


def _history(state: State) -> Any:
    return state.history or {}


def _scaled(base: Any, changed: Any, factor: float) -> Iterator[tuple[str, NDArray[Any]]]:
    """Yield the single-precision tensors of both histories, with their difference scaled by `factor`.

    Tensors other than the colour are clipped to the range of `base`: differences that hardly fade would grow
    without bound.
    """
    for name, array in changed.items():
        if array.dtype == np.float32 and name in base and base[name].shape == array.shape:
            apart = base[name] + factor * (array - base[name])
            kept = apart if name == COLOR else np.clip(apart, base[name].min(), base[name].max())
            yield name, kept.astype(np.float32)


def _load(session: Session, state: State, changes: dict[str, NDArray[Any]]) -> None:
    session.load_state(replace(state, history={**_history(state), **changes}))


def _rms(values: NDArray[Any]) -> float:
    return float(np.sqrt(np.mean(np.square(values, dtype=np.float64))))
