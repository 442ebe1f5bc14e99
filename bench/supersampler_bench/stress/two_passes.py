"""Scenarios of two passes: shots on which the second one could do harm, against one pass."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import chain, cycle, product
from typing import NamedTuple

import numpy as np

from supersampler import Frame
from supersampler.frame import Float32
from supersampler.io.display import display_transform
from supersampler_bench.quality.metrics import psnr
from supersampler_bench.stress.hostile import FIELDS, PLACES, VALUES, places, with_values
from supersampler_bench.stress.recovery import EXPOSURES
from supersampler_bench.stress.scenario import Figure, Measured, Scenario, Trial, bad_values
from supersampler_bench.stress.scenes import STILL, Orbit, frames_of, truth
from supersampler_model.data.scenes import analytic

HARM = 0.05
"""dB of PSNR that a shot may lose by the second pass."""
STATIC: Sequence[analytic.Scene] = (STILL, analytic.Plane(analytic.zone_plate))
SCENES = (STILL, Orbit(), analytic.Plane(analytic.zone_plate, velocity=(0.37, 0.21)))
SPOILED = 24
"""Number of frames of a shot that has one hostile frame."""


class Shot(NamedTuple):
    """Frames from a cut to the next, and the images that they should have."""

    frames: Sequence[Frame]
    truths: Sequence[Float32]


def cuts(trial: Trial) -> Measured:
    """Shots of 12, 3, 8 and 5 frames."""
    return _lost(trial, _shots(trial, (12, 3, 8, 5) * 3))


def single_frames(trial: Trial) -> Measured:
    """Single frames between shots of eight."""
    return _lost(trial, _shots(trial, (8, 1) * 6))


def one_frame(trial: Trial) -> Measured:
    """Shots of one frame each."""
    return _lost(trial, _shots(trial, (1,) * 12))


def two_frames(trial: Trial) -> Measured:
    """Shots of two frames each."""
    return _lost(trial, _shots(trial, (2,) * 12))


def still_shots(trial: Trial) -> Measured:
    """Shots of 8, 40 and 160 frames in which nothing moves."""
    return _lost(trial, _shots(trial, (8, 40, 160) * 2, STATIC))


class _Hostile:
    """Shots of 24 frames: the first, one in the middle or the last is hostile. Exposure is measured."""

    def __init__(self, hostile: Callable[[Frame], Iterable[Frame]]) -> None:
        self._hostile = hostile

    def __call__(self, trial: Trial) -> Measured:
        (shot,) = _shots(trial, (SPOILED,), (Orbit(),))
        frames = [replace(frame, exposure=None) for frame in shot.frames]
        shots = [
            Shot([*frames[:place], bad, *frames[place + 1 :]], shot.truths)
            for place in (0, SPOILED // 2, SPOILED - 1)
            for bad in self._hostile(frames[place])
        ]
        return _lost(trial, shots)


def _shots(trial: Trial, lengths: Sequence[int], scenes: Sequence[analytic.Scene] = SCENES) -> list[Shot]:
    """Return shots of these lengths, of the scenes in turns; frames and jitter go on from shot to shot."""
    shots, first = [], 0
    for length, scene in zip(lengths, cycle(scenes), strict=False):
        stop = first + length
        truths = [truth(scene, 0 if scene in STATIC else i, trial.display) for i in range(first, stop)]
        shots.append(Shot(frames_of(scene, trial.render, stop)[first:], truths))
        first = stop
    return shots


def _lost(trial: Trial, shots: Sequence[Shot]) -> Measured:
    """Upscale shots with cuts between them, in one pass and in two; return what the second pass lost of PSNR.

    PSNR of a shot is the mean of that of its images.
    """
    upscaled = trial.subject.sequences
    assert upscaled is not None  # noqa: S101  # see `Scenario.suits`
    frames = [replace(frame, reset=i == 0) for shot in shots for i, frame in enumerate(shot.frames)]
    images = [list(upscaled(frames, trial.display, passes)) for passes in (1, 2)]
    truths = [display_transform(image) for shot in shots for image in shot.truths]
    stops = np.cumsum([len(shot.frames) for shot in shots])
    one, two = (
        np.array([part.mean() for part in np.split(_scores(each, truths), stops[:-1])]) for each in images
    )
    lost = one - two
    figures = (
        Figure("PSNR lost, mean of shots, dB", float(lost.mean()), HARM),
        Figure("PSNR lost, worst shot, dB", float(lost.max()), HARM),
    )
    return Measured(figures, lost.tolist(), bad_values=sum(map(bad_values, chain(*images))))


def _scores(images: Sequence[Float32], truths: Sequence[Float32]) -> list[float]:
    return [psnr(display_transform(image), truth) for image, truth in zip(images, truths, strict=True)]


def _spoils(values: Sequence[float]) -> Callable[[Frame], Iterator[Frame]]:
    def hostile(frame: Frame) -> Iterator[Frame]:
        for (field, value), kind in product(zip(FIELDS, values, strict=True), PLACES):
            yield with_values(frame, field, places(kind, frame), value)

    return hostile


def _exposures(frame: Frame) -> Iterator[Frame]:
    return (replace(frame, exposure=exposure) for exposure in EXPOSURES)


def _scenario(name: str, run: Callable[[Trial], Measured], frames: int, quick: int = 0) -> Scenario:
    """Return a scenario of so many frames, on any backend."""
    return Scenario(
        name,
        "PSNR lost / shot",
        run,
        cpu=frames,
        onnx=frames,
        quick=quick,
        remembers=False,
        two_passes=True,
        logarithmic=False,
        ratios=None,
    )


SCENARIOS = (
    _scenario("two passes, cuts", cuts, 84),
    _scenario("two passes, single frames", single_frames, 54),
    _scenario("two passes, one frame", one_frame, 12, quick=12),
    _scenario("two passes, two frames", two_frames, 24, quick=24),
    _scenario("two passes, still", still_shots, 416),
    *(
        _scenario(f"two passes, {name}", _Hostile(_spoils(values)), 27 * SPOILED)
        for name, values in VALUES.items()
    ),
    _scenario("two passes, exposure", _Hostile(_exposures), 12 * SPOILED),
)
