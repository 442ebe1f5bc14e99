"""Scenarios of one hostile frame: its remaining error thirty clean frames later."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import cycle, islice, product

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
EXPOSURES = (1e30, 1e-40, 1e-3, 1e4)
HOSTILE: Mapping[str, Sequence[float]] = {
    field: [values[i] for values in VALUES.values()] for i, field in enumerate(("color", "depth", "motion"))
}
BRIGHT = (10.0, 100.0, 1500.0)
"""Light that scenes hold, too: of the sun on metal, a lamp, a spark."""


class _OneFrame:
    """One hostile frame, then 30 clean ones: worst difference from a session without it, exposure measured.

    What a cut at that frame leaves is allowed, too.
    """

    def __init__(self, hostile: Callable[[Frame], Iterable[Frame]]) -> None:
        self._hostile = hostile

    def __call__(self, trial: Trial) -> Measured:
        session = trial.begin()
        frames = cycle([replace(frame, exposure=None) for frame in still(trial.render)])
        for frame in islice(frames, PERIOD):
            session.step(frame)
        state, frame, clean = session.save_state(), next(frames), list(islice(frames, CLEAN))
        baseline = _after(session, state, frame, clean)
        tried = []
        for bad in self._hostile(frame):
            differences = _agreement(_after(session, state, bad, clean), baseline)
            cut = _agreement(_after(session, state, replace(bad, reset=True), clean), baseline)
            tried.append((differences, cut[-1]))
        figures = [_worst(tried, name) for name in ("mean", "most")]
        return Measured(
            tuple(figures), [o.mean for o in max((o for o, _ in tried), key=lambda o: o[-1].mean)]
        )


def _after(session: Watched, state: State, frame: Frame, clean: Sequence[Frame]) -> list[Float32]:
    session.load_state(state)
    session.step(frame)
    return [session.step(later) for later in clean]


def _agreement(images: Sequence[Float32], baseline: Sequence[Float32]) -> list[Difference]:
    return [difference(one, other) for one, other in zip(images, baseline, strict=True)]


def _worst(tried: Sequence[tuple[Sequence[Difference], Difference]], name: str) -> Figure:
    """What is farthest beyond its bound, or nearest to it."""
    limit: float = getattr(SEEN, name)
    found = [
        (getattr(differences[-1], name), max(limit, getattr(cut, name) + ROUNDING))
        for differences, cut in tried
    ]
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
