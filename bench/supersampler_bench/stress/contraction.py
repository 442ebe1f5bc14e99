"""Growth rate of errors in the history: the largest Lyapunov exponent, after Benettin et al. 1980.

Two sessions step through the same frames; the second one's history differs by a little. Every few frames that
difference is measured and scaled back to its size, in all that the history holds. What it shrinks by, in the
geometric mean, is how fast the slowest of all errors fades.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from supersampler import Frame
from supersampler.history import State
from supersampler_bench.stress.scenario import Session

EVERY = 16
"""Frames between measurements: few enough that the difference stays far above rounding."""
COLOR = "history.color"
_NOTHING = 1e-12


@dataclass(frozen=True)
class Contraction:
    """What a difference shrinks by; above 1 it grows.

    Attributes:
        rates: a frame, of every `EVERY` frames.
    """

    rates: list[float]

    @property
    def last(self) -> list[float]:
        """The second half, in which the slowest of all errors is what is left."""
        return self.rates[len(self.rates) // 2 :]

    @property
    def rate(self) -> float:
        """A frame; the geometric mean of the second half."""
        return float(np.exp(np.log(np.maximum(self.last, _NOTHING)).mean()))


def contraction(
    base: Session, other: Session, frames: Sequence[Frame], rounds: int, size: float, warm_up: int
) -> Contraction:
    """Measure it.

    Args:
        base: a session.
        other: a second one of the same.
        frames: over and over.
        rounds: of `EVERY` frames.
        size: root mean square of the difference, linear RGB: small, yet far above what the precision rounds.
        warm_up: frames before there is a difference.
    """
    endless = (frames[i % len(frames)] for i in range(warm_up + rounds * EVERY))
    for _ in range(warm_up):
        base.step(next(endless))
    state = base.save_state()
    random = np.random.default_rng(11)
    colors = np.asarray(_history(state)[COLOR])
    noise = size * random.standard_normal(colors.shape)
    _load(other, state, {COLOR: np.maximum(colors + noise, 0.0).astype(np.float32)})
    rates = []
    for _ in range(rounds):
        for _ in range(EVERY):
            frame = next(endless)
            base.step(frame)
            other.step(frame)
        state, changed = base.save_state(), other.save_state()
        apart = _rms(_history(changed)[COLOR] - _history(state)[COLOR])
        rates.append(float((apart / size) ** (1.0 / EVERY)))
        if apart < _NOTHING:
            break  # bit for bit the same: all has faded
        _load(other, changed, _scaled(_history(state), _history(changed), size / apart))
    return Contraction(rates)


def _history(state: State) -> Any:
    return state.history or {}


def _scaled(base: Any, changed: Any, factor: float) -> dict[str, NDArray[Any]]:
    """All of single precision that is in both, `factor` times as far apart.

    Other planes than the colour are clipped to the range of `base`: differences that hardly fade would grow
    without bound.
    """
    found: dict[str, NDArray[Any]] = {}
    for name, array in changed.items():
        if array.dtype == np.float32 and name in base and base[name].shape == array.shape:
            apart = base[name] + factor * (array - base[name])
            kept = apart if name == COLOR else np.clip(apart, base[name].min(), base[name].max())
            found[name] = kept.astype(np.float32)
    return found


def _load(session: Session, state: State, changes: dict[str, NDArray[Any]]) -> None:
    session.load_state(replace(state, history={**_history(state), **changes}))


def _rms(values: NDArray[Any]) -> float:
    return float(np.sqrt(np.mean(np.square(values, dtype=np.float64))))
