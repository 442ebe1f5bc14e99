"""How well motion explains an image by the previous one.

The error is the mean squared difference of luminance, compressed to [0, 1], between a pixel and its place in
the previous image. It is taken at some thousand places, so that the cost does not grow with the image. It is
squared because a hard edge sampled once a pixel is often the same at the same pixel: a median or mean
difference would find no motion there. Both images are read through the same small filter: an image read at
whole pixels is sharper and noisier than one read between pixels, and wrong motion would win by blur.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from supersampler.frame import Array, Float32

Places = tuple[NDArray[np.intp], NDArray[np.intp]]
"""Rows and columns (n,) of pixels."""

MIN_PLACES = 1000
"""With fewer textured places, chance is larger than the differences looked for."""

_LUMINANCE = np.array([0.2126, 0.7152, 0.0722], np.float32)
PLACES = 12_000
"""About how many pixels a check reads."""

_TEXTURE = 0.01  # change of the compressed luminance from one pixel to the next


def luminance(color: Array) -> Float32:
    """Return (h, w) luminance of linear (h, w, 3) colour: a new array, which no caller overwrites."""
    with np.errstate(invalid="ignore", over="ignore"):  # NaN and Inf stay; `Reprojection` leaves them out
        values: Float32 = color.astype(np.float32, copy=False) @ _LUMINANCE
    return values


class Reprojection:
    """Two luminances (h, w) of neighbouring frames, compared at some places.

    Attributes:
        places: rows and columns (n,) of those places.
        textured: whether enough of them differ from their neighbours.
    """

    def __init__(self, now: Float32, before: Float32) -> None:
        rows, columns = grid((now.shape[1], now.shape[0]), PLACES)
        known = now[rows, columns]
        known = known[np.isfinite(known) & (known > 0)]
        middle = float(np.median(known)) if known.size else 1.0
        tone, self._before = _tone(now, middle), _tone(before, middle)
        here = _read(tone, columns, rows)
        right, below = _read(tone, columns + 1, rows), _read(tone, columns, rows + 1)
        change = np.maximum(np.abs(right - here), np.abs(below - here))
        self.places, self._now = (rows, columns), here
        self.textured = int((change > _TEXTURE).sum()) >= MIN_PLACES  # NaN is not

    def error(self, offset: NDArray[np.floating[Any]], where: NDArray[np.bool_] | None = None) -> float:
        """Return the mean squared difference, in [0, 1]; inf where less than half is on screen.

        Args:
            offset: (n, 2) or (2,) pixels from each place to its place in the previous frame.
            where: (n,) which places to compare, all by default; at least one.
        """
        rows, columns = self.places
        offset = np.broadcast_to(offset, (len(rows), 2))
        use = slice(None) if where is None else where
        before = _read(self._before, columns[use] + offset[use, 0], rows[use] + offset[use, 1])
        difference = before - self._now[use]
        difference = difference[np.isfinite(difference)]
        return float(np.mean(difference**2)) if 2 * len(difference) > len(before) else float("inf")


def grid(size: tuple[int, int], places: int) -> Places:
    """Return rows and columns (n,) of an even grid of at most about `places` pixels of a (width, height)."""
    step = max(1, int(np.ceil(np.sqrt(size[0] * size[1] / places))))
    rows, columns = np.meshgrid(
        np.arange(step // 2, size[1], step), np.arange(step // 2, size[0], step), indexing="ij"
    )
    return rows.ravel(), columns.ravel()


def moving(motion: Array) -> NDArray[np.bool_]:
    """Return (n,) which of (n, 2) vectors of any unit count as motion: a tenth of the longest, or more."""
    length = np.abs(motion).max(axis=1) if len(motion) else np.zeros(0)
    length = np.where(np.isfinite(length), length, 0)
    longest = np.percentile(length, 99) if length.size else 0.0
    moves: NDArray[np.bool_] = (length > 0) & (length >= 0.1 * longest)
    return moves


def _tone(image: Float32, middle: float) -> Float32:
    """Return luminance compressed to [0, 1], with one more pixel all round; NaN where it is not finite."""
    tone = np.maximum(image, 0)
    with np.errstate(invalid="ignore"):  # Inf / Inf is NaN, which is left out
        tone /= tone + np.float32(middle)
    return np.pad(tone, 1, mode="edge")


def _read(padded: Float32, x: NDArray[Any], y: NDArray[Any]) -> NDArray[np.floating[Any]]:
    """Return a `_tone` at (x, y) through a quadratic B-spline, 3 x 3 pixels; NaN outside."""
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
