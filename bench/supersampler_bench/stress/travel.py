"""Scenarios of motion and depth: cuts, jumps, vectors that lead nowhere or between pixels, lost frames."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import cycle, islice

import numpy as np

from supersampler import Frame
from supersampler.frame import Float32, Size
from supersampler_bench.stress.compare import alike, forgotten, looped, off, side_by_side
from supersampler_bench.stress.scenario import (
    DECAY,
    REST,
    Figure,
    Measured,
    Scenario,
    Session,
    Trial,
)
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
    """Every frame is a cut: each picture is what a new session draws."""
    session = trial.begin()
    curve = []
    for frame in islice(cycle(moving(trial.render)), trial.frames):
        image = session.step(replace(frame, reset=True))
        curve.append(float(np.abs(image - trial.begin().step(frame)).max()))
    return Measured((Figure("apart, bit for bit", max(curve), 0.0),), curve)


def far_vectors(trial: Trial) -> Measured:
    """Motion leads far off screen, where there is no past: each picture is what a new session draws."""
    worst: dict[float, float] = {}
    curve: list[float] = []
    for length in TOO_FAR:
        session, found = trial.begin(), []
        for frame in islice(cycle(moving(trial.render)), trial.frames // len(TOO_FAR)):
            away = replace(frame, motion=np.full_like(frame.motion, length))
            found.append(off(session.step(away), trial.begin().step(away)).mean)
        worst[length], curve = max(found), curve + found
    figures = (
        Figure(f"apart, by {length:g}", most, trial.subject.tolerance) for length, most in worst.items()
    )
    return Measured(tuple(figures), curve)


def jump(trial: Trial) -> Measured:
    """The scene is another one at once, and nothing tells: no reset, no motion."""
    stressed, calm = trial.begin(), trial.begin()
    for frame in (*moving(trial.render), *_elsewhere(trial.render)):
        stressed.step(frame)
    after = side_by_side(stressed, calm, alike(cycle(still(trial.render)), trial.watched))
    return forgotten(trial, [], after)


def _elsewhere(render: Size) -> Sequence[Frame]:
    return frames_of(Plane(zone_plate), render, PERIOD)


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
        frames = frames_of(scene, trial.render, 2 * SWAY)
        run = looped(trial, frames, [scene.truth(i, trial.display, 4) for i in range(2 * SWAY)])
        figures = (
            Figure("change in a loop", run.changes[-1], REST),
            Figure("PSNR lost, dB", run.lost(), DECAY),
        )
        return Measured(figures, run.changes)


def extreme_depth(trial: Trial) -> Measured:
    """Depth is all sky, all infinitely near, one after the other, or anything between, frame by frame."""
    stressed, calm = trial.begin(), trial.begin()
    frames, random = cycle(still(trial.render)), np.random.default_rng(2)
    side_by_side(stressed, calm, alike(frames, PERIOD))
    during = []
    for i, frame in enumerate(islice(frames, 2 * PERIOD)):
        depths = (0.0, 1e30, 10.0 ** random.uniform(-37.0, 37.0, frame.depth.shape))
        depth = np.broadcast_to(depths[i % 3], frame.depth.shape).astype(np.float32)
        during += side_by_side(stressed, calm, [(replace(frame, depth=depth), frame)])
    return forgotten(trial, during, side_by_side(stressed, calm, alike(frames, trial.watched)))


def lost_frames(trial: Trial) -> Measured:
    """Every eighth frame is lost, so that motion is too short after it; every eighth is handed in twice."""
    stressed, calm = trial.begin(), trial.begin()
    frames = cycle(moving(trial.render))
    during = [off(*_with_losses(stressed, calm, f, i)) for i, f in enumerate(islice(frames, 4 * PERIOD))]
    return forgotten(trial, during, side_by_side(stressed, calm, alike(frames, trial.watched)))


def _with_losses(stressed: Session, calm: Session, frame: Frame, index: int) -> tuple[Float32, Float32]:
    expected = calm.step(frame)
    if index % 8 == 3:
        return expected, expected  # nothing is drawn
    image = stressed.step(frame)
    return (stressed.step(frame) if index % 8 == 7 else image), expected


SCENARIOS = (
    Scenario("a cut in every frame", "apart / frame", cuts, host=64, graph=32, quick=16, remembers=False),
    Scenario("motion far off screen", "apart / frame", far_vectors, host=96, graph=48, quick=12),
    Scenario("a jump that nothing tells of", "apart / frame", jump, host=160, graph=160),
    Scenario("motion by half a pixel", "change / loop", _Between(0.5), host=1024, graph=512),
    Scenario("motion by a quarter", "change / loop", _Between(0.25), host=1024, graph=512),
    Scenario("extreme depth", "apart / frame", extreme_depth, host=160, graph=160),
    Scenario("frames lost and repeated", "apart / frame", lost_frames, host=96, graph=96, quick=56),
)
