"""Estimate the jitter in the images, as a fraction of the stated one."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from supersampler.conventions import Conventions
from supersampler.validation.reprojection import FramePair

FACTORS: tuple[tuple[float, float], ...] = tuple(
    (x, y) for x in (0.0, 0.5, 1.0, 1.5) for y in (0.0, 0.5, 1.0, 1.5)
)
"""Factors of the jitter's x and y that are tried."""

AmplitudeErrors = Mapping[tuple[float, float], tuple[float, ...]]
JitterInVectors = tuple[float, float]
"""Sums over frames: the change of motion along the jitter's change, and the jitter's change, squared."""

_MIN_PAIRS = 2
_MIN_GAIN = 0.04  # of the error: that of the best factors is lower by it
_MIN_GAIN_OF_AN_AXIS = 0.08  # where the other axis is right; 0.06 of correct frames
_RIGHT = 0.15  # off by less than this, an axis is right
_MAX_ERROR = 0.7  # of the variance: a frame that continues the previous one
_NOISE = 1e-5  # squares of tone-mapped luminance; smaller errors are noise
_PLAUSIBLE = (0.65, 1.5)  # either axis; correct frames were estimated at 0.71 to 1.34
_PLAUSIBLE_MEAN = (0.75, 1.4)  # of both; 0.82 to 1.25


@dataclass(frozen=True, slots=True)
class Amplitude:
    """Estimated factors of the jitter's x and y; `none` where the image has no jitter at all."""

    x: float
    y: float
    none: bool

    @property
    def is_small(self) -> bool:
        """Whether the image follows the motion alone better than with all of the jitter added."""
        return self.none or (self.x + self.y) / 2 < 0.5

    @property
    def text(self) -> str:
        """The factors as text: "0.50", or "0.70 (0.50 in x, 0.90 in y)"."""
        mean = f"{(self.x + self.y) / 2:.2f}"
        return mean if abs(self.x - self.y) < 0.25 else f"{mean} ({self.x:.2f} in x, {self.y:.2f} in y)"


def amplitude_errors(pair: FramePair, reading: Conventions) -> dict[tuple[float, float], tuple[float, ...]]:
    """Return the reprojection error of a pair of frames with each of FACTORS, and the image's variance."""
    vectors, shift = pair.now.vectors(reading, pair.places), pair.shift(reading)
    variance = pair.variance
    return {factors: (min(pair.error(vectors + shift * factors), 1.0), variance) for factors in FACTORS}


def jitter_in_vectors(
    sums: JitterInVectors, pair: FramePair, jitters: Sequence[tuple[float, float]], reading: Conventions
) -> JitterInVectors:
    """Return the sums with one more pair added; `jitters` are those of the frames before its second one."""
    now, before = pair.now, pair.before
    if len(jitters) < 2 or before.motion.shape != now.motion.shape:
        return sums
    earlier = replace(before, jitter=jitters[-2]).jitter_pixels(reading)
    change = pair.shift(reading) - (before.jitter_pixels(reading) - earlier)
    moved = np.median(now.vectors(reading, pair.places) - before.vectors(reading, pair.places), axis=0)
    return sums[0] + float(moved @ change), sums[1] + float(change @ change)


def vectors_have_jitter(sums: JitterInVectors) -> bool:
    """Return whether motion changes with the jitter, by about as much."""
    return sums[1] > 0 and 0.5 < sums[0] / sums[1] < 2.0


def wrong_amplitude(errors: AmplitudeErrors, pairs: int) -> Amplitude | None:
    """Return the amplitude where it is clearly not 1, from errors summed over pairs of frames; else None.

    The error is nearly a quadratic function of the factors, whose minimum is the estimate.
    """
    if pairs < _MIN_PAIRS or not errors:
        return None
    x, y = np.array(list(errors)).T
    values, (variance, *_) = np.array(list(errors.values())).T
    c = np.linalg.lstsq(np.stack([x * x, x * y, y * y, x, y, np.ones_like(x)], axis=1), values, rcond=None)[0]
    bend: NDArray[np.float64] = np.array([[2 * c[0], c[1]], [c[1], 2 * c[2]]])
    stated = errors[1.0, 1.0][0]
    if np.linalg.eigvalsh(bend)[0] <= 0 or stated <= _NOISE * pairs:
        return None
    found = np.linalg.solve(bend, -c[3:5])
    lowest, one_axis = values.min(), np.abs(found - 1.0).min() < _RIGHT
    gain = _MIN_GAIN_OF_AN_AXIS if one_axis else _MIN_GAIN
    if lowest > min((1 - gain) * stated, _MAX_ERROR * variance):
        return None
    none = errors[0.0, 0.0][0] == lowest
    if not none and (found.min() < -0.25 or found.max() > 3.0):
        return None
    off = (found < _PLAUSIBLE[0]) | (found > _PLAUSIBLE[1])
    if off.any() or not _PLAUSIBLE_MEAN[0] <= found.mean() <= _PLAUSIBLE_MEAN[1]:
        return Amplitude(float(found[0]), float(found[1]), none)
    return None
