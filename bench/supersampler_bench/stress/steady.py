"""Scenarios of many frames, static, moving and in int8: errors that could add up, and how fast they fade."""

from collections.abc import Sequence

import numpy as np

from supersampler import Frame, Upscaler
from supersampler.frame import Float32, Size
from supersampler.io.display import decibels, display_transform
from supersampler_bench.stress.compare import difference, repeat
from supersampler_bench.stress.contraction import EVERY, contraction
from supersampler_bench.stress.scenario import DECAY, REST, STEP, Figure, Measured, Scenario, Trial
from supersampler_bench.stress.scenes import LAP, PERIOD, STILL, Orbit, moving, still, truth

SWING = 1.5
"""dB of PSNR that images of a scene at rest may go up and down by."""
EMA, AVERAGED = 0.1, 4
"""New share of the average that methods are compared with, and loops until it has settled."""
GROWTH = 1.1
"""By how much more two precisions may be apart in the last loop than in the middle one."""
SMALL = 1e-4
"""Root mean square of a disturbance in linear light; all of it may end up in one pixel."""
_UNIT = 1e-7  # rounding of single precision: what is less apart than this is not apart


def at_rest(trial: Trial) -> Measured:
    """A static scene with wires: its image settles, and stays as it was in the thirteenth period."""
    frames, base = still(trial.render, trial.every), truth(STILL, 0, trial.display)
    run = repeat(trial, frames, [base] * len(frames))
    figures = [
        Figure("change in a period", run.changes[-1], REST),
        Figure("mean abs difference", run.mean_abs_difference, REST),
        Figure("PSNR lost, dB", run.lost(), DECAY),
        Figure("PSNR swing in a period, dB", run.swing, SWING),
    ]
    if trial.subject.remembers:
        below = _psnr_of_average(frames, trial.display, display_transform(base)) - run.psnr[-1]
        figures.append(Figure("PSNR below an average, dB", below, DECAY))
    return Measured(tuple(figures), run.changes)


def _psnr_of_average(frames: Sequence[Frame], display: Size, wanted: Float32) -> float:
    """Of an exponential average of frames, over and over, their pixels merely enlarged; of its last loop."""
    (width, height), (w, h) = display, frames[0].size
    rows, columns = np.arange(height)[:, None] * h // height, np.arange(width) * w // width
    singles = [np.asarray(frame.color, np.float32)[rows, columns] for frame in frames]
    average, scores = singles[0], []
    for single in singles * AVERAGED:
        average = (1.0 - EMA) * average + EMA * single
        scores.append(decibels(float(np.mean((display_transform(average) - wanted) ** 2))))
    return float(np.mean(scores[-len(frames) :]))


def flicker(trial: Trial) -> Measured:
    """At rest: deviation over a period of the jitter, as a share of that of single frames upsampled."""
    frames = still(trial.render, trial.every)
    images = repeat(trial, frames).images
    spatial = Upscaler("bilinear", display_size=trial.display, validate="off", threads=1)
    single = [display_transform(spatial.step(frame)) for frame in frames]
    left = _deviation(images) / _deviation(single)
    base = display_transform(truth(STILL, 0, trial.display))
    curve = [float(np.abs(image - base).mean()) for image in images]
    return Measured((Figure("share left", left, passed_by_average(EMA, PERIOD)),), curve)


def passed_by_average(alpha: float, period: int) -> float:
    """Return what an exponential average, `alpha` of it new, lets through of a sine of that period."""
    return float(alpha / abs(1.0 - (1.0 - alpha) * np.exp(-2j * np.pi / period)))


def _deviation(images: Sequence[Float32]) -> float:
    return float(np.sqrt(np.var(np.stack(images), axis=0).mean()))


def in_motion(trial: Trial) -> Measured:
    """A disc circles before a swinging plane, over and over: images repeat as the frames do."""
    frames = moving(trial.render, trial.every)
    run = repeat(trial, frames, [truth(Orbit(), i % LAP, trial.display) for i in range(len(frames))])
    figures = (Figure("change in a loop", run.changes[-1], REST), Figure("PSNR lost, dB", run.lost(), DECAY))
    return Measured(figures, run.changes)


def precisions(trial: Trial) -> Measured:
    """The same moving frames on the ONNX backend in fp32: the difference is small and does not grow."""
    frames = moving(trial.render, trial.every)
    loops = max(trial.frames // len(frames), 3)
    session, exact = trial.begin(), (trial.subject.exact or trial.subject.begin)(trial.display, 1)
    means = [
        float(np.mean([difference(session.step(f), exact.step(f)).mean for f in frames]))
        for _ in range(loops)
    ]
    growth = (means[-1] + _UNIT) / (means[loops // 2] + _UNIT)
    figures = (
        Figure("difference, worst loop", max(means), trial.subject.tolerance),
        Figure("growth", growth, GROWTH),
    )
    return Measured(figures, means)


def contraction_at_rest(trial: Trial) -> Measured:
    """The history is disturbed a little, at rest."""
    return _contraction(trial, still(trial.render, trial.every))


def contraction_in_motion(trial: Trial) -> Measured:
    """The history is disturbed a little, in motion."""
    return _contraction(trial, moving(trial.render, trial.every))


def _contraction(trial: Trial, frames: Sequence[Frame]) -> Measured:
    size = SMALL if trial.subject.precision == "fp32" else 4.0 * STEP
    rounds, begin = trial.frames // EVERY, trial.subject.own or trial.subject.begin
    base, other = (begin(trial.display, 1) for _ in range(2))
    found = contraction(base, other, frames, rounds, size, warm_up=6 * PERIOD * trial.every)
    figures = (Figure("rate a frame", found.rate, 1.0), Figure("rate, worst 16 frames", max(found.last), 1.0))
    return Measured(figures, found.rates)


SCENARIOS = (
    Scenario("at rest", "change / period", at_rest, cpu=10_016, onnx=960, quick=320, remembers=False),
    Scenario("in motion", "change / loop", in_motion, cpu=1920, onnx=640),
    Scenario(
        "against single precision",
        "difference / loop",
        precisions,
        cpu=2080,
        onnx=2080,
        quick=480,
        pairs=True,
    ),
    Scenario(
        "flicker at the jitter's period",
        "error / frame",
        flicker,
        cpu=640,
        onnx=320,
        same_size=True,
        logarithmic=False,
    ),
    Scenario(
        "contraction at rest",
        "rate / 16 frames",
        contraction_at_rest,
        cpu=768,
        onnx=320,
        quick=256,
        same_size=True,
        logarithmic=False,
    ),
    Scenario(
        "contraction in motion",
        "rate / 16 frames",
        contraction_in_motion,
        cpu=640,
        onnx=320,
        same_size=True,
        logarithmic=False,
    ),
)
