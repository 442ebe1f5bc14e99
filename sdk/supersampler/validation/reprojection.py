"""Reprojection error between two frames, for given conventions of motion and jitter.

The error is the mean squared difference of tone-mapped luminance between a pixel and its place in the
previous image, at a few thousand places. It is squared: at aliased edges most pixels stay equal, and a median
or mean absolute difference would hardly depend on the motion there. Both images are read through the same
small filter, as otherwise the blur of wrong motion could give the smaller error.
"""

from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from numpy.typing import NDArray

from supersampler.conventions import Conventions
from supersampler.errors import FrameError
from supersampler.frame import Float32
from supersampler.validation.depth_order import DepthOrder, disoccluded
from supersampler.validation.evidence import PLACES, Evidence, Places, grid
from supersampler.validation.movement import image_moves

MIN_PLACES = 1000
"""Minimum number of textured places for significant errors."""

_TEXTURE = 0.01  # minimum change of the tone-mapped luminance between neighbours


class FramePair:
    """Two neighbouring frames of one size, both shaded, compared at some places.

    Attributes:
        before, now: the frames.
        places: rows and columns (n,) of the compared pixels.
        tone, tone_before: tone-mapped luminance, padded by one pixel.
        textured: whether at least MIN_PLACES of them differ from their neighbours.
    """

    def __init__(self, before: Evidence, now: Evidence) -> None:
        self.before, self.now = before, now
        if now.light is None or before.light is None:
            raise FrameError("color", got=None, want="shaded frames")
        self.places = rows, columns = grid((now.light.shape[1], now.light.shape[0]), PLACES)
        known = now.light[rows, columns]
        known = known[np.isfinite(known) & (known > 0)]
        middle = float(np.median(known)) if known.size else 1.0
        self.tone, self.tone_before = _tone(now.light, middle), _tone(before.light, middle)
        tone = self.tone
        here = _read(tone, columns, rows)
        right, below = _read(tone, columns + 1, rows), _read(tone, columns, rows + 1)
        change = np.maximum(np.abs(right - here), np.abs(below - here))
        self._tone_now = here
        self.textured = int((change > _TEXTURE).sum()) >= MIN_PLACES  # NaN compares False

    def error(self, offset: NDArray[np.floating[Any]], where: NDArray[np.bool_] | None = None) -> float:
        """Return the mean squared difference, in [0, 1]; inf where less than half is on screen.

        Args:
            offset: (n, 2) or (2,) pixels from each place to its place in the previous frame.
            where: (n,) mask of the places to compare, at least one; by default all.
        """
        rows, columns = self.places
        offset = np.broadcast_to(offset, (len(rows), 2))
        use = slice(None) if where is None else where
        before = _read(self.tone_before, columns[use] + offset[use, 0], rows[use] + offset[use, 1])
        difference = before - self._tone_now[use]
        difference = difference[np.isfinite(difference)]
        return float(np.mean(difference**2)) if 2 * len(difference) > len(before) else float("inf")

    def shift(self, conventions: Conventions) -> NDArray[np.float64]:
        """Return the change of the jitter, (x, y) pixels: the image offset beside unjittered motion."""
        return self.now.jitter_pixels(conventions) - self.before.jitter_pixels(conventions)

    def offset(
        self,
        conventions: Conventions,
        places: Places | None = None,
        *,
        motion_swapped: bool = False,
        jitter_swapped: bool = False,
    ) -> NDArray[np.float64]:
        """Return (n, 2) pixels from each place to its place in the previous frame.

        Args:
            conventions: conventions of motion and jitter.
            places: rows and columns; None: the compared ones.
            motion_swapped: exchange x and y of motion.
            jitter_swapped: exchange x and y of jitter.
        """
        places = self.places if places is None else places
        offset = self.now.vectors(conventions, places, swapped=motion_swapped).astype(np.float64)
        if conventions.motion_jittered:
            return offset
        shift = self.shift(conventions)
        return offset + (shift[::-1] if jitter_swapped else shift)

    @property
    def lacks_motion(self) -> bool:
        """Whether the motion is 0 everywhere, though most of the image moves."""
        inner = slice(1, -1), slice(1, -1)
        return not self.now.motion.any() and image_moves(self.tone[inner], self.tone_before[inner])

    @property
    def variance(self) -> float:
        """Variance of the tone-mapped luminance; the error between unrelated images is twice as much."""
        return float(np.nanvar(self._tone_now))

    @property
    def continues(self) -> bool:
        """Whether the image is the previous one moved, rather than another."""
        return self.textured and self.error(self.offset(Conventions())) < 0.5 * self.variance

    def moving(self, conventions: Conventions) -> NDArray[np.bool_]:
        """Return the (n,) mask of places that move by at least a tenth of the longest vectors."""
        length = np.abs(self.now.vectors(conventions, self.places)).max(axis=1)
        length = np.where(np.isfinite(length), length, 0)
        moves: NDArray[np.bool_] = (length > 0) & (length >= 0.1 * np.percentile(length, 99))
        return moves

    def disoccluded(self, order: DepthOrder, conventions: Conventions, places: int) -> tuple[int, int]:
        """Count disoccluded places with (closer, farther) occluders, on a grid of about `places` pixels."""
        sampled = grid(self.now.size, places)
        offset = self.offset(conventions, sampled)
        return disoccluded(self.now.depth, self.before.depth, order, sampled, offset)


def frame_pairs(frames: Sequence[Evidence]) -> list[FramePair]:
    """Return the pairs of neighbours without a cut between, both shaded and of one size."""
    return [
        FramePair(before, now)
        for before, now in pairwise(frames)
        if not now.reset and now.size == before.size and now.light is not None and before.light is not None
    ]


def _tone(image: Float32, middle: float) -> Float32:
    """Return luminance tone-mapped to [0, 1], padded by one pixel; NaN where it is not finite."""
    tone = np.maximum(image, 0)
    with np.errstate(invalid="ignore"):  # Inf / Inf is NaN, which is skipped
        tone /= tone + np.float32(middle)
    return np.pad(tone, 1, mode="edge")


def _read(padded: Float32, x: NDArray[Any], y: NDArray[Any]) -> NDArray[np.floating[Any]]:
    """Sample a result of `_tone` at (x, y) with a quadratic B-spline of 3 x 3 pixels; NaN outside."""
    height, width = padded.shape[0] - 2, padded.shape[1] - 2
    inside = (x > -0.5) & (x < width - 0.5) & (y > -0.5) & (y < height - 0.5)  # False where NaN
    x, y = np.where(inside, x, 0.0), np.where(inside, y, 0.0)
    column, row = np.rint(x).astype(np.intp), np.rint(y).astype(np.intp)
    values, corner = padded.ravel(), row * (width + 2) + column
    weights_x, weights_y = _spline(x - column), _spline(y - row)
    total = np.zeros(x.shape)
    for dy, weight_y in enumerate(weights_y):
        line = sum(
            weight_x * values[corner + (dy * (width + 2) + dx)] for dx, weight_x in enumerate(weights_x)
        )
        total += weight_y * line
    return np.where(inside, total, np.nan)


def _spline(fraction: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
    return 0.5 * (0.5 - fraction) ** 2, 0.75 - fraction**2, 0.5 * (0.5 + fraction) ** 2
