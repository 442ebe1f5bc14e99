"""Scenarios of one hostile frame: its remaining error thirty clean frames later."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product

from supersampler import Frame
from supersampler.frame import Float32
from supersampler.history import State
from supersampler_bench.stress.compare import Difference, difference
from supersampler_bench.stress.hostile import VALUES, places, with_values
from supersampler_bench.stress.scenario import (
    LARGEST,
    ROUNDING,
    Figure,
    Measured,
    Scenario,
    Trial,
    Watched,
)
from supersampler_bench.stress.scenes import still

CLEAN = 30
"""Number of clean frames after the hostile one."""
LEAST_BOUND = Difference(mean=0.1 / 255.0, most=4.0 / 255.0)
"""Smallest bound of the difference in the last clean frame: 0.1 steps of an 8-bit image in the mean, and 4 at
99.9 % of the values."""
RESETS = (0, -2, 2, -4, 4)
"""Frames, relative to the hostile one, at which a reset is measured for the bound. The error after a reset
varies with the jitter phase. All are even, because every second frame may be extrapolated."""
EXPOSURES = (1e30, 1e-40, 1e-3, 1e4)
HOSTILE: Mapping[str, Sequence[float]] = {
    field: [values[i] for values in VALUES.values()] for i, field in enumerate(("color", "depth", "motion"))
}
BRIGHT = (10.0, 100.0, 1500.0)
"""Linear colour of a lamp, a spark and the sun on metal: clean frames contain such values, too."""


class _OneFrame:
    """One hostile frame, then 30 clean ones: largest difference from an undisturbed session.

    The exposure is measured. The bound is the largest difference after a reset at that frame, or at the
    second or fourth frame before or after it.
    """

    def __init__(self, hostile: Callable[[Frame], Iterable[Frame]]) -> None:
        self._hostile = hostile

    def __call__(self, trial: Trial) -> Measured:
        session = trial.begin()
        frames = [replace(frame, exposure=None) for frame in still(trial.render, trial.every)]
        starts = {}
        period = len(frames)
        for index in range(period + max(RESETS) + 1):
            if index - period in RESETS:
                following = [frames[(index + later) % period] for later in range(CLEAN + 1)]
                starts[index - period] = _Start(session, session.save_state(), following)
            session.step(frames[index % period])
        resets = {
            offset: [replace(bad, reset=True) for bad in self._hostile(start.frames[0])]
            for offset, start in starts.items()
        }
        curves, results = [], []
        for case, bad in enumerate(self._hostile(starts[0].frames[0])):
            errors = starts[0].errors_after(bad)
            after_resets = (starts[offset].errors_after(resets[offset][case])[-1] for offset in RESETS)
            curves.append([error.mean for error in errors])
            results.append((errors[-1], hostile_bound(errors[-1], after_resets)))
        figures = [_worst(results, name) for name in ("mean", "most")]
        return Measured(tuple(figures), max(curves, key=lambda curve: curve[-1]))


@dataclass(frozen=True)
class _Start:
    """A frame of the run: the session, its state before that frame, and the frames from that one on."""

    session: Watched
    state: State
    frames: Sequence[Frame]

    def errors_after(self, first: Frame) -> list[Difference]:
        """Return the differences of the clean frames' images when `first` replaces the first frame."""
        images = zip(self._images(first), self._baseline, strict=True)
        return [difference(one, other) for one, other in images]

    @cached_property
    def _baseline(self) -> list[Float32]:
        return self._images(self.frames[0])

    def _images(self, first: Frame) -> list[Float32]:
        self.session.load_state(self.state)
        self.session.step(first)
        return [self.session.step(later) for later in self.frames[1:]]


def hostile_bound(error: Difference, after_resets: Iterable[Difference]) -> Difference:
    """Return the bound of an error: LEAST_BOUND, or the largest error after a reset if that is larger.

    Resets are measured only until the bound reaches `error`: further ones would not change the verdict.
    """
    bound = LEAST_BOUND
    for other in after_resets:
        bound = Difference(max(bound.mean, other.mean + ROUNDING), max(bound.most, other.most + ROUNDING))
        if error.mean <= bound.mean and error.most <= bound.most:
            break
    return bound


def _worst(results: Sequence[tuple[Difference, Difference]], name: str) -> Figure:
    """Return the figure with the largest ratio of error to bound, of (error, bound) pairs."""
    found = [(getattr(error, name), getattr(bound, name)) for error, bound in results]
    value, bound = max(found, key=lambda pair: pair[0] / pair[1])
    return Figure({"mean": "difference", "most": "difference at 99.9 %"}[name], value, bound)


def _spoils(field: str, values: Sequence[float]) -> Callable[[Frame], Iterator[Frame]]:
    def hostile(frame: Frame) -> Iterator[Frame]:
        for value, kind in product(values, ("pixels", "row", "frame")):
            yield with_values(frame, field, places(kind, frame), value)

    return hostile


def _exposures(frame: Frame) -> Iterator[Frame]:
    return (replace(frame, exposure=exposure) for exposure in EXPOSURES)


def _scenario(name: str, hostile: Callable[[Frame], Iterable[Frame]], cases: int) -> Scenario:
    return Scenario(
        f"one frame's {name}",
        "difference / frame",
        _OneFrame(hostile),
        cpu=2 * cases * CLEAN,
        onnx=2 * cases * CLEAN,
        quick=2 * cases * CLEAN if name == "exposure" else 0,
        ratios=None,
    )


SCENARIOS = (
    _scenario("exposure", _exposures, len(EXPOSURES)),
    *(_scenario(field, _spoils(field, values), 3 * len(values)) for field, values in HOSTILE.items()),
    _scenario("bright light", _spoils("color", BRIGHT), 3 * len(BRIGHT)),
    _scenario("brightest light", _spoils("color", [LARGEST]), 3),
)
