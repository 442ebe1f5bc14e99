"""Scores of a method: of each frame, and their summary over a shot and over several shots."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from supersampler.io.display import decibels
from supersampler_bench.quality.confusion import Counts

Scores = dict[str, float]
"""By the metric's name, as `pixels_...` how many a masked PSNR saw, and `srred` and `trred`, whose product is
STRRED. NaN where there was nothing."""

WARM_UP_FRAMES = 8
BORDER = 8  # display pixels
MASKED = ("disoccluded", "changing_light", "aliased", "moving")
FRAME_METRICS = (
    "psnr",
    "ssim",
    "flip",
    "tpsnr",
    "warped_error_difference",
    "strred",
    *(f"psnr_{mask}" for mask in MASKED),
)


class Summarized(Protocol):
    """Summary of one method, as tables show it."""

    @property
    def method(self) -> str:
        """Its name."""

    def summary(self, *, warm: bool = True, cropped: bool = True) -> Scores:
        """Return each metric; NaN where it is not known. See `MethodScores.summary`."""

    def classes(self, *, warm: bool = True, cropped: bool = True) -> Counts | None:
        """Return the class counts of all pixels; None where classes are unknown."""


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
        with three such pixels does not weigh as one with three thousand. STRRED is the mean SRRED times the
        mean TRRED.

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


@dataclass(frozen=True)
class MeanScores:
    """One method's scores of several shots, equally weighted."""

    method: str
    shots: Sequence[Summarized]

    def summary(self, *, warm: bool = True, cropped: bool = True) -> Scores:
        """Return the mean of the shots' summaries that have a metric; NaN where none has."""
        found = [shot.summary(warm=warm, cropped=cropped) for shot in self.shots]
        columns = {name: [s[name] for s in found if not np.isnan(s[name])] for name in found[0]}
        return {name: float(np.mean(values)) if values else float("nan") for name, values in columns.items()}

    def classes(self, *, warm: bool = True, cropped: bool = True) -> Counts | None:
        """Return the class counts of all shots; None where classes are unknown."""
        known = [c for shot in self.shots if (c := shot.classes(warm=warm, cropped=cropped)) is not None]
        return np.sum(known, axis=0) if known else None


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
