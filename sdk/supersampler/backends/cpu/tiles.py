"""Tiles of a picture, and rectangles that cover them."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from supersampler.backends.cpu.layout import SAMPLES, TILE
from supersampler.backends.cpu.threads import Rect
from supersampler.frame import Float32, Size

Bool = NDArray[np.bool_]

REACH = 4
"""Samples beyond its own that a display pixel looks at."""
HALO = 2
"""Tiles around those that are drawn: the network sees 36 pixels far."""
GAP = 3
"""Tiles between boxes of a row: kernels may write 5 pixels too many, 80 of the display at the last level."""
NEIGHBOUR = 0.5
"""Share of the work in a tile that is only gathered, for the network to see from its neighbours."""


class Tiles:
    """Tiles of a picture that a step draws.

    Args:
        wanted: (rows, columns) those that it must.

    Attributes:
        drawn: those that it does: small gaps in rows are closed.
        any, all: whether it draws any, all of them.
        seen: those that the network sees.
    """

    def __init__(self, wanted: Bool) -> None:
        runs = runs_of(wanted, GAP)
        self.drawn = _covered(runs, wanted.shape)
        self.any, self.all = bool(self.drawn.any()), bool(self.drawn.all())
        around = runs if self.all or not self.any else runs_of(grown(self.drawn, HALO), GAP)
        self.seen = _covered(around, wanted.shape)
        self._runs = {False: runs, True: around}

    def boxes(self, unit: int, size: Size, *, halo: bool = False) -> list[Rect]:
        """Return rectangles of pixels that cover them.

        Args:
            unit: pixels of a tile's side, in an image of `size`.
            size: (width, height) that ends the last tiles.
            halo: what their network sees, too.
        """
        return scaled(self._runs[halo], unit, size)

    def work(self) -> Float32:
        """Share of the work of a step in each tile."""
        return np.where(self.drawn, 1.0, np.where(self.seen, NEIGHBOUR, 0.0)).astype(np.float32)


def grown(mask: Bool, tiles: int) -> Bool:
    """Add what is within so many tiles."""
    wide = np.pad(mask, tiles)
    for axis in (0, 1):
        shifted = [np.roll(wide, step, axis) for step in range(-tiles, tiles + 1)]
        wide = np.logical_or.reduce(shifted)
    return np.asarray(wide[tiles:-tiles, tiles:-tiles])


def scaled(runs: Sequence[Rect], unit: int, size: Size) -> list[Rect]:
    """Boxes of tiles as boxes of pixels, without those beyond the image."""
    width, height = size
    boxes = [
        Rect(y0 * unit, min(y1 * unit, height), x0 * unit, min(x1 * unit, width)) for y0, y1, x0, x1 in runs
    ]
    return [box for box in boxes if box.y0 < box.y1 and box.x0 < box.x1]


def runs_of(mask: Bool, gap: int = 1) -> list[Rect]:
    """Boxes of tiles that cover a mask; those of a row are at least `gap` apart, equal rows are one."""
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


def seen_from(changed: Bool, display: Size, render: Size) -> Bool:
    """Tiles of the display that look at tiles of the frame."""
    sums = np.pad(np.cumsum(np.cumsum(changed, axis=0), axis=1), ((1, 0), (1, 0)))
    (top, bottom), (left, right) = (
        _looks(-(-display[axis] // TILE), display[axis], render[axis]) for axis in (1, 0)
    )
    inside: NDArray[np.int64] = sums[np.ix_(bottom, right)] - sums[np.ix_(top, right)]
    inside += sums[np.ix_(top, left)] - sums[np.ix_(bottom, left)]
    return np.asarray(inside > 0)


def _looks(tiles: int, display: int, render: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """First tile of the frame that each tile of the display looks at, and the one after the last."""
    edges = np.minimum(np.arange(tiles + 1) * TILE, display) * (render / display)
    first = np.clip(np.floor(edges[:-1]) - REACH, 0, None) // SAMPLES
    last = np.clip(np.ceil(edges[1:]) + REACH, None, render) / SAMPLES
    return first.astype(np.int64), np.ceil(last).astype(np.int64)
