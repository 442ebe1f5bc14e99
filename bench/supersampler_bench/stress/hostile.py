"""Scenarios of bad values: NaN, infinite, negative, denormal, huge; spikes of light."""

from collections.abc import Mapping
from dataclasses import replace
from itertools import cycle, islice, product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from supersampler import Frame
from supersampler.frame import Float32, Size
from supersampler.io.display import display_transform
from supersampler_bench.stress.compare import recovery, recovery_figure, same_frames, step_both
from supersampler_bench.stress.scenario import LARGEST, RECOVERY, STEP, Figure, Measured, Scenario, Trial
from supersampler_bench.stress.scenes import PERIOD, moving, still

WATCHED = RECOVERY + 8
"""Frames that are watched after a disturbance."""
WIDE = (192, 96)
"""Where a bad pixel could reach farther than a network sees."""
BLOCK = 8  # display pixels
FIELDS = ("color", "depth", "motion")
PLACES = ("pixels", "row", "frame")
VALUES: Mapping[str, tuple[float, float, float]] = {  # of each field
    "not a number": (np.nan, np.nan, np.nan),
    "infinite": (np.inf, np.inf, -np.inf),
    "negative": (-1.0, -1.0, -1e5),
    "denormal": (1e-42, 1e-42, 1e-42),
    "huge": (3e38, 1e30, 1e9),
}
_CASES = len(FIELDS) * len(PLACES)


def with_values(frame: Frame, field: str, where: NDArray[np.bool_], value: float) -> Frame:
    """Return the frame with `value` in a field, where the mask (h, w) is True."""
    array = np.array(getattr(frame, field))
    array[where] = value
    fields: dict[str, Any] = {field: array}
    return replace(frame, **fields)


def places(kind: str, frame: Frame) -> NDArray[np.bool_]:
    """(h, w) a tenth of all pixels, one row, or all."""
    width, height = frame.size
    if kind == "pixels":
        return np.random.default_rng(5).random((height, width)) < 0.1
    where = np.zeros((height, width), bool)
    where[height // 3 if kind == "row" else slice(None)] = True
    return where


class _Injected:
    """In one frame's colour, depth, motion; in a tenth of its pixels, in a row, in all: nine in turn."""

    def __init__(self, values: tuple[float, float, float]) -> None:
        self._values = dict(zip(FIELDS, values, strict=True))

    def __call__(self, trial: Trial) -> Measured:
        disturbed, baseline = trial.pair()
        frames = cycle(still(trial.render, trial.every))
        step_both(disturbed, baseline, same_frames(frames, PERIOD))
        differences, worst = [], 0.0
        for field, kind in product(FIELDS, PLACES):
            frame = next(frames)
            bad = with_values(frame, field, places(kind, frame), self._values[field])
            differences += step_both(disturbed, baseline, [(bad, frame)])
            after = step_both(disturbed, baseline, same_frames(frames, trial.subject.recovery + 8))
            worst, differences = max(worst, recovery(after)), differences + after
        return Measured(
            (Figure("frames until clean", worst, trial.subject.recovery),), [o.mean for o in differences]
        )


COUNTS_AS: Mapping[str, float] = {"infinite": LARGEST, "negative": 0.0, "denormal": 0.0, "huge": LARGEST}
"""What such a colour is shown as."""


class _Lasting:
    """In a disc of every frame's colour: images are those of frames with what counts there instead."""

    def __init__(self, value: float, counts_as: float) -> None:
        self._value, self._counts_as = value, counts_as

    def __call__(self, trial: Trial) -> Measured:
        disc, pairs = _disc(trial.render), []
        for frame in islice(cycle(still(trial.render, trial.every)), trial.frames):
            bad = with_values(frame, "color", disc, self._value)
            pairs.append((bad, with_values(frame, "color", disc, self._counts_as)))
        differences = [o.mean for o in step_both(trial.begin(), trial.begin(), pairs)]
        return Measured((Figure("apart", max(differences), STEP),), differences)


def lasting_hole(trial: Trial) -> Measured:
    """A disc of every frame's colour is not a number: its middle is not much darker than around it."""
    disc, session = _disc(trial.render), trial.begin()
    curve: list[float] = []
    width, height = trial.display
    middle = slice(height // 2 - 2, height // 2 + 2), slice(width // 2 - 2, width // 2 + 2)
    for frame in islice(cycle(still(trial.render, trial.every)), trial.frames):
        image = session.step(with_values(frame, "color", disc, np.nan))
        around = float(np.mean(np.asarray(frame.color)[~disc]))
        curve.append(1.0 - float(image[middle].mean()) / around)
    return Measured((Figure("darker than around", max(curve), 0.5),), curve)


def _disc(render: Size) -> NDArray[np.bool_]:
    width, height = render
    y, x = np.mgrid[:height, :width]
    return np.asarray(np.hypot(x - width / 2, y - height / 2) < height / 8)


def spread(trial: Trial) -> Measured:
    """Colour, depth and motion of one pixel are NaN in each frame of 192x96: only its surroundings change."""
    disturbed, baseline = trial.begin(WIDE), trial.begin(WIDE)
    render = WIDE[0] // 2, WIDE[1] // 2
    x, y = render[0] // 2, render[1] // 2
    where = np.zeros(render[::-1], bool)
    where[y, x] = True
    curve = []
    for frame in islice(cycle(still(render)), trial.frames):
        bad = frame
        for field in FIELDS:
            bad = with_values(bad, field, where, np.nan)
        curve.append(_reach(disturbed.step(bad), baseline.step(frame), x, y))
    return Measured((Figure("reach, pixels", max(curve), trial.subject.reach + BLOCK),), curve)


def _reach(image: Float32, baseline: Float32, x: int, y: int) -> float:
    """Distance, display pixels, from a render pixel's middle to the end of the farthest block that differs.

    Blocks of 8x8, by a step on average: with an int8 network, single pixels are rounded otherwise as soon
    as anything differs anywhere.
    """
    apart = np.abs(display_transform(image) - display_transform(baseline)).mean(axis=-1)
    height, width = apart.shape
    blocks = apart.reshape(height // BLOCK, BLOCK, width // BLOCK, BLOCK).mean(axis=(1, 3))
    rows, columns = (BLOCK * (places + 0.5) for places in np.nonzero(blocks > STEP))
    away = np.maximum(np.abs(rows - (2 * y + 1)), np.abs(columns - (2 * x + 1)))
    return float(away.max(initial=-0.5 * BLOCK)) + 0.5 * BLOCK


def spike(trial: Trial) -> Measured:
    """2x2 pixels have the brightest light of half floats, in one frame."""
    disturbed, baseline = trial.pair()
    frames = cycle(still(trial.render, trial.every))
    step_both(disturbed, baseline, same_frames(frames, 2 * PERIOD))
    frame = next(frames)
    where = np.zeros(trial.render[::-1], bool)
    where[4:6, 4:6] = True
    during = step_both(disturbed, baseline, [(with_values(frame, "color", where, LARGEST), frame)])
    return recovery_figure(trial, during, step_both(disturbed, baseline, same_frames(frames, trial.watched)))


def fireflies(trial: Trial) -> Measured:
    """In motion, for a period, half a percent of the pixels are far too bright."""
    disturbed, baseline = trial.pair()
    frames, random = cycle(moving(trial.render, trial.every)), np.random.default_rng(3)
    step_both(disturbed, baseline, same_frames(frames, PERIOD))
    during = []
    for frame in islice(frames, PERIOD):
        where = random.random(trial.render[::-1]) < 0.005
        bad = with_values(frame, "color", where, float(10.0 ** random.uniform(2.0, np.log10(LARGEST))))
        during += step_both(disturbed, baseline, [(bad, frame)])
    return recovery_figure(trial, during, step_both(disturbed, baseline, same_frames(frames, trial.watched)))


SCENARIOS = (
    *(
        Scenario(
            f"values {name}",
            "difference / frame",
            _Injected(values),
            cpu=_CASES * WATCHED,
            onnx=_CASES * WATCHED,
            quick=_CASES * WATCHED if name == "not a number" else 0,
            remembers=False,
        )
        for name, values in VALUES.items()
    ),
    *(
        Scenario(
            f"a region {name}",
            "difference / frame",
            _Lasting(VALUES[name][0], counts_as),
            cpu=96,
            onnx=96,
            remembers=False,
        )
        for name, counts_as in COUNTS_AS.items()
    ),
    Scenario(
        "a region not a number",
        "darker / frame",
        lasting_hole,
        cpu=96,
        onnx=96,
        quick=80,
        remembers=False,
        logarithmic=False,
    ),
    Scenario(
        "one pixel not a number",
        "reach / frame",
        spread,
        cpu=128,
        onnx=64,
        quick=32,
        remembers=False,
        logarithmic=False,
    ),
    Scenario("spike of 65504", "difference / frame", spike, cpu=96, onnx=96, quick=56),
    Scenario("fireflies", "difference / frame", fireflies, cpu=96, onnx=96),
)
