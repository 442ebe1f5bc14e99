"""Scores of a method on the frames of a shot, and their summary."""

from dataclasses import dataclass

import numpy as np

from supersampler.io.display import decibels
from supersampler_bench.quality.confusion import Counts

Scores = dict[str, float]
"""By the metric's name; also `pixels_...`, the pixels of a masked PSNR, and `srred` and `trred`, whose
product is STRRED. NaN where there is nothing to measure."""

WARM_UP_FRAMES = 8
BORDER = 8  # display pixels
MASKED = ("disoccluded", "changing_light", "aliased", "thin", "moving")
FRAME_METRICS = (
    *("psnr", "ssim", "flip", "tpsnr", "warped_error_difference", "strred"),
    *(f"psnr_{mask}" for mask in MASKED),
)


@dataclass(frozen=True)
class FrameScores:
    """One method's scores of one frame, for the whole image and without a border of `BORDER` pixels.

    Class counts are None for a method or a shot without classes.
    """

    frame: int
    full: Scores
    cropped: Scores
    full_classes: Counts | None = None
    cropped_classes: Counts | None = None


@dataclass(frozen=True)
class MethodScores:
    """One method's scores of a shot, over the frames that have a reference.

    Attributes:
        method: its name.
        frames: in order.
    """

    method: str
    frames: list[FrameScores]

    def summary(self, *, warm: bool = True, cropped: bool = True) -> Scores:
        """Return the mean of each metric over the frames that have it; NaN where none does.

        PSNR in a mask is that of the mean squared error over all its pixels of all frames, so that a frame
        weighs by its number of such pixels. STRRED is the mean SRRED times the mean TRRED.

        Args:
            warm: leave out the first `WARM_UP_FRAMES` of the shot.
            cropped: leave out the border.
        """
        scores = [f.cropped if cropped else f.full for f in self._counted(warm)]
        return {name: _pooled(name, scores) for name in FRAME_METRICS}

    def classes(self, *, warm: bool = True, cropped: bool = True) -> Counts | None:
        """Return the class counts of the pixels that `summary` counts; None where classes are unknown."""
        counts = [f.cropped_classes if cropped else f.full_classes for f in self._counted(warm)]
        known = [c for c in counts if c is not None]
        return np.sum(known, axis=0) if known else None

    def _counted(self, warm: bool) -> list[FrameScores]:
        return [f for f in self.frames if f.frame >= WARM_UP_FRAMES or not warm]


def _pooled(name: str, scores: list[Scores]) -> float:
    if name == "strred":
        return _mean("srred", scores) * _mean("trred", scores)
    if name.removeprefix("psnr_") not in MASKED:
        return _mean(name, scores)
    values = np.array([s[name] for s in scores])
    known = ~np.isnan(values)
    if not known.any():
        return float("nan")
    pixels = np.array([s[name.replace("psnr", "pixels")] for s in scores])
    squared_errors = 10.0 ** (-values[known] / 10.0)
    return decibels(float(np.average(squared_errors, weights=pixels[known])))


def _mean(name: str, scores: list[Scores]) -> float:
    known = [s[name] for s in scores if not np.isnan(s[name])]
    return float(np.mean(known)) if known else float("nan")
