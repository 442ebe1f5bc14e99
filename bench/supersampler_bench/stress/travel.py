"""Scenarios of motion and depth: cuts, jumps, off-screen and subpixel motion, lost frames."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import cycle, islice

import numpy as np

from supersampler import Frame
from supersampler.frame import Float32, Size
from supersampler_bench.stress.compare import difference, recovery_figure, repeat, same_frames, step_both
from supersampler_bench.stress.scenario import DECAY, REST, Figure, Measured, Scenario, Session, Trial
from supersampler_bench.stress.scenes import PERIOD, frames_of, moving, still
from supersampler_model.data.scenes.analytic import (
    EXTENT,
    FAR,
    Plane,
    Scene,
    Surface,
    Values,
    checker,
    facing,
    zone_plate,
)

TOO_FAR = (1e3, -65504.0, 1e9)
"""Render pixels."""
SWAY = PERIOD  # frames in one direction


def cuts(trial: Trial) -> Measured:
    """Every frame is a cut: each image is that of a new session."""
    session = trial.begin()
    curve = []
    for frame in islice(cycle(moving(trial.render, trial.every)), trial.frames):
        image = session.step(replace(frame, reset=True))
        curve.append(float(np.abs(image - trial.begin().step(frame)).max()))
    return Measured((Figure("largest difference", max(curve), 0.0),), curve)


def far_vectors(trial: Trial) -> Measured:
    """Motion leads far off screen, where there is no history: each image is that of a new session."""
    worst: dict[float, float] = {}
    curve: list[float] = []
    for length in TOO_FAR:
        session, found = trial.begin(), []
        for frame in islice(cycle(moving(trial.render, trial.every)), trial.frames // len(TOO_FAR)):
            away = replace(frame, motion=np.full_like(frame.motion, length))
            found.append(difference(session.step(away), trial.begin().step(away)).mean)
        worst[length], curve = max(found), curve + found
    figures = (
        Figure(f"difference, by {length:g}", most, trial.subject.tolerance) for length, most in worst.items()
    )
    return Measured(tuple(figures), curve)


def jump(trial: Trial) -> Measured:
    """The scene is replaced without a reset or motion."""
    disturbed, baseline = trial.pair()
    for frame in (*moving(trial.render, trial.every), *_elsewhere(trial.render, trial.every)):
        disturbed.step(frame)
    frames = cycle(still(trial.render, trial.every))
    after = step_both(disturbed, baseline, same_frames(frames, trial.watched))
    return recovery_figure(trial, [], after)


def _elsewhere(render: Size, every: int) -> Sequence[Frame]:
    return frames_of(Plane(zone_plate), render, PERIOD, every)


@dataclass(frozen=True)
class Sway(Scene):
    """A plane that goes by `step` units a frame, `SWAY` frames there and `SWAY` back."""

    step: tuple[float, float]

    def surface(self, index: int, x: Values, y: Values) -> Surface:
        """Return the plane, moved."""
        now, before = self._at(index), self._at(index - 1)
        depth = np.full(x.shape, FAR)
        motion = np.broadcast_to(before - now, (*x.shape, 2))
        return Surface(checker(x - now[0], y - now[1]), depth, motion, depth, facing(x, y), facing(x, y))

    def _at(self, index: int) -> Values:
        phase = index % (2 * SWAY)
        return min(phase, 2 * SWAY - phase) * np.array(self.step)


class _Between:
    """Everything moves by exactly so many render pixels a frame, there and back."""

    def __init__(self, pixels: float) -> None:
        self._pixels = pixels

    def __call__(self, trial: Trial) -> Measured:
        step = self._pixels * EXTENT[0] / trial.render[0], self._pixels * EXTENT[1] / trial.render[1]
        scene = Sway(step)
        frames = frames_of(scene, trial.render, 2 * SWAY, trial.every)
        run = repeat(trial, frames, [scene.truth(i, trial.display, 4) for i in range(2 * SWAY)])
        figures = (
            Figure("change in a loop", run.changes[-1], REST),
            Figure("PSNR lost, dB", run.lost(), DECAY),
        )
        return Measured(figures, run.changes)


def extreme_depth(trial: Trial) -> Measured:
    """Depth is all sky, all infinitely near, one after the other, or anything between, frame by frame."""
    disturbed, baseline = trial.pair()
    frames, random = cycle(still(trial.render, trial.every)), np.random.default_rng(2)
    step_both(disturbed, baseline, same_frames(frames, PERIOD))
    during = []
    for i, frame in enumerate(islice(frames, 2 * PERIOD)):
        depths = (0.0, 1e30, 10.0 ** random.uniform(-37.0, 37.0, frame.depth.shape))
        depth = np.broadcast_to(depths[i % 3], frame.depth.shape).astype(np.float32)
        during += step_both(disturbed, baseline, [(replace(frame, depth=depth), frame)])
    return recovery_figure(trial, during, step_both(disturbed, baseline, same_frames(frames, trial.watched)))


def lost_frames(trial: Trial) -> Measured:
    """Every eighth frame is lost, so that motion is too short after it; every eighth is handed in twice."""
    disturbed, baseline = trial.pair()
    frames = cycle(moving(trial.render, trial.every))
    during = [
        difference(*_with_losses(disturbed, baseline, f, i)) for i, f in enumerate(islice(frames, 4 * PERIOD))
    ]
    return recovery_figure(trial, during, step_both(disturbed, baseline, same_frames(frames, trial.watched)))


def _with_losses(disturbed: Session, baseline: Session, frame: Frame, index: int) -> tuple[Float32, Float32]:
    expected = baseline.step(frame)
    if index % 8 == 3:
        return expected, expected  # no step
    image = disturbed.step(frame)
    return (disturbed.step(frame) if index % 8 == 7 else image), expected


SCENARIOS = (
    Scenario("a cut in every frame", "difference / frame", cuts, cpu=64, onnx=32, quick=16, remembers=False),
    Scenario("motion far off screen", "difference / frame", far_vectors, cpu=96, onnx=48, quick=12),
    Scenario("an unannounced scene change", "difference / frame", jump, cpu=160, onnx=160),
    Scenario("motion by half a pixel", "change / loop", _Between(0.5), cpu=1024, onnx=512),
    Scenario("motion by a quarter", "change / loop", _Between(0.25), cpu=1024, onnx=512),
    Scenario("extreme depth", "difference / frame", extreme_depth, cpu=160, onnx=160),
    Scenario("frames lost and repeated", "difference / frame", lost_frames, cpu=96, onnx=96, quick=56),
)
