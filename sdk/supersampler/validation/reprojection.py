"""Reprojection error between two frames, for given conventions of motion and jitter.

The error is the mean squared difference of tone-mapped luminance between a pixel and its place in the
previous image, at a few thousand pixels. At aliased edges most pixels do not change, so that a median or a
mean absolute difference would hardly depend on the motion there. Both images are sampled with the same small
filter; otherwise the blur of wrong motion could give the smaller error.
"""

from collections.abc import Sequence
from itertools import pairwise, product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from supersampler.conventions import Conventions
from supersampler.errors import FrameError
from supersampler.frame import Float32
from supersampler.validation import probe

MIN_TEXTURED = 1000
"""Minimum number of textured pixels for significant errors."""

_ROUNDING = 1e-7  # of the larger side: shorter vectors are rounding errors of a projection
_TEXTURE = 0.01  # minimum difference of tone-mapped luminance between neighbours
# Motion of the image without motion vectors: tiles of the image are searched in the previous image.
_TILES = 5  # along each axis
_TILE_SIDES = (64, 32)  # pixels; the first one that fits is used
_MIN_MOVE = 2  # pixels; shorter shifts may come from the jitter
_MAX_RATIO = 0.7  # maximum ratio of the errors with and without the shift
_MIN_CONTRAST = 1e-3  # minimum variance of tone-mapped luminance in a tile
_MIN_TILES = 3


class FramePair:
    """Two consecutive shaded frames of the same size, compared at some pixels.

    Attributes:
        before, now: the frames.
        pixels: the compared pixels.
        textured: whether at least MIN_TEXTURED of these pixels differ from their neighbours.
    """

    def __init__(self, before: probe.FrameProbe, now: probe.FrameProbe) -> None:
        self.before, self.now = before, now
        if now.light is None or before.light is None:
            raise FrameError("color", got=None, want="shaded frames")
        self.pixels = rows, columns = probe.pixel_grid((now.light.shape[1], now.light.shape[0]))
        self._tone, self._tone_before = (
            np.pad(probe.tone_mapped(light, now.light), 1, mode="edge") for light in (now.light, before.light)
        )
        self._here = here = _sample(self._tone, columns, rows)
        right, below = _sample(self._tone, columns + 1, rows), _sample(self._tone, columns, rows + 1)
        change = np.maximum(np.abs(right - here), np.abs(below - here))
        self.textured = int((change > _TEXTURE).sum()) >= MIN_TEXTURED  # NaN compares False

    def error(self, offset: NDArray[np.floating[Any]], where: NDArray[np.bool_] | None = None) -> float:
        """Return the mean squared difference, in [0, 1]; inf if less than half of the pixels are on screen.

        Args:
            offset: (n, 2) or (2,) pixels from each pixel to its place in the previous frame.
            where: (n,) mask of the pixels to compare, at least one; by default all.
        """
        rows, columns = self.pixels
        offset = np.broadcast_to(offset, (len(rows), 2))
        use = slice(None) if where is None else where
        before = _sample(self._tone_before, columns[use] + offset[use, 0], rows[use] + offset[use, 1])
        difference = before - self._here[use]
        difference = difference[np.isfinite(difference)]
        return float(np.mean(difference**2)) if 2 * len(difference) > len(before) else float("inf")

    def shift(self, conventions: Conventions) -> NDArray[np.float64]:
        """Return the change of the jitter, (x, y) pixels: image offset in addition to unjittered motion."""
        return self.now.jitter_pixels(conventions) - self.before.jitter_pixels(conventions)

    def offset(
        self,
        conventions: Conventions,
        pixels: probe.PixelGrid | None = None,
        *,
        motion_swapped: bool = False,
        jitter_swapped: bool = False,
    ) -> NDArray[np.float64]:
        """Return (n, 2) pixels from each pixel, by default the compared ones, to its previous place.

        `motion_swapped` and `jitter_swapped` exchange x and y.
        """
        pixels = self.pixels if pixels is None else pixels
        offset = self.now.vectors(conventions, pixels, swapped=motion_swapped).astype(np.float64)
        if conventions.motion_jittered:
            return offset
        shift = self.shift(conventions)
        return offset + (shift[::-1] if jitter_swapped else shift)

    @property
    def lacks_motion(self) -> bool:
        """Whether the motion is 0 everywhere although most of the image moves."""
        tones = (np.nan_to_num(tone) for tone in (self._tone, self._tone_before))
        return not self.now.motion.any() and _image_moves(*tones)

    @property
    def variance(self) -> float:
        """Variance of the tone-mapped luminance; the error of unrelated images is twice as large."""
        return float(np.nanvar(self._here))

    @property
    def continues(self) -> bool:
        """Whether the previous image, reprojected, resembles this one."""
        return self.textured and self.error(self.offset(Conventions())) < 0.5 * self.variance

    def moving(self, conventions: Conventions) -> NDArray[np.bool_]:
        """Return the (n,) mask of pixels that move by at least a tenth of the longest vectors."""
        length = np.abs(self.now.vectors(conventions, self.pixels)).max(axis=1)
        length = np.where(np.isfinite(length), length, 0)
        least = max(0.1 * float(np.percentile(length, 99)), _ROUNDING * max(self.now.size))
        moves: NDArray[np.bool_] = length >= least
        return moves

    def disoccluded(self, order: probe.DepthOrder, conventions: Conventions, count: int) -> tuple[int, int]:
        """Count disoccluded pixels with (closer, farther) occluders, on a grid of about `count` pixels."""
        pixels = probe.pixel_grid(self.now.size, count)
        offset = self.offset(conventions, pixels)
        return probe.count_disoccluded(self.now.depth, self.before.depth, order, pixels, offset)


def frame_pairs(frames: Sequence[probe.FrameProbe]) -> list[FramePair]:
    """Return the pairs of consecutive frames that are shaded and of the same size, without a cut between."""
    return [
        FramePair(before, now)
        for before, now in pairwise(frames)
        if not now.reset and now.size == before.size and now.light is not None and before.light is not None
    ]


def _sample(padded: Float32, x: NDArray[Any], y: NDArray[Any]) -> NDArray[np.floating[Any]]:
    """Sample an image, padded by one pixel, at (x, y) with a quadratic B-spline of 3 x 3; NaN outside."""
    height, width = padded.shape[0] - 2, padded.shape[1] - 2
    inside = (x > -0.5) & (x < width - 0.5) & (y > -0.5) & (y < height - 0.5)  # False where NaN
    x, y = np.where(inside, x, 0.0), np.where(inside, y, 0.0)
    column, row = np.rint(x).astype(np.intp), np.rint(y).astype(np.intp)
    values, corner = padded.ravel(), row * (width + 2) + column
    weights_x, weights_y = _spline(x - column), _spline(y - row)
    total = np.zeros(x.shape)
    for dy, weight_y in enumerate(weights_y):
        start = dy * (width + 2)
        total += weight_y * sum(weight * values[corner + (start + dx)] for dx, weight in enumerate(weights_x))
    return np.where(inside, total, np.nan)


def _spline(fraction: NDArray[Any]) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
    return 0.5 * (0.5 - fraction) ** 2, 0.75 - fraction**2, 0.5 * (0.5 + fraction) ** 2


def _image_moves(tone: Float32, tone_before: Float32) -> bool:
    """Return whether at least half of the textured tiles have moved, and a fifth fit clearly better there."""
    height, width = tone.shape[0] - 2, tone.shape[1] - 2
    sides = [side for side in _TILE_SIDES if min(height, width) >= 1.5 * side]
    if not sides:
        return False
    side = sides[0]
    tops, lefts = (np.linspace(1, 1 + extent - side, _TILES).astype(np.intp) for extent in (height, width))
    count = moved = clearly = 0
    for top, left in product(tops, lefts):
        tile = slice(top, top + side), slice(left, left + side)
        if np.var(tone[tile]) < _MIN_CONTRAST:
            continue
        count += 1
        shift = _tile_shift(tone[tile], tone_before[tile])
        if np.abs(shift).max() >= _MIN_MOVE:
            moved += 1
            clearly += _fits_better(tone, tone_before, tile, shift)
    return count >= _MIN_TILES and 2 * moved >= count and 5 * clearly >= count


def _tile_shift(tile: Float32, before: Float32) -> NDArray[np.intp]:
    """Return the (x, y) shift at which a tile correlates best with the tile of the previous image."""
    side = tile.shape[0]
    window = np.outer(np.hanning(side), np.hanning(side))
    now, earlier = (np.fft.fft2((each - each.mean()) * window) for each in (tile, before))
    peak = np.fft.fftshift(np.fft.ifft2(earlier * np.conj(now)).real)
    row, column = np.unravel_index(np.argmax(peak), peak.shape)
    shift: NDArray[np.intp] = np.array([column, row]) - side // 2
    return shift


def _fits_better(tone: Float32, before: Float32, tile: tuple[slice, slice], shift: NDArray[np.intp]) -> bool:
    """Return whether the on-screen part of a shifted tile fits clearly better than without the shift."""
    y, x = np.mgrid[tile] - 1  # without the padding
    here = _sample(tone, x, y)
    moved, still = (
        float(np.nanmean((here - _sample(before, x + dx, y + dy)) ** 2)) for dx, dy in (shift, (0, 0))
    )
    return moved < _MAX_RATIO * still
