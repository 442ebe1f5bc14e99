"""Scenarios of well-formed frames: long runs, jumps of light, odd motion, wrong jitter, saved sessions."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import cycle, islice

import numpy as np

from supersampler import Frame, Upscaler, halton_jitter
from supersampler.frame import Float32, Size
from supersampler.io.display import decibels, display_transform
from supersampler_bench.stress.compare import EVERY, Disturbance, contraction, difference, flicker, repeat
from supersampler_bench.stress.scenario import DECAY, REST, ROUNDING, STEP, Figure, Figures, Trial, scenario
from supersampler_bench.stress.scenes import LAP, PERIOD, STILL, Orbit, scene_frames, truth
from supersampler_model.data.scenes.analytic import Plane, zone_plate

SWING = 1.5
"""PSNR, dB, by which images of a scene at rest may differ."""
EMA, EMA_LOOPS = 0.1, 4
"""Weight of a new frame in the exponential average that methods are compared with; loops until it settles."""
GROWTH = 1.1
"""Largest ratio of the difference between two precisions in the last loop to that in the middle one."""
SMALL = 1e-4
"""RMS of a disturbance, linear RGB; it may all end up in one pixel."""
_UNIT = 1e-7  # rounding of single precision; smaller differences do not count


@scenario("steady", "at rest", cpu=10_016, onnx=960, quick=320, remembers=False)
def at_rest(trial: Trial) -> Figures:
    """A static scene with wires. Its image settles, and stays as it was in the thirteenth period."""
    frames, reference = trial.still, truth(STILL, 0, trial.display)
    run = repeat(trial, frames, [reference] * len(frames))
    figures = [
        Figure("change in a period", run.change, REST),
        Figure("mean abs difference", run.mean_abs_difference, REST),
        Figure("PSNR lost, dB", run.lost, DECAY),
        Figure("PSNR swing in a period, dB", run.swing, SWING),
    ]
    if trial.subject.remembers:
        average = _psnr_of_average(frames, trial.display, display_transform(reference))
        figures.append(Figure("PSNR below an average, dB", average - run.psnr, DECAY))
        spatial = Upscaler("bilinear", display_size=trial.display, validate="off", threads=1)
        share = run.flicker / flicker([display_transform(spatial.step(frame)) for frame in frames])
        figures.append(Figure("flicker, share of bilinear's", share, passed_by_average(EMA, PERIOD)))
    return figures


def passed_by_average(new: float, period: int) -> float:
    """Return the amplitude gain of an exponential average with weight `new` for a sine of a period."""
    return float(new / abs(1.0 - (1.0 - new) * np.exp(-2j * np.pi / period)))


def _psnr_of_average(frames: Sequence[Frame], display: Size, reference: Float32) -> float:
    """Return the mean PSNR of an exponential average of upsampled frames that repeat, in its last loop."""
    (width, height), (w, h) = display, frames[0].size
    rows, columns = np.arange(height)[:, None] * h // height, np.arange(width) * w // width
    singles = [np.asarray(frame.color, np.float32)[rows, columns] for frame in frames]
    average, scores = singles[0], []
    for single in singles * EMA_LOOPS:
        average = (1.0 - EMA) * average + EMA * single
        scores.append(decibels(float(np.mean((display_transform(average) - reference) ** 2))))
    return float(np.mean(scores[-len(frames) :]))


@scenario("steady", "in motion", cpu=1920, onnx=640)
def in_motion(trial: Trial) -> Figures:
    """A disc circles in front of a swinging plane. Images repeat as the frames do."""
    frames = trial.moving
    truths = [truth(Orbit(), index % LAP, trial.display) for index in range(len(frames))]
    return repeat(trial, frames, truths).measured()


@scenario("steady", "against single precision", cpu=2080, onnx=2080, quick=480, pairs=True)
def precisions(trial: Trial) -> Figures:
    """Moving frames, compared with the ONNX backend in fp32. The difference is small and does not grow."""
    frames = trial.moving
    loops = max(trial.frames // len(frames), 3)
    session, exact = trial.begin(), (trial.subject.exact or trial.subject.begin)(trial.display, 1)
    means = [
        float(np.mean([difference(session.step(f), exact.step(f)).mean for f in frames]))
        for _ in range(loops)
    ]
    growth = (means[-1] + _UNIT) / (means[loops // 2] + _UNIT)
    return [
        Figure("difference, worst loop", max(means), trial.subject.tolerance),
        Figure("growth", growth, GROWTH),
    ]


@scenario("steady", "contraction at rest", cpu=768, onnx=320, quick=256, same_size=True)
def contraction_at_rest(trial: Trial) -> Figures:
    """At rest, the history is disturbed slightly."""
    return _contraction(trial, trial.still)


@scenario("steady", "contraction in motion", cpu=640, onnx=320, same_size=True)
def contraction_in_motion(trial: Trial) -> Figures:
    """In motion, the history is disturbed slightly."""
    return _contraction(trial, trial.moving)


def _contraction(trial: Trial, frames: Sequence[Frame]) -> Figures:
    size = SMALL if trial.subject.precision == "fp32" else 4.0 * STEP
    begin, warm_up = trial.subject.own or trial.subject.begin, 6 * PERIOD * trial.subject.every
    base, other = (begin(trial.display, 1) for _ in range(2))
    found = contraction(base, other, frames, trial.frames // EVERY, size, warm_up)
    return [Figure("rate a frame", found.rate, 1.0), Figure("rate, worst 16 frames", max(found.last), 1.0)]


STOPS = 16
"""Stops of a jump of light: from 2^-8 to 2^8, or back."""
ADAPTED = math.ceil(math.log(0.5 / STOPS) / math.log(0.9))
"""Frames after which a measured exposure, which adapts by a tenth per frame, is within half a stop."""
HELD = 16  # frames between jumps


@scenario("light", "exposure jumps by 16 stops", cpu=160, quick=96)
def exposure_jumps(trial: Trial) -> Figures:
    """The exposure jumps every 16 frames for four jitter periods; the scene's light does not change."""
    run = Disturbance(trial, trial.still)
    run.step_same(PERIOD)
    frames = enumerate(islice(run.frames, 4 * PERIOD))
    run.step((replace(frame, exposure=_level(i // HELD)), frame) for i, frame in frames)
    return run.measured()


@scenario("light", "light jumps by 16 stops", cpu=160)
def light_jumps(trial: Trial) -> Figures:
    """Light jumps every 16 frames for four periods; exposure is measured. The baseline is a new session."""
    run = Disturbance(trial, trial.still)
    for i, frame in enumerate(islice(run.frames, 4 * PERIOD)):
        run.disturbed.step(_lit(frame, _level(i // HELD)))
    bright = _level(0)
    lit = [_lit(frame, bright) for frame in islice(run.frames, trial.watched + ADAPTED)]
    return run.measured(run.step(zip(lit, lit, strict=True), 1.0 / bright), ADAPTED)


def _level(jump: int) -> float:
    return math.exp2(-STOPS / 2 if jump % 2 else STOPS / 2)


def _lit(frame: Frame, level: float) -> Frame:
    return replace(frame, color=np.asarray(frame.color) * np.float32(level), exposure=None)


@scenario("travel", "a cut in every frame", cpu=64, onnx=32, quick=16, remembers=False)
def cuts(trial: Trial) -> Figures:
    """Every frame is a cut. Each image equals the first one of a new session."""
    session = trial.begin()
    apart = []
    for frame in islice(cycle(trial.moving), trial.frames):
        image = session.step(replace(frame, reset=True))
        apart.append(float(np.abs(image - trial.begin().step(frame)).max()))
    return [Figure("largest difference", max(apart), 0.0)]


@scenario("travel", "an unannounced scene change", cpu=160)
def jump(trial: Trial) -> Figures:
    """The scene is replaced without a reset or motion."""
    run = Disturbance(trial, trial.still)
    elsewhere = scene_frames(Plane(zone_plate), trial.render, PERIOD, trial.subject.every)
    for frame in (*trial.moving, *elsewhere):
        run.disturbed.step(frame)
    return run.measured()


Jitter = tuple[float, float]
SWEEP = 96  # frames from the smallest ratio to the largest and back
LARGEST_RATIO = 3.0


@scenario("sampling", "jitter missing", cpu=640, onnx=320, quick=128)
def missing(trial: Trial) -> Figures:
    """Frames are jittered, but their `jitter` is (0, 0)."""
    return _wrong_jitter(trial, _with_jitter(trial, lambda _: (0.0, 0.0)))


@scenario("sampling", "jitter negated", cpu=640, onnx=320)
def negated(trial: Trial) -> Figures:
    """The `jitter` of frames has the wrong sign."""
    return _wrong_jitter(trial, _with_jitter(trial, lambda jitter: (-jitter[0], -jitter[1])))


def _with_jitter(trial: Trial, jitter_of: Callable[[Jitter], Jitter]) -> list[Frame]:
    return [replace(frame, jitter=jitter_of(frame.jitter)) for frame in trial.still]


def _wrong_jitter(trial: Trial, frames: Sequence[Frame]) -> Figures:
    """Step these frames in place of the right ones. Images settle nevertheless, and recover."""
    wrong = [replace(frame, reset=False) for frame in frames]
    settles = Figure("change in a period", repeat(trial, wrong).change, REST)
    run = Disturbance(trial, trial.still)
    run.step((bad, next(run.frames)) for bad in wrong * 4)
    after = run.step_same(max(5 * PERIOD, trial.subject.recovery + 8))
    return [settles, *run.measured(after)]


@scenario(
    "sampling",
    "ratios from 1 to 3",
    cpu=1152,
    onnx=576,
    quick=288,
    remembers=False,
    ratios=(1.0, LARGEST_RATIO),
)
def sweep(trial: Trial) -> Figures:
    """The ratio goes from 1 to 3 and back, repeatedly; every frame has another render size."""
    frames = []
    for index in range(SWEEP):
        ratio = 0.5 * (1.0 + LARGEST_RATIO - (LARGEST_RATIO - 1.0) * np.cos(2.0 * np.pi * index / SWEEP))
        size = math.ceil(trial.display[0] / ratio), math.ceil(trial.display[1] / ratio)
        jitter = halton_jitter(index // trial.subject.every, ratio)
        frames.append(replace(STILL.frame(index, size, jitter), reset=False))
    return repeat(trial, frames, [truth(STILL, 0, trial.display)] * SWEEP).measured()


THREADS = (2, 3, 5)


@scenario("sessions", "threads", cpu=96, onnx=32, quick=16, remembers=False)
def threads(trial: Trial) -> Figures:
    """Images with 2, 3 and 5 threads equal those with one, on the ONNX backend up to rounding."""
    frames = list(islice(cycle(trial.moving), trial.frames))
    sessions = [trial.begin(threads=count) for count in (1, *THREADS)]
    one, *others = ([session.step(frame) for frame in frames] for session in sessions)
    largest = max(float(np.abs(np.subtract(one, other)).max()) for other in others)
    return [Figure("difference", largest, 0.0 if trial.subject.executor == "cpu" else ROUNDING)]
