"""Comparison of images with those of an undisturbed session, and with those of an earlier loop."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import islice

import numpy as np

from supersampler import Frame
from supersampler.frame import Float32
from supersampler.io.display import decibels, display_transform
from supersampler_bench.stress.scenario import STEP, Figure, Measured, Session, Trial

OUTLIER = 0.1
"""What the worst 0.1 % of values may differ by where a disturbance counts as forgotten."""


@dataclass(frozen=True)
class Difference:
    """Absolute difference of two images after the display transform, [0, 1]: the mean, and at 99.9 %."""

    mean: float
    most: float

    @property
    def invisible(self) -> bool:
        """Whether the difference is too small to see."""
        return self.mean <= STEP and self.most <= OUTLIER


def difference(one: Float32, other: Float32, exposure: float = 1.0) -> Difference:
    """Compare two images."""
    apart = np.abs(display_transform(one, exposure) - display_transform(other, exposure))
    return Difference(float(apart.mean()), float(np.quantile(apart, 0.999)))


def step_both(
    disturbed: Session, baseline: Session, frames: Iterable[tuple[Frame, Frame]], exposure: float = 1.0
) -> list[Difference]:
    """Step two sessions, each with its own frame of the pairs."""
    return [difference(disturbed.step(one), baseline.step(other), exposure) for one, other in frames]


def same_frames(frames: Iterable[Frame], count: int) -> Iterator[tuple[Frame, Frame]]:
    """Return the next `count` frames, for both sessions."""
    return ((frame, frame) for frame in islice(frames, count))


def recovery(after: Sequence[Difference]) -> float:
    """Frames after a disturbance until no difference is visible any more; all if one always is."""
    seen = [index + 1 for index, o in enumerate(after) if not o.invisible]
    return float(seen[-1] if seen else 0)


def recovery_figure(
    trial: Trial, during: Sequence[Difference], after: Sequence[Difference], more: int = 0
) -> Measured:
    """Return how many frames a disturbance was seen for after its end, which the subject bounds."""
    curve = [o.mean for o in (*during, *after)]
    return Measured((Figure("frames until clean", recovery(after), trial.subject.recovery + more),), curve)


@dataclass(frozen=True)
class Repeated:
    """The same frames over and over.

    Attributes:
        changes: mean difference of each loop's images from those of the loop before, from the second on.
        drift: mean difference of the last loop's images from those of the `settled` one.
        psnr: dB, of each loop where truths are known.
        swing: dB, from the worst to the best image of the last loop.
        images: what a screen shows of the last loop.
    """

    changes: list[float]
    mean_abs_difference: float
    psnr: list[float]
    swing: float
    images: Sequence[Float32]

    def lost(self) -> float:
        """PSNR, dB, from the settled loop to the last."""
        return self.psnr[settled(len(self.psnr))] - self.psnr[-1]


def settled(loops: int) -> int:
    """Number of the loop from which on nothing should change: the thirteenth, or the middle one of few."""
    return min(12, loops // 2)


def repeat(trial: Trial, frames: Sequence[Frame], truths: Sequence[Float32] = ()) -> Repeated:
    """Step through the same frames until `trial.frames` are done, in whole loops, at least three."""
    session, loops = trial.begin(), max(trial.frames // len(frames), 3)
    wanted = [display_transform(truth) for truth in truths]
    changes, psnr, swing = [], [], 0.0
    before: list[Float32] = []
    early: list[Float32] = []
    for loop in range(loops):
        images = [display_transform(session.step(frame)) for frame in frames]
        if before:
            changes.append(_mean_apart(images, before))
        if wanted:
            scores = [decibels(float(np.mean((a - b) ** 2))) for a, b in zip(images, wanted, strict=True)]
            psnr.append(float(np.mean(scores)))
            swing = float(np.ptp(scores))
        if loop == settled(loops):
            early = images
        before = images
    return Repeated(changes, _mean_apart(before, early), psnr, swing, before)


def _mean_apart(one: Sequence[Float32], other: Sequence[Float32]) -> float:
    return float(np.mean([np.abs(a - b).mean() for a, b in zip(one, other, strict=True)]))
