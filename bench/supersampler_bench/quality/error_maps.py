"""Error maps: FLIP of each pixel, its mean over the frames, and the frame of largest error."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from supersampler.frame import Float32
from supersampler_bench.quality.measure import ScoredImage
from supersampler_bench.quality.summaries import WARM_UP_FRAMES


@dataclass(frozen=True)
class FrameErrors:
    """Images and errors of one frame, in the order of the methods.

    Attributes:
        frame: its number.
        images: (H, W, 3) each, after the display transform.
        errors: (H, W) each, LDR-FLIP.
    """

    frame: int
    images: list[Float32] = field(default_factory=list)
    errors: list[Float32] = field(default_factory=list)


class ErrorMaps:
    """Callback `watch` of `measure_quality`, which keeps the mean errors and the frame of largest error.

    Warm-up frames count only in shots that have no later ones.

    Args:
        methods: their names.
    """

    def __init__(self, methods: list[str]) -> None:
        self.methods = methods
        self.worst = self._now = FrameErrors(-1)
        self._sums: list[NDArray[np.float64]] = []
        self._count, self._largest, self._warm = 0, -1.0, False

    def __call__(self, seen: ScoredImage) -> None:
        """Take one image; those of a frame follow one another in the order of the methods."""
        if seen.method == 0:
            self._now = FrameErrors(seen.frame)
        self._now.images.append(seen.shown)
        self._now.errors.append(seen.flip)
        if len(self._now.errors) == len(self.methods):
            self._take(self._now)

    @property
    def means(self) -> list[Float32]:
        """(H, W) each, the mean over the frames, by method."""
        return [np.asarray(total / self._count, np.float32) for total in self._sums]

    def _take(self, now: FrameErrors) -> None:
        if now.frame >= WARM_UP_FRAMES and not self._warm:
            self._sums, self._count, self._largest, self._warm = [], 0, -1.0, True
        sums = self._sums or [np.zeros(error.shape) for error in now.errors]
        self._sums = [total + error for total, error in zip(sums, now.errors, strict=True)]
        self._count += 1
        size = float(np.mean([error.mean() for error in now.errors]))
        if size > self._largest:
            self._largest, self.worst = size, now
