"""Scenarios of exposure and light that jump."""

import math
from collections.abc import Iterator
from dataclasses import replace
from itertools import cycle, islice

import numpy as np

from supersampler import Frame
from supersampler_bench.stress.compare import recovery_figure, same_frames, step_both
from supersampler_bench.stress.scenario import Measured, Scenario, Trial
from supersampler_bench.stress.scenes import PERIOD, still

STOPS = 16
"""Of a jump: from 2^-8 to 2^8, or back."""
ADAPTED = math.ceil(math.log(0.5 / STOPS) / math.log(0.9))
"""Frames after which a measured exposure, a tenth of the way a frame, is within half a stop."""
HELD = 16  # frames between jumps


def exposure_jumps(trial: Trial) -> Measured:
    """Exposure, every 16 frames for four periods; the scene's light stays."""
    disturbed, baseline = trial.pair()
    frames = cycle(still(trial.render, trial.every))
    step_both(disturbed, baseline, same_frames(frames, PERIOD))
    jumping = (
        (replace(frame, exposure=_level(i // HELD)), frame)
        for i, frame in enumerate(islice(frames, 4 * PERIOD))
    )
    during = step_both(disturbed, baseline, jumping)
    return recovery_figure(trial, during, step_both(disturbed, baseline, same_frames(frames, trial.watched)))


def light_jumps(trial: Trial) -> Measured:
    """Light, every 16 frames for four periods; exposure is measured. Against a session that begins then."""
    disturbed, baseline = trial.pair()
    frames = cycle(still(trial.render, trial.every))
    for i, frame in enumerate(islice(frames, 4 * PERIOD)):
        disturbed.step(_lit(frame, _level(i // HELD)))
    bright = _level(0)
    pairs: Iterator[tuple[Frame, Frame]] = (
        (_lit(frame, bright), _lit(frame, bright)) for frame in islice(frames, trial.watched + ADAPTED)
    )
    return recovery_figure(trial, [], step_both(disturbed, baseline, pairs, 1.0 / bright), ADAPTED)


def _level(jump: int) -> float:
    return math.exp2(-STOPS / 2 if jump % 2 else STOPS / 2)


def _lit(frame: Frame, level: float) -> Frame:
    color = np.asarray(frame.color) * np.float32(level)
    return replace(frame, color=color, exposure=None)


SCENARIOS = (
    Scenario("exposure jumps by 16 stops", "difference / frame", exposure_jumps, cpu=160, onnx=160, quick=96),
    Scenario("light jumps by 16 stops", "difference / frame", light_jumps, cpu=160, onnx=160),
)
