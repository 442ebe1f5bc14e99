"""Scenarios of jitter that is extreme or wrong, sizes that are odd or tiny, ratios that change."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import cycle, product

import numpy as np

from supersampler import Frame, halton_jitter
from supersampler.frame import Size
from supersampler_bench.stress.compare import recovery_figure, repeat, same_frames, step_both
from supersampler_bench.stress.scenario import DECAY, REST, Figure, Measured, Scenario, Trial
from supersampler_bench.stress.scenes import PERIOD, RATIO, STILL, still, truth

Jitter = tuple[float, float]
CORNERS: Sequence[Jitter] = ((-0.5, -0.5), (0.5, 0.5), (-0.5, 0.5), (0.5, -0.5))
SWEEP = 96  # frames from the least ratio to the largest and back
LARGEST_RATIO = 3.0
FLAT = 1e-3
"""By how much, of itself, an image of one colour may be off."""
SIZES: Sequence[Size] = ((1, 1), (1, 7), (7, 1), (2, 2), (3, 5), (17, 13), (31, 33), (97, 61))


def corners(trial: Trial) -> Measured:
    """Samples lie in the four corners of pixels by turns, then as they should: a period more."""
    count = PERIOD * trial.every
    frames = [STILL.frame(0, trial.render, CORNERS[i // trial.every % 4]) for i in range(count)]
    return _disturbed(trial, frames, more=PERIOD)


def missing(trial: Trial) -> Measured:
    """Frames are jittered, and their `jitter` is (0, 0)."""
    return _disturbed(trial, _with_jitter(trial, lambda _: (0.0, 0.0)))


def negated(trial: Trial) -> Measured:
    """The `jitter` of frames has the wrong sign."""
    return _disturbed(trial, _with_jitter(trial, lambda jitter: (-jitter[0], -jitter[1])))


def _with_jitter(trial: Trial, jitter_of: Callable[[Jitter], Jitter]) -> list[Frame]:
    return [replace(frame, jitter=jitter_of(frame.jitter)) for frame in still(trial.render, trial.every)]


def _disturbed(trial: Trial, frames: Sequence[Frame], more: int = 0) -> Measured:
    """These frames in place of the right ones: images settle even so, and recover."""
    wrong = [replace(frame, reset=False) for frame in frames]
    settles = repeat(trial, wrong)
    disturbed, baseline = trial.pair()
    right = still(trial.render, trial.every)
    during = step_both(disturbed, baseline, zip(wrong * 4, [*right] * 4, strict=True))
    watched = max(5 * PERIOD, trial.subject.recovery + more + 8)
    after = step_both(disturbed, baseline, same_frames(cycle(right), watched))
    recovers = recovery_figure(trial, during, after, more)
    return Measured(
        (Figure("change in a period", settles.changes[-1], REST), *recovers.figures), recovers.curve
    )


def sweep(trial: Trial) -> Measured:
    """The ratio goes from 1 to 3 and back, over and over, another render size in each frame."""
    frames = []
    for index in range(SWEEP):
        ratio = 0.5 * (1.0 + LARGEST_RATIO - (LARGEST_RATIO - 1.0) * np.cos(2.0 * np.pi * index / SWEEP))
        size = math.ceil(trial.display[0] / ratio), math.ceil(trial.display[1] / ratio)
        jitter = halton_jitter(index // trial.every, ratio)
        frames.append(replace(STILL.frame(index, size, jitter), reset=False))
    run = repeat(trial, frames, [truth(STILL, 0, trial.display)] * SWEEP)
    figures = (Figure("change in a loop", run.changes[-1], REST), Figure("PSNR lost, dB", run.lost(), DECAY))
    return Measured(figures, run.changes)


def sizes(trial: Trial) -> Measured:
    """Renders from 1x1 to 97x61, at ratios 1, 1.5, 2 and 3: an image of one colour stays so."""
    curve = []
    for render, ratio in product(SIZES, (1.0, 1.5, RATIO, LARGEST_RATIO)):
        session = trial.begin((round(ratio * render[0]), round(ratio * render[1])))
        for index in range(trial.frames):
            frame = replace(STILL.frame(index, render, halton_jitter(index, ratio)), reset=False)
            session.step(frame)
        flat = replace(frame, color=np.full((*render[::-1], 3), 0.5, np.float32))
        session.step(replace(flat, reset=True))
        curve.append(float(np.abs(session.step(flat) / 0.5 - 1.0).max()))
    return Measured((Figure("error on a flat colour", max(curve), FLAT),), curve)


SCENARIOS = (
    Scenario("jitter in the corners", "difference / frame", corners, cpu=640, onnx=320),
    Scenario("jitter missing", "difference / frame", missing, cpu=640, onnx=320, quick=128),
    Scenario("jitter negated", "difference / frame", negated, cpu=640, onnx=320),
    Scenario(
        "ratios from 1 to 3",
        "change / loop",
        sweep,
        cpu=1152,
        onnx=576,
        quick=288,
        remembers=False,
        ratios=(1.0, LARGEST_RATIO),
    ),
    Scenario(
        "odd and tiny sizes",
        "error / size",
        sizes,
        cpu=4,
        onnx=4,
        quick=2,
        remembers=False,
        ratios=(1.0, LARGEST_RATIO),
    ),
)
