"""Scenarios of one hostile frame: its remaining error thirty clean frames later."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product

from supersampler import Frame
from supersampler.frame import Float32
from supersampler.state import State
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
from supersampler_bench.stress.scenes import PERIOD, still

CLEAN = 30
"""Frames that follow the hostile one."""
SEEN = Difference(mean=0.1 / 255.0, most=4.0 / 255.0)
"""What the last of them may differ by: no one sees it."""
CUTS = (0, -2, 2, -4, 4)
"""Frames after the hostile one at which cuts are drawn: what a cut leaves depends on the jitter that it meets
and on chance. All are even, as every second frame may be extrapolated."""
EXPOSURES = (1e30, 1e-40, 1e-3, 1e4)
HOSTILE: Mapping[str, Sequence[float]] = {
    field: [values[i] for values in VALUES.values()] for i, field in enumerate(("color", "depth", "motion"))
}
BRIGHT = (10.0, 100.0, 1500.0)
"""Light that scenes hold, too: of the sun on metal, a lamp, a spark."""


class _OneFrame:
    """One hostile frame, then 30 clean ones: worst difference from a session without it, exposure measured.

    What a cut leaves is allowed, too: the most of five draws, at that frame and at the second and the fourth
    before and after it.
    """

    def __init__(self, hostile: Callable[[Frame], Iterable[Frame]]) -> None:
        self._hostile = hostile

    def __call__(self, trial: Trial) -> Measured:
        session = trial.begin()
        frames = [replace(frame, exposure=None) for frame in still(trial.render)]
        places = {}
        for index in range(PERIOD + max(CUTS) + 1):
            if index - PERIOD in CUTS:
                following = [frames[(index + later) % PERIOD] for later in range(CLEAN + 1)]
                places[index - PERIOD] = _Place(session, session.save_state(), following)
            session.step(frames[index % PERIOD])
        cuts = {
            at: [replace(bad, reset=True) for bad in self._hostile(place.frames[0])]
            for at, place in places.items()
        }
        tried = []
        for case, bad in enumerate(self._hostile(places[0].frames[0])):
            left = places[0].left_by(bad)
            tried.append(
                (left, hostile_bound(left[-1], (places[at].left_by(cuts[at][case])[-1] for at in CUTS)))
            )
        figures = [_worst(tried, name) for name in ("mean", "most")]
        return Measured(
            tuple(figures), [o.mean for o in max((o for o, _ in tried), key=lambda o: o[-1].mean)]
        )


@dataclass(frozen=True)
class _Place:
    """A place in the run: the session, its state there, and the frames from there on."""

    session: Watched
    state: State
    frames: Sequence[Frame]

    def left_by(self, first: Frame) -> list[Difference]:
        """Return how images of the clean frames differ if the first frame is replaced."""
        images = zip(self._images(first), self._baseline, strict=True)
        return [difference(one, other) for one, other in images]

    @cached_property
    def _baseline(self) -> list[Float32]:
        return self._images(self.frames[0])

    def _images(self, first: Frame) -> list[Float32]:
        self.session.load_state(self.state)
        self.session.step(first)
        return [self.session.step(later) for later in self.frames[1:]]


def hostile_bound(left: Difference, cuts: Iterable[Difference]) -> Difference:
    """Return SEEN, or the most of what cuts leave; cuts are drawn until one leaves more than `left`."""
    bound = SEEN
    for cut in cuts:
        bound = Difference(max(bound.mean, cut.mean + ROUNDING), max(bound.most, cut.most + ROUNDING))
        if left.mean <= bound.mean and left.most <= bound.most:
            break
    return bound


def _worst(tried: Sequence[tuple[Sequence[Difference], Difference]], name: str) -> Figure:
    """What is farthest beyond its bound, or nearest to it."""
    found = [(getattr(left[-1], name), getattr(bound, name)) for left, bound in tried]
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
