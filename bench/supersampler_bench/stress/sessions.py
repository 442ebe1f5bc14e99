"""Scenarios of sessions: number of threads, several at once, saved and restored states."""

import pickle
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from itertools import cycle, islice

import numpy as np

from supersampler import Frame
from supersampler.frame import Float32
from supersampler_bench.stress.scenario import ROUNDING, Figure, Measured, Scenario, Session, Trial
from supersampler_bench.stress.scenes import moving, real

THREADS = (2, 3, 5)


def threads(trial: Trial) -> Measured:
    """One thread, two, three, five: no bit changes on the CPU backend, rounding alone on the ONNX backend."""
    frames = _frames(moving(trial.render, trial.every), trial.frames)
    expected = _images(trial.begin(), frames)
    curve = [_largest_difference(expected, _images(trial.begin(threads=count), frames)) for count in THREADS]
    bound = 0.0 if trial.subject.executor == "cpu" else ROUNDING
    return Measured((Figure("difference", max(curve), bound),), curve)


def interleaved(trial: Trial) -> Measured:
    """Two sessions of one model, step by step in turns, then on two threads: both are as if alone."""
    inputs = [_frames(f, trial.frames) for f in (moving(trial.render, trial.every), real(trial.render))]
    expected = [_images(trial.begin(), frames) for frames in inputs]
    one, other = trial.begin(), trial.begin()
    turns = [(one.step(a), other.step(b)) for a, b in zip(*inputs, strict=True)]
    with ThreadPoolExecutor(2) as pool:
        at_once = list(pool.map(_images, [trial.begin(), trial.begin()], inputs))
    in_turns = [[a for a, _ in turns], [b for _, b in turns]]
    curve = [
        _largest_difference(alone, images)
        for way in (in_turns, at_once)
        for alone, images in zip(expected, way, strict=True)
    ]
    return Measured((Figure("largest difference", max(curve), 0.0),), curve)


def restored(trial: Trial) -> Measured:
    """State is saved half-way: another session that loads it, and the same one later, go on bit for bit."""
    frames, half = _frames(moving(trial.render, trial.every), trial.frames), trial.frames // 2
    session, other = trial.begin(), trial.begin()
    _images(session, frames[:half])
    state = pickle.dumps(session.save_state())
    expected = _images(session, frames[half:])
    curve = []
    for one in (other, session):
        one.load_state(pickle.loads(state))  # noqa: S301  # our own bytes
        curve.append(_largest_difference(expected, _images(one, frames[half:])))
    return Measured((Figure("largest difference", max(curve), 0.0),), curve)


def _frames(frames: Sequence[Frame], count: int) -> list[Frame]:
    return list(islice(cycle(frames), count))


def _images(session: Session, frames: Sequence[Frame]) -> list[Float32]:
    return [session.step(frame) for frame in frames]


def _largest_difference(expected: Sequence[Float32], images: Sequence[Float32]) -> float:
    return max(float(np.abs(a - b).max()) for a, b in zip(expected, images, strict=True))


SCENARIOS = (
    Scenario("threads", "difference / number", threads, cpu=96, onnx=32, quick=16, remembers=False),
    Scenario("two at once", "difference / way", interleaved, cpu=96, onnx=32, quick=16, remembers=False),
    Scenario(
        "saved and restored", "difference / session", restored, cpu=96, onnx=64, quick=32, remembers=False
    ),
)
