"""What a step leaves undone: tiles of the picture where the scene stands still keep what they show."""

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from supersampler.frame import Float32, Size
from supersampler.host.bands import Bands, Box
from supersampler.host.compiler import load_kernels
from supersampler.host.memory import address
from supersampler.host.reading import Planes
from supersampler.host.stillness import Jitter, Stillness, Sums

Bool = NDArray[np.bool_]

TILE = 32
"""Display pixels."""
SAMPLES = 16
"""Of a tile of the frame: see kernels.stillness."""
REACH = 4
"""Samples beyond its own that a display pixel looks at."""
HALO = 2
"""Tiles around those that are drawn: the network sees 36 pixels far."""
GAP = 3
"""Tiles between boxes of a row: kernels may write 5 pixels too many, 80 of the display at the last level."""
LEAST = 0.1
"""Share of the tiles below which it is not worth while to leave them out."""
SETTLED = 16
"""Frames between two looks at a tile, at least, also where jitter repeats sooner or there is none."""
NEIGHBOUR = 0.5
"""Share of the work in a tile that is only gathered, for the network to see from its neighbours."""

_STAMPS = itertools.count(1)


class Trail:
    """What goes from frame to frame beside a picture.

    Args:
        display: size of the picture.

    Attributes:
        stamps: of each tile; where two histories have the same, they hold the same. 0: nothing.
        stillness: of the frames.
        matched: of each tile, frames in a row in which all that it looks at was as one period before.
        still: tiles whose picture is as it was one period before, too.
        looks: what the picture was; shared with the histories before.
        looked: of each tile, the stamp that it has there.
        work: of each tile, the share that the step did.
    """

    def __init__(self, display: Size) -> None:
        shape = -(-display[1] // TILE), -(-display[0] // TILE)
        self.stamps = np.zeros(shape, np.int64)
        self.stillness = Stillness()
        self.matched = np.zeros(shape, np.int32)
        self.still = np.zeros(shape, bool)
        self.looks: Looks | None = None
        self.looked = np.zeros(shape, np.int64)
        self.work = np.ones(shape, np.float32)

    def follow(self, past: "Trail", stillness: Stillness, same: Bool) -> None:
        """Know what the past knew, and that these tiles look at what they looked at one period before."""
        self.stillness = stillness
        self.matched = np.where(same, past.matched + 1, 0).astype(np.int32)
        self.still = past.still & same
        self.looks, self.looked = past.looks, past.looked.copy()

    def forget(self) -> None:
        """Know nothing."""
        self.stillness, self.looks = Stillness(), None
        self.matched[:], self.still[:] = 0, False

    def arrays(self) -> Mapping[str, NDArray[Any]]:
        """Copies, for `load`."""
        arrays = self.stillness.arrays()
        if arrays:
            arrays |= {"still.matched": self.matched.copy(), "still.tiles": self.still.copy()}
        if self.looks is not None:
            arrays["still.looks"] = self.looks.pixels.copy()
            arrays["still.looked"] = self.looked == self.looks.stamps
        return arrays

    def load(self, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Continue from there; the picture has been loaded, too."""
        self.stamps[:] = next(_STAMPS)
        self.stillness = Stillness.of_arrays(arrays)
        if "still.matched" in arrays:
            self.matched, self.still = arrays["still.matched"].copy(), arrays["still.tiles"].copy()
        if "still.looks" in arrays:
            self.looked = np.where(arrays["still.looked"], next(_STAMPS), 0)
            self.looks = Looks(arrays["still.looks"].copy(), self.looked.copy())


@dataclass(eq=False)
class Looks:
    """What tiles of the picture were when they were last looked at.

    Attributes:
        pixels: (H, W, 3) linear RGB.
        stamps: of each tile, which look it is.
    """

    pixels: Float32
    stamps: NDArray[np.int64]


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
        runs = _runs(wanted, GAP)
        self.drawn = _covered(runs, wanted.shape)
        self.any, self.all = bool(self.drawn.any()), bool(self.drawn.all())
        around = runs if self.all else _runs(grown(self.drawn, HALO), GAP)
        self.seen = _covered(around, wanted.shape)
        self._runs = {False: runs, True: around}

    def boxes(self, unit: int, size: Size, *, halo: bool = False) -> list[Box]:
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


class Skipping:
    """Decides what a step draws, and keeps the rest.

    Args:
        bands: threads.
    """

    def __init__(self, bands: Bands) -> None:
        self._bands = bands
        kernels = load_kernels("stillness.fingerprints", "stillness.show", "stillness.look")
        self._sum, self._show, self._look = kernels.values()

    def begin(
        self, planes: Planes, jitter: Jitter, display: Size, past: Trail, left: Trail, *, skips: bool
    ) -> Tiles:
        """Say what is to be drawn, and that `left` does not hold it yet; `skips`: not necessarily all."""
        drawn = np.ones(past.stamps.shape, bool)
        left.forget()
        if skips:
            stillness = past.stillness.after(jitter, self._sums(planes))
            same = np.zeros(drawn.shape, bool)
            if stillness.same is not None and stillness.same.any():
                same = ~_seen_from(~stillness.same, display, planes.depth.shape[1::-1])
            left.follow(past, stillness, same)
            if left.still.mean() >= LEAST:
                drawn = ~left.still
        tiles = Tiles(drawn)
        left.stamps[tiles.drawn] = next(_STAMPS)
        left.work = tiles.work()
        return tiles

    def end(
        self,
        tiles: Tiles,
        past: Trail,
        left: Trail,
        kept: Sequence[tuple[int, NDArray[Any], NDArray[Any]]],
        image: Float32,
        *,
        exposure: float,
        tolerance: float,
    ) -> None:
        """Let the other tiles show what they did, and go on with it; see which of those drawn have settled.

        Args:
            tiles: what was drawn.
            past: of the history before.
            left: of the one that is left.
            kept: for each image of the histories, pixels of a tile's side, and (H, W, ...) the past's and
                where it is left; the first holds the picture in its first channels.
            image: (H, W, 3).
            exposure: of the frame.
            tolerance: how far a tile that has settled may be from what it was one period before, of what a
                screen shows, root mean square of its pixels.
        """
        self._settle(tiles, left, kept[0][2], exposure, tolerance)
        if tiles.all:
            return
        stale = ~tiles.drawn & (left.stamps != past.stamps)
        if stale.any():
            runs = _runs(stale)
            for unit, before, after in kept:
                boxes = scaled(runs, unit, (before.shape[1], before.shape[0]))
                self._bands.cover(boxes, partial(_copy, before, after))
        left.stamps[~tiles.drawn] = past.stamps[~tiles.drawn]
        pixels, (height, width) = kept[0][1], image.shape[:2]
        arguments = address(pixels), pixels.shape[2], width
        boxes = scaled(_runs(~tiles.drawn), TILE, (width, height))
        self._bands.cover(boxes, lambda box, _: self._show(*arguments, *box, address(image)))

    def _settle(
        self, tiles: Tiles, left: Trail, pixels: NDArray[Any], exposure: float, tolerance: float
    ) -> None:
        """Once a period, look at tiles of a scene that stands still; those that have not changed may rest."""
        interval = left.stillness.period * -(-SETTLED // max(left.stillness.period, 1))
        if not interval:
            return
        due = tiles.drawn & (left.matched > 0) & ((left.matched - 1) % interval == 0)
        if not due.any():
            return
        height, width = pixels.shape[:2]
        if left.looks is None:
            left.looks = Looks(np.zeros((height, width, 3), np.float32), np.zeros(due.shape, np.int64))
        changes = np.zeros(due.shape, np.float32)
        arguments = address(pixels), pixels.shape[2], width, height, due.shape[1], exposure
        places = address(left.looks.pixels), address(changes)
        self._bands.cover(_runs(due), lambda box, _: self._look(*arguments, *box, *places))
        known = (left.looked == left.looks.stamps) & (left.matched > interval)
        left.still |= due & known & (changes <= tolerance * tolerance)
        left.looked[due] = left.looks.stamps[due] = next(_STAMPS)

    def _sums(self, planes: Planes) -> Sums:
        h, w = planes.depth.shape
        rows, columns = -(-h // SAMPLES), -(-w // SAMPLES)
        words = np.empty((rows, columns, 8), np.uint64)
        inputs = (*(address(plane) for plane in planes), address(planes.motion), w, h)
        self._bands.run(rows, lambda y0, y1, _: self._sum(*inputs, y0, y1, address(words)))
        return np.asarray(words @ _FACTORS)


_FACTORS = np.array([pow(0x9E3779B97F4A7C15, k, 2**64) for k in range(1, 9)], np.uint64)


def grown(mask: Bool, tiles: int) -> Bool:
    """Add what is within so many tiles."""
    wide = np.pad(mask, tiles)
    for axis in (0, 1):
        shifted = [np.roll(wide, step, axis) for step in range(-tiles, tiles + 1)]
        wide = np.logical_or.reduce(shifted)
    return np.asarray(wide[tiles:-tiles, tiles:-tiles])


def scaled(runs: Sequence[Box], unit: int, size: Size) -> list[Box]:
    """Boxes of tiles as boxes of pixels, without those beyond the image."""
    width, height = size
    boxes = [
        Box(y0 * unit, min(y1 * unit, height), x0 * unit, min(x1 * unit, width)) for y0, y1, x0, x1 in runs
    ]
    return [box for box in boxes if box.y0 < box.y1 and box.x0 < box.x1]


def _runs(mask: Bool, gap: int = 1) -> list[Box]:
    """Boxes of tiles that cover a mask; those of a row are at least `gap` apart, equal rows are one."""
    runs: list[Box] = []
    above: list[Box] = []
    for y, row in enumerate(mask):
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
            above = [Box(y, y + 1, *span) for span in spans]
    return runs + above


def _covered(runs: Sequence[Box], shape: tuple[int, ...]) -> Bool:
    mask = np.zeros(shape, bool)
    for y0, y1, x0, x1 in runs:
        mask[y0:y1, x0:x1] = True
    return mask


def _seen_from(changed: Bool, display: Size, render: Size) -> Bool:
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


def _copy(before: NDArray[Any], after: NDArray[Any], box: Box, worker: int) -> None:  # noqa: ARG001  # any
    y0, y1, x0, x1 = box
    after[y0:y1, x0:x1] = before[y0:y1, x0:x1]
