"""Scenarios of hostile frames: bad values, spikes of light, recovery from one bad frame, two passes."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import chain, cycle, islice, product
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from supersampler import Frame, State
from supersampler.frame import Float32, Size
from supersampler.io.display import display_transform
from supersampler_bench.quality.metrics import psnr
from supersampler_bench.stress.compare import Disturbance, VisibleDifference, difference, recovery
from supersampler_bench.stress.scenario import (
    LARGEST,
    RECOVERY,
    ROUNDING,
    STEP,
    Figure,
    Figures,
    Run,
    Session,
    Trial,
    bad_values,
    scenario,
)
from supersampler_bench.stress.scenes import PERIOD, STILL, Orbit, scene_frames, still, truth
from supersampler_model.data.scenes.analytic import AnalyticScene, Plane, zone_plate

FIELDS = ("color", "depth", "motion")
PLACES = ("pixels", "row", "frame")
VALUES: Mapping[str, tuple[float, float, float]] = {  # one for each of FIELDS
    "not a number": (np.nan, np.nan, np.nan),
    "infinite": (np.inf, np.inf, -np.inf),
    "negative": (-1.0, -1.0, -1e5),
    "denormal": (1e-42, 1e-42, 1e-42),
    "huge": (3e38, 1e30, 1e9),
}
Hostile = Callable[[Frame], Iterator[Frame]]
"""Yields hostile versions of a frame."""


def with_values(frame: Frame, field: str, where: NDArray[np.bool_], value: float) -> Frame:
    """Return the frame with a value in a field where the mask (h, w) is True."""
    array = np.array(getattr(frame, field))
    array[where] = value
    fields: dict[str, Any] = {field: array}
    return replace(frame, **fields)


def places(kind: str, size: Size) -> NDArray[np.bool_]:
    """Return a mask (h, w) of a tenth of all pixels, one row, or all pixels."""
    width, height = size
    if kind == "pixels":
        return np.random.default_rng(5).random((height, width)) < 0.1
    where = np.zeros((height, width), bool)
    where[height // 3 if kind == "row" else slice(None)] = True
    return where


def bad_frames(frame: Frame, values: Iterable[tuple[str, float]]) -> Iterator[Frame]:
    """Yield the frame with each (field, value) in each of PLACES."""
    for (field, value), kind in product(values, PLACES):
        yield with_values(frame, field, places(kind, frame.size), value)


def injected(trial: Trial, values: Sequence[float]) -> Figures:
    """A frame's colour, depth or motion has the value in a tenth of the pixels, a row, or all: nine cases."""
    run = Disturbance(trial, trial.still)
    run.step_same(PERIOD)
    worst = 0.0
    for (field, value), kind in product(zip(FIELDS, values, strict=True), PLACES):
        frame = next(run.frames)
        run.step([(with_values(frame, field, places(kind, frame.size), value), frame)])
        worst = max(worst, recovery(run.step_same(trial.subject.recovery + 8)))
    return [Figure("frames until clean", worst, trial.subject.recovery)]


for _name, _values in VALUES.items():
    _frames = len(FIELDS) * len(PLACES) * (RECOVERY + 8)
    scenario(
        "hostile",
        f"values {_name}",
        _values,
        cpu=_frames,
        quick=_frames if _name == "not a number" else 0,
        remembers=False,
    )(injected)

REPLACEMENTS: Mapping[str, float] = {"infinite": LARGEST, "negative": 0.0, "denormal": 0.0, "huge": LARGEST}
"""Linear value that replaces a colour of each kind."""


def lasting(trial: Trial, value: float, replacement: float) -> Figures:
    """A disc of every frame's colour has the value. Images equal those of frames with its replacement."""
    disc, one, other = _disc(trial.render), trial.begin(), trial.begin()
    differences = []
    for frame in islice(cycle(trial.still), trial.frames):
        bad, good = (with_values(frame, "color", disc, value) for value in (value, replacement))
        differences.append(difference(one.step(bad), other.step(good)).mean)
    return [Figure("apart", max(differences), STEP)]


for _name, _value in REPLACEMENTS.items():
    scenario("hostile", f"a region {_name}", VALUES[_name][0], _value, cpu=96, remembers=False)(lasting)


@scenario("hostile", "a region not a number", cpu=96, quick=80, remembers=False)
def lasting_hole(trial: Trial) -> Figures:
    """A disc of every frame's colour is NaN. Its middle is not much darker than its surroundings."""
    disc, session = _disc(trial.render), trial.begin()
    darker: list[float] = []
    width, height = trial.display
    middle = slice(height // 2 - 2, height // 2 + 2), slice(width // 2 - 2, width // 2 + 2)
    for frame in islice(cycle(trial.still), trial.frames):
        image = session.step(with_values(frame, "color", disc, np.nan))
        around = float(np.mean(np.asarray(frame.color)[~disc]))
        darker.append(1.0 - float(image[middle].mean()) / around)
    return [Figure("darker than around", max(darker), 0.5)]


def _disc(render: Size) -> NDArray[np.bool_]:
    width, height = render
    y, x = np.mgrid[:height, :width]
    return np.asarray(np.hypot(x - width / 2, y - height / 2) < height / 8)


WIDE = (192, 96)
"""Display size that is larger than a network's receptive field."""
BLOCK = 8  # display pixels


@scenario("hostile", "one pixel not a number", cpu=128, onnx=64, quick=32, remembers=False)
def spread(trial: Trial) -> Figures:
    """Colour, depth, motion of one pixel are NaN in every frame of 192x96. Only its surroundings change."""
    disturbed, baseline = trial.begin(WIDE), trial.begin(WIDE)
    render = WIDE[0] // 2, WIDE[1] // 2
    x, y = render[0] // 2, render[1] // 2
    where = np.zeros(render[::-1], bool)
    where[y, x] = True
    reach = []
    for frame in islice(cycle(still(render)), trial.frames):
        bad = frame
        for field in FIELDS:
            bad = with_values(bad, field, where, np.nan)
        reach.append(_reach(disturbed.step(bad), baseline.step(frame), x, y))
    return [Figure("reach, pixels", max(reach), trial.subject.reach + BLOCK)]


def _reach(image: Float32, baseline: Float32, x: int, y: int) -> float:
    """Return the display pixels from a render pixel to the far end of the farthest differing block.

    A block has 8x8 pixels and differs if its mean difference exceeds STEP. Single pixels do not count: an
    int8 network rounds them differently as soon as anything differs anywhere.
    """
    apart = np.abs(display_transform(image) - display_transform(baseline)).mean(axis=-1)
    height, width = apart.shape
    blocks = apart.reshape(height // BLOCK, BLOCK, width // BLOCK, BLOCK).mean(axis=(1, 3))
    rows, columns = (BLOCK * (indices + 0.5) for indices in np.nonzero(blocks > STEP))
    away = np.maximum(np.abs(rows - (2 * y + 1)), np.abs(columns - (2 * x + 1)))
    return float(away.max(initial=-0.5 * BLOCK)) + 0.5 * BLOCK


@scenario("hostile", "spike of 65504", cpu=96, quick=56)
def spike(trial: Trial) -> Figures:
    """In one frame, 2x2 pixels have the largest half float."""
    run = Disturbance(trial, trial.still)
    run.step_same(2 * PERIOD)
    where = np.zeros(trial.render[::-1], bool)
    where[4:6, 4:6] = True
    frame = next(run.frames)
    run.step([(with_values(frame, "color", where, LARGEST), frame)])
    return run.measured()


@scenario("hostile", "fireflies", cpu=96)
def fireflies(trial: Trial) -> Figures:
    """In motion, half a percent of the pixels are far too bright for one jitter period."""
    run, random = Disturbance(trial, trial.moving), np.random.default_rng(3)
    run.step_same(PERIOD)
    for frame in islice(run.frames, PERIOD):
        where = random.random(trial.render[::-1]) < 0.005
        light = float(10.0 ** random.uniform(2.0, np.log10(LARGEST)))
        run.step([(with_values(frame, "color", where, light), frame)])
    return run.measured()


@scenario("hostile", "extreme depth", cpu=160)
def extreme_depth(trial: Trial) -> Figures:
    """For two jitter periods, frames are in turn all sky, all infinitely near, and of random depth."""
    run, random = Disturbance(trial, trial.still), np.random.default_rng(2)
    run.step_same(PERIOD)
    for index, frame in enumerate(islice(run.frames, 2 * PERIOD)):
        depths = (0.0, 1e30, 10.0 ** random.uniform(-37.0, 37.0, frame.depth.shape))
        depth = np.broadcast_to(depths[index % 3], frame.depth.shape).astype(np.float32)
        run.step([(replace(frame, depth=depth), frame)])
    return run.measured()


CLEAN = 30
"""Number of clean frames after the hostile one."""
MIN_BOUND = VisibleDifference(mean=0.1 / 255.0, p999=4.0 / 255.0)
"""Smallest bound of the difference in the last clean frame, for every method."""
RESETS = (0, -2, 2, -4, 4)
"""Frames, relative to the hostile one, at which a reset is measured for the bound. The error after a reset
varies with the jitter phase. All are even, because every second frame may be extrapolated."""
EXPOSURES = (1e30, 1e-40, 1e-3, 1e4)
BRIGHT = (10.0, 100.0, 1500.0)
"""Linear colour of a lamp, a spark and the sun on metal, which clean frames contain, too."""


def one_frame(trial: Trial, hostile: Hostile) -> Figures:
    """One hostile frame, then 30 clean ones: the largest difference from an undisturbed session.

    Exposure is measured. The bound is the largest difference after a reset at that frame, or at the second or
    fourth frame before or after it.
    """
    session = trial.begin()
    frames = [replace(frame, exposure=None) for frame in trial.still]
    starts, period = dict[int, _Start](), len(frames)
    for index in range(period + max(RESETS) + 1):
        if index - period in RESETS:
            following = [frames[(index + later) % period] for later in range(CLEAN + 1)]
            starts[index - period] = _Start(session, session.save_state(), following)
        session.step(frames[index % period])
    resets = {
        offset: [replace(bad, reset=True) for bad in hostile(start.frames[0])]
        for offset, start in starts.items()
    }
    results = []
    for case, bad in enumerate(hostile(starts[0].frames[0])):
        error = starts[0].error_after(bad)
        after_resets = (starts[offset].error_after(resets[offset][case]) for offset in RESETS)
        results.append((error, hostile_bound(error, after_resets)))
    means = [(error.mean, bound.mean) for error, bound in results]
    outliers = [(error.p999, bound.p999) for error, bound in results]
    return [
        Figure("difference", *max(means, key=lambda pair: pair[0] / pair[1])),
        Figure("difference at 99.9 %", *max(outliers, key=lambda pair: pair[0] / pair[1])),
    ]


@dataclass(frozen=True)
class _Start:
    """A session, its state before a frame, and the frames from that one on."""

    session: Session
    state: State
    frames: Sequence[Frame]

    def error_after(self, first: Frame) -> VisibleDifference:
        """Return the difference in the last image if `first` replaces the first frame."""
        return difference(self._last_image(first), self._baseline)

    @cached_property
    def _baseline(self) -> Float32:
        return self._last_image(self.frames[0])

    def _last_image(self, first: Frame) -> Float32:
        self.session.load_state(self.state)
        self.session.step(first)
        return [self.session.step(later) for later in self.frames[1:]][-1]


def hostile_bound(error: VisibleDifference, after_resets: Iterable[VisibleDifference]) -> VisibleDifference:
    """Return the bound of an error: the largest error after a reset, at least MIN_BOUND.

    Resets are measured only until the bound reaches `error`, because further ones do not change the result.
    """
    bound = MIN_BOUND
    for other in after_resets:
        bound = VisibleDifference(
            max(bound.mean, other.mean + ROUNDING), max(bound.p999, other.p999 + ROUNDING)
        )
        if error.mean <= bound.mean and error.p999 <= bound.p999:
            break
    return bound


def _other_exposures(frame: Frame) -> Iterator[Frame]:
    return (replace(frame, exposure=exposure) for exposure in EXPOSURES)


def _spoiled(values: Iterable[tuple[str, float]]) -> Hostile:
    pairs = list(values)
    return lambda frame: bad_frames(frame, pairs)


_ONE_FRAME: Mapping[str, tuple[Hostile, int]] = {
    "exposure": (_other_exposures, len(EXPOSURES)),
    **{
        field: (_spoiled((field, values[i]) for values in VALUES.values()), 3 * len(VALUES))
        for i, field in enumerate(FIELDS)
    },
    "bright light": (_spoiled(("color", value) for value in BRIGHT), 3 * len(BRIGHT)),
    "brightest light": (_spoiled([("color", LARGEST)]), 3),
}
"""Hostile frames, and their number."""
for _name, (_hostile, _cases) in _ONE_FRAME.items():
    _frames = 2 * _cases * CLEAN
    scenario(
        "recovery",
        f"one frame's {_name}",
        _hostile,
        cpu=_frames,
        quick=_frames if _name == "exposure" else 0,
        ratios=None,
    )(one_frame)

HARM = 0.05
"""PSNR, dB, that a shot may lose by the second pass."""
STATIC: Sequence[AnalyticScene] = (STILL, Plane(zone_plate))
SCENES: Sequence[AnalyticScene] = (STILL, Orbit(), Plane(zone_plate, velocity=(0.37, 0.21)))
SPOILED = 24
"""Number of frames of a shot with one hostile frame."""


class StressShot(NamedTuple):
    """Frames between two cuts, and their exact images."""

    frames: Sequence[Frame]
    truths: Sequence[Float32]


def shots_of(trial: Trial, lengths: Sequence[int], of: Sequence[AnalyticScene]) -> Figures:
    """Upscale shots of some lengths, one after another."""
    return _lost(trial, _shots(trial, lengths, of))


def hostile_shots(trial: Trial, hostile: Hostile) -> Figures:
    """Shots of 24 frames whose first, middle or last frame is hostile. Exposure is measured."""
    (shot,) = _shots(trial, (SPOILED,), (Orbit(),))
    frames = [replace(frame, exposure=None) for frame in shot.frames]
    shots = [
        StressShot([*frames[:place], bad, *frames[place + 1 :]], shot.truths)
        for place in (0, SPOILED // 2, SPOILED - 1)
        for bad in hostile(frames[place])
    ]
    return _lost(trial, shots)


def _two_passes(name: str, run: Run, frames: int, *arguments: object, description: str = "") -> None:
    scenario(
        "two-passes",
        f"two passes: {name}",
        *arguments,
        description=description,
        cpu=frames,
        quick=frames if frames < 30 else 0,
        remembers=False,
        two_passes=True,
        ratios=None,
    )(run)


for _name, _lengths, _scenes, _text in (
    ("cuts", (12, 3, 8, 5) * 3, SCENES, "Shots of 12, 3, 8 and 5 frames."),
    ("single frames", (8, 1) * 6, SCENES, "Single frames between shots of eight."),
    ("one frame", (1,) * 12, SCENES, "Shots of one frame each."),
    ("two frames", (2,) * 12, SCENES, "Shots of two frames each."),
    ("still", (8, 40, 160) * 2, STATIC, "Shots of 8, 40 and 160 frames in which nothing moves."),
):
    _two_passes(_name, shots_of, sum(_lengths), _lengths, _scenes, description=_text)
for _name, _values in VALUES.items():
    _two_passes(_name, hostile_shots, 27 * SPOILED, _spoiled(zip(FIELDS, _values, strict=True)))
_two_passes("exposure", hostile_shots, 12 * SPOILED, _other_exposures)


def _shots(trial: Trial, lengths: Sequence[int], of: Sequence[AnalyticScene]) -> list[StressShot]:
    """Return shots of some lengths, which cycle through the scenes; frame numbers continue across shots."""
    shots, first = [], 0
    for length, scene in zip(lengths, cycle(of), strict=False):
        stop = first + length
        truths = [truth(scene, 0 if scene in STATIC else i, trial.display) for i in range(first, stop)]
        shots.append(StressShot(scene_frames(scene, trial.render, stop)[first:], truths))
        first = stop
    return shots


def _lost(trial: Trial, shots: Sequence[StressShot]) -> Figures:
    """Upscale shots with cuts between them, in one pass and in two; measure the PSNR lost by the second."""
    upscaled = trial.subject.sequences
    if upscaled is None:
        raise TypeError(f"{trial.subject.method} has one pass")  # see `Scenario.suits`
    frames = [replace(frame, reset=i == 0) for shot in shots for i, frame in enumerate(shot.frames)]
    images = [list(upscaled(frames, trial.display, passes)) for passes in (1, 2)]
    truths = [display_transform(image) for shot in shots for image in shot.truths]
    stops = np.cumsum([len(shot.frames) for shot in shots])
    one, two = (
        np.array([part.mean() for part in np.split(_scores(each, truths), stops[:-1])]) for each in images
    )
    lost = one - two
    trial.bad_values += sum(map(bad_values, chain(*images)))
    return [
        Figure("PSNR lost, mean of shots, dB", float(lost.mean()), HARM),
        Figure("PSNR lost, worst shot, dB", float(lost.max()), HARM),
    ]


def _scores(images: Sequence[Float32], truths: Sequence[Float32]) -> list[float]:
    return [psnr(display_transform(image), truth) for image, truth in zip(images, truths, strict=True)]
