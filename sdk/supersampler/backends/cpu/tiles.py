"""The tiles of an image that a step computes, and rectangles that cover them."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from supersampler.backends.cpu.threads import Rect
from supersampler.frame import Size

Bool = NDArray[np.bool_]

HALO = 2
"""Tiles around computed ones that are gathered, too: the receptive field of the network is 36 pixels."""
MIN_GAP = 3
"""Smallest number of tiles between two rectangles of a row.

Kernels may write 5 pixels beyond a rectangle: 80 display pixels at the last level of the network.
"""


class Tiles:
    """The tiles that a step computes.

    Args:
        required: (rows, columns) tiles that must be computed.

    Attributes:
        computed: (rows, columns) the required tiles, and those in gaps below MIN_GAP between them.
        any, all: whether any or all tiles are computed.
        gathered: (rows, columns) the computed tiles, and those that the network reads around them.
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
            unit: side of a tile in pixels.
            size: (width, height) of the image, at which the last tiles end.
            halo: cover the gathered tiles instead.
        """
        return scaled(self._runs[halo], unit, size)


def dilated(mask: Bool, tiles: int) -> Bool:
    """Return the mask with all tiles within `tiles` rows and columns added."""
    padded = np.pad(mask, tiles)
    for axis in (0, 1):
        padded = np.logical_or.reduce([np.roll(padded, step, axis) for step in range(-tiles, tiles + 1)])
    return np.asarray(padded[tiles:-tiles, tiles:-tiles])


def scaled(runs: Sequence[Rect], unit: int, size: Size) -> list[Rect]:
    """Return rectangles of tiles as rectangles of pixels, clipped to the image, without empty ones."""
    width, height = size
    boxes = [
        Rect(y0 * unit, min(y1 * unit, height), x0 * unit, min(x1 * unit, width)) for y0, y1, x0, x1 in runs
    ]
    return [box for box in boxes if box.y0 < box.y1 and box.x0 < box.x1]


def runs_of(mask: Bool, gap: int = 1) -> list[Rect]:
    """Return rectangles of tiles that cover a mask.

    A rectangle joins tiles of a row that are less than `gap` apart, and consecutive equal rows.
    """
    if mask.all():  # the most frequent case
        return [Rect(0, mask.shape[0], 0, mask.shape[1])]
    if not mask.any():
        return []
    spans = _spans_of_rows(mask, gap)
    runs: list[Rect] = []
    first = 0
    for y in range(1, len(spans) + 1):
        if y == len(spans) or spans[y] != spans[first]:
            runs += [Rect(first, y, *span) for span in spans[first]]
            first = y
    return runs


def _spans_of_rows(mask: Bool, gap: int) -> list[list[tuple[int, int]]]:
    """Return the first and the end of each span of each row; spans less than `gap` apart are joined."""
    rows, edges = np.nonzero(np.diff(mask, prepend=False, append=False))
    spans: list[list[tuple[int, int]]] = [[] for _ in mask]
    for y, first, end in zip(rows[::2].tolist(), edges[::2].tolist(), edges[1::2].tolist(), strict=True):
        row = spans[y]
        if row and first - row[-1][1] < gap:
            row[-1] = row[-1][0], end
        else:
            row.append((first, end))
    return spans


def _covered(runs: Sequence[Rect], shape: tuple[int, ...]) -> Bool:
    mask = np.zeros(shape, bool)
    for y0, y1, x0, x1 in runs:
        mask[y0:y1, x0:x1] = True
    return mask
