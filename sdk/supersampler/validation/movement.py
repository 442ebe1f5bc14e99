"""Detect movement without motion vectors: tiles of an image are looked for in the previous one."""

import numpy as np
from numpy.typing import NDArray

from supersampler.frame import Float32

_TILES = 5  # most tiles along each axis
_SIDES = (64, 32)  # of a tile, in pixels; the first of which four fit
_LEAST = 2  # pixels; shorter moves may be the jitter's
_MAX_RATIO = 0.7  # of errors, moved and unmoved
_MIN_CONTRAST = 1e-3  # variance of tone-mapped luminance in a tile
_MIN_TILES = 3


def image_moves(tone: Float32, tone_before: Float32) -> bool:
    """Return whether most tiles with texture fit elsewhere in the previous image, and a fifth clearly better.

    Args:
        tone: (h, w) tone-mapped luminance in [0, 1].
        tone_before: the same of the previous image.
    """
    height, width = tone.shape
    side = next((side for side in _SIDES if min(height, width) >= 1.5 * side), 0)
    if side == 0:
        return False
    count = moved = clearly = 0
    for top in _starts(height, side):
        for left in _starts(width, side):
            place = slice(top, top + side), slice(left, left + side)
            if np.var(tone[place]) < _MIN_CONTRAST:  # False for NaN, which is then found nowhere
                continue
            count += 1
            x, y = _shift(tone[place], tone_before[place])
            moved += max(abs(x), abs(y)) >= _LEAST
            clearly += max(abs(x), abs(y)) >= _LEAST and _fits(tone, tone_before, place, (x, y))
    return count >= _MIN_TILES and 2 * moved >= count and 5 * clearly >= count


def _starts(extent: int, side: int) -> NDArray[np.intp]:
    """Return the first pixels of tiles, away from the borders where there is room."""
    return np.linspace(0, extent - side, min(_TILES, extent * 2 // side)).astype(np.intp)


def _shift(tile: Float32, before: Float32) -> tuple[int, int]:
    """Return (x, y) from the tile to where it correlates best with the previous one."""
    side = tile.shape[0]
    window = np.hanning(side)[:, None] * np.hanning(side)
    now, earlier = (np.fft.rfft2((each - each.mean()) * window) for each in (tile, before))
    peak = np.fft.irfft2(earlier * np.conj(now), s=(side, side))
    y, x = np.unravel_index(np.argmax(peak), peak.shape)
    return int((x + side // 2) % side) - side // 2, int((y + side // 2) % side) - side // 2


def _fits(tone: Float32, before: Float32, place: tuple[slice, slice], shift: tuple[int, int]) -> bool:
    """Return whether the part of a tile that is on screen fits clearly better there than in its own place."""
    rows, columns = (np.arange(part.start, part.stop) for part in place)
    rows = rows[(rows + shift[1] >= 0) & (rows + shift[1] < tone.shape[0])]
    columns = columns[(columns + shift[0] >= 0) & (columns + shift[0] < tone.shape[1])]
    here = tone[np.ix_(rows, columns)]
    moved = np.square(here - before[np.ix_(rows + shift[1], columns + shift[0])]).mean()
    return bool(moved < _MAX_RATIO * np.square(here - before[np.ix_(rows, columns)]).mean())
