"""Tiles of an image, and rectangles that cover them."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from supersampler.backends.cpu.layout import RENDER_TILE, STATIC_TILE, TILE
from supersampler.backends.cpu.threads import Rect
from supersampler.frame import Float32, Size

Bool = NDArray[np.bool_]

FILTER_REACH = 4
"""Distance of the samples that a display pixel reads from its position, in samples."""
SAMPLE_REACH = 1
"""Likewise of the samples that lie in it: jitter moves them by half a sample."""
HALO = 2
"""Tiles around computed ones that are gathered, too: the network reads 36 pixels around a pixel."""
MIN_GAP = 3
"""Least number of tiles between two boxes of a row.

Kernels may write 5 pixels beyond a box, which are 80 display pixels at the last level of the network.
"""
GATHER_WORK = 0.5
"""Share of a full step's work in a tile that is only gathered, as input of the network for its neighbours."""


class Tiles:
    """The tiles that a step computes.

    Args:
        required: (rows, columns) tiles that it must compute.

    Attributes:
        computed: (rows, columns) tiles that it computes: the required ones, and gaps in rows below MIN_GAP.
        any, all: whether any, all tiles are computed.
        gathered: (rows, columns) computed tiles, and tiles that the network reads around them.
    """

    def __init__(self, required: Bool) -> None:
        runs = runs_of(required, MIN_GAP)
        self.computed = _covered(runs, required.shape)
        self.any, self.all = bool(self.computed.any()), bool(self.computed.all())
        gathered = runs if self.all or not self.any else runs_of(dilated(self.computed, HALO), MIN_GAP)
        self.gathered = _covered(gathered, required.shape)
        self._runs = {False: runs, True: gathered}

    def boxes(self, unit: int, size: Size, *, halo: bool = False) -> list[Rect]:
        """Return rectangles of pixels that cover the computed tiles.

        Args:
            unit: side of a tile, in pixels of an image of `size`.
            size: (width, height); the last tiles end there.
            halo: cover the gathered tiles instead.
        """
        return scaled(self._runs[halo], unit, size)

    def work(self) -> Float32:
        """Return the share of a full step's work in each tile, (rows, columns) in [0, 1]."""
        return np.where(self.computed, 1.0, np.where(self.gathered, GATHER_WORK, 0.0)).astype(np.float32)


def tiles_with(mask: Bool, display: Size) -> Bool:
    """Return the tiles that hold one of these static tiles of the display."""
    side = TILE // STATIC_TILE
    rows, columns = (-(-extent // TILE) for extent in display[::-1])
    whole = np.zeros((rows * side, columns * side), bool)
    whole[: mask.shape[0], : mask.shape[1]] = mask
    return np.asarray(whole.reshape(rows, side, columns, side).any((1, 3)))


def static_tiles_in(mask: Bool, shape: tuple[int, ...]) -> Bool:
    """Return the static tiles, of this shape, that lie in these tiles."""
    side = TILE // STATIC_TILE
    return mask.repeat(side, 0).repeat(side, 1)[: shape[0], : shape[1]]


def dilated(mask: Bool, tiles: int) -> Bool:
    """Add all tiles within `tiles` rows and columns of the mask."""
    wide = np.pad(mask, tiles)
    for axis in (0, 1):
        shifted = [np.roll(wide, step, axis) for step in range(-tiles, tiles + 1)]
        wide = np.logical_or.reduce(shifted)
    return np.asarray(wide[tiles:-tiles, tiles:-tiles])


def scaled(runs: Sequence[Rect], unit: int, size: Size) -> list[Rect]:
    """Return rectangles of tiles as rectangles of pixels, cut at the image; empty ones are left out."""
    width, height = size
    boxes = [
        Rect(y0 * unit, min(y1 * unit, height), x0 * unit, min(x1 * unit, width)) for y0, y1, x0, x1 in runs
    ]
    return [box for box in boxes if box.y0 < box.y1 and box.x0 < box.x1]


def runs_of(mask: Bool, gap: int = 1) -> list[Rect]:
    """Return rectangles of tiles that cover a mask.

    Tiles of a row less than `gap` apart share a rectangle; consecutive equal rows do, too.
    """
    if mask.all():  # mostly
        return [Rect(0, mask.shape[0], 0, mask.shape[1])]
    runs: list[Rect] = []
    above: list[Rect] = []
    for y, row in enumerate(mask):
        if y and np.array_equal(row, mask[y - 1]):  # mostly
            above = [box._replace(y1=y + 1) for box in above]
            continue
        spans: list[tuple[int, int]] = []
        for x in np.flatnonzero(row).tolist():
            if spans and x - spans[-1][1] < gap:
                spans[-1] = spans[-1][0], x + 1
            else:
                spans.append((x, x + 1))
        if [(box.x0, box.x1) for box in above] == spans:
            above = [box._replace(y1=y + 1) for box in above]
        else:
            runs += above
            above = [Rect(y, y + 1, *span) for span in spans]
    return runs + above


def _covered(runs: Sequence[Rect], shape: tuple[int, ...]) -> Bool:
    mask = np.zeros(shape, bool)
    for y0, y1, x0, x1 in runs:
        mask[y0:y1, x0:x1] = True
    return mask


def tiles_reading(changed: Bool, display: Size, render: Size, reach: int) -> Bool:
    """Return the static tiles of the display that read changed tiles of the frame.

    Args:
        changed: (rows, columns) of tiles of RENDER_TILE samples.
        display: (width, height).
        render: (width, height).
        reach: samples around a tile that it reads.
    """
    sums = np.pad(np.cumsum(np.cumsum(changed, axis=0), axis=1), ((1, 0), (1, 0)))
    (top, bottom), (left, right) = (
        _read_tiles(-(-display[axis] // STATIC_TILE), display[axis], render[axis], reach) for axis in (1, 0)
    )
    inside: NDArray[np.int64] = sums[np.ix_(bottom, right)] - sums[np.ix_(top, right)]
    inside += sums[np.ix_(top, left)] - sums[np.ix_(bottom, left)]
    return np.asarray(inside > 0)


def _read_tiles(
    tiles: int, display: int, render: int, reach: int
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the first and one past the last tile of the frame that each static tile reads on an axis."""
    edges = np.minimum(np.arange(tiles + 1) * STATIC_TILE, display) * (render / display)
    first = np.clip(np.floor(edges[:-1]) - reach, 0, None) // RENDER_TILE
    last = np.clip(np.ceil(edges[1:]) + reach, None, render) / RENDER_TILE
    return first.astype(np.int64), np.ceil(last).astype(np.int64)
