"""Whether an image moves: where tiles of it are found again in the previous image."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from supersampler.frame import Float32

_TILES = 5  # most tiles along each axis
_SIDES = (64, 32)  # of a tile, in pixels; the first of which four fit
_LEAST = 2  # pixels; shorter moves may be the jitter's
_MAX_RATIO = 0.5  # of errors, moved and unmoved
_MIN_CONTRAST = 1e-3  # variance of tone-mapped luminance in a tile
_MIN_TILES = 3


def image_moves(tone: Float32, tone_before: Float32) -> bool:
    """Tell whether most tiles with texture are found elsewhere, by phase correlation; of (h, w) images in [0, 1]."""
    height, width = tone.shape
    side = next((side for side in _SIDES if min(height, width) >= 1.5 * side), 0)
    if side == 0:
        return False
    count = moved = 0
    for top in _starts(height, side):
        for left in _starts(width, side):
            place = slice(top, top + side), slice(left, left + side)
            if np.var(tone[place]) < _MIN_CONTRAST:  # False for NaN, which is then found nowhere
                continue
            count += 1
            moved += _is_elsewhere(tone[place], tone_before, top, left)
    return count >= _MIN_TILES and 2 * moved > count


def _starts(extent: int, side: int) -> NDArray[np.intp]:
    """Return the first pixels of tiles, away from the borders where there is room."""
    return np.linspace(0, extent - side, min(_TILES, extent * 2 // side)).astype(np.intp)


def _is_elsewhere(tile: Float32, before: Float32, top: int, left: int) -> bool:
    side = tile.shape[0]
    window = np.hanning(side)[:, None] * np.hanning(side)
    unmoved = before[top : top + side, left : left + side]
    spectrum = _spectrum(unmoved, window) * np.conj(_spectrum(tile, window))
    peak = np.fft.irfft2(spectrum / np.maximum(np.abs(spectrum), 1e-12), s=(side, side))
    y, x = (int((i + side // 2) % side) - side // 2 for i in np.unravel_index(np.argmax(peak), peak.shape))
    if max(abs(x), abs(y)) < _LEAST:
        return False
    inside = slice(max(0, -top - y), side - max(0, top + y + side - before.shape[0])), slice(
        max(0, -left - x), side - max(0, left + x + side - before.shape[1])
    )
    rows, columns = np.arange(side)[inside[0]] + top + y, np.arange(side)[inside[1]] + left + x
    if 2 * len(rows) * len(columns) < side * side:
        return False
    moved = np.square(tile[inside] - before[np.ix_(rows, columns)]).mean()
    return bool(moved < _MAX_RATIO * np.square(tile - unmoved).mean())


def _spectrum(tile: Float32, window: NDArray[Any]) -> NDArray[Any]:
    return np.fft.rfft2((tile - tile.mean()) * window)
