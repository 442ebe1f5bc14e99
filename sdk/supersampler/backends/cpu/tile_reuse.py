"""What a step leaves undone: tiles of the picture where the scene stands still keep what they show."""

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from supersampler.backends.cpu.kernel_loader import Call
from supersampler.backends.cpu.layout import SAMPLES, TILE
from supersampler.backends.cpu.memory import address
from supersampler.backends.cpu.static_tiles import Jitter, Sums
from supersampler.backends.cpu.structs import FrameInputs, TileComparison, pack
from supersampler.backends.cpu.threads import Rect, ThreadPool
from supersampler.backends.cpu.tile_state import Looks, Pending, TileState, next_generation
from supersampler.backends.cpu.tiles import Tiles, runs_of, scaled, seen_from
from supersampler.conventions.jitter import jitter_phase_count
from supersampler.frame import Float32, Size

_KERNELS = "backends.cpu.kernels.stillness"
TILE_REUSE_KERNELS = (
    f"{_KERNELS}.fingerprints",
    f"{_KERNELS}.copy_colors",
    f"{_KERNELS}.compare_tiles",
)
LEAST = 0.1
"""Share of the tiles below which it is not worth while to leave them out."""
SETTLED = 16
"""Frames between two looks at a tile, at least, also where jitter repeats sooner or there is none."""
CIRCLES = 1.0, 4.0, 8.0
"""What a tile may change by in the first period, the second and each further one, and yet rest."""

_FACTORS = np.array([pow(0x9E3779B97F4A7C15, k, 2**64) for k in range(1, 9)], np.uint64)


class TileReuse:
    """Decides what a step draws, and keeps the rest.

    Args:
        kernels: SKIPPING.
        bands: threads.
    """

    def __init__(self, kernels: Mapping[str, Call], bands: ThreadPool) -> None:
        self._bands = bands
        self._sum, self._show, self._look = (kernels[name] for name in TILE_REUSE_KERNELS)

    @staticmethod
    def most_bytes(display: Size, render: Size) -> int:
        """What a history comes to hold when all of a scene stands still."""
        phases = jitter_phase_count(display[0] / render[0])
        tiles = -(-render[0] // SAMPLES) * -(-render[1] // SAMPLES)
        return display[0] * display[1] * 3 * 4 + phases * tiles * 8

    def begin(
        self,
        planes: FrameInputs,
        jitter: Jitter,
        display: Size,
        past: TileState,
        left: TileState,
        *,
        skips: bool,
    ) -> Tiles:
        """Say what is to be drawn, and that `left` does not hold it yet; `skips`: not necessarily all."""
        drawn = np.ones(past.generations.shape, bool)
        left.forget()
        if skips:
            self._keep_looks(past)
            stillness = past.stillness.after(jitter, self._sums(planes))
            same = np.zeros(drawn.shape, bool)
            if stillness.same is not None and stillness.same.any():
                same = ~seen_from(~stillness.same, display, planes.depth.shape[1::-1])
            left.follow(past, stillness, same)
            if left.still.mean() >= LEAST:
                drawn = ~left.still
        tiles = Tiles(drawn)
        left.generations[tiles.drawn] = next_generation()
        left.work = tiles.work()
        return tiles

    def end(
        self,
        tiles: Tiles,
        past: TileState,
        left: TileState,
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
        stale = ~tiles.drawn & (left.generations != past.generations)
        if stale.any():
            runs = runs_of(stale)
            for unit, before, after in kept:
                boxes = scaled(runs, unit, (before.shape[1], before.shape[0]))
                self._bands.cover("skip", boxes, partial(_copy, before, after))
        left.generations[~tiles.drawn] = past.generations[~tiles.drawn]
        pixels, (height, width) = kept[0][1], image.shape[:2]
        arguments = address(pixels), pixels.shape[2], width
        boxes = scaled(runs_of(~tiles.drawn), TILE, (width, height))
        self._bands.cover("skip", boxes, lambda box, _: self._show(*arguments, *box, address(image)))

    def _settle(
        self, tiles: Tiles, left: TileState, pixels: NDArray[Any], exposure: float, tolerance: float
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
        tiles_ = pack(
            TileComparison(
                pixels, left.looks.pixels, changes, pixels.shape[2], width, height, due.shape[1], exposure
            )
        )
        self._bands.cover("skip", runs_of(due), lambda box, _: self._look(tiles_, *box))
        known = (left.looked == left.looks.generations) & (left.matched > interval)
        allowed = allowed_change(tolerance, (left.matched - 1) // interval)
        left.still |= due & known & (changes <= allowed * allowed)
        left.looked[due] = next_generation()
        left.pending = Pending(due, pixels)

    def _keep_looks(self, past: TileState) -> None:
        """Copy tiles that have been looked at to where all histories find them.

        Done again, it changes nothing more: a step that is interrupted may repeat it.
        """
        if past.pending is None or past.looks is None:
            return
        tiles, image = past.pending
        height, width = image.shape[:2]
        arguments, to = (address(image), image.shape[2], width), address(past.looks.pixels)
        past.looks.generations[tiles] = 0  # for other histories: these are no longer what they knew
        boxes = scaled(runs_of(tiles), TILE, (width, height))
        self._bands.cover("skip", boxes, lambda box, _: self._show(*arguments, *box, to))
        past.looks.generations[tiles] = past.looked[tiles]

    def _sums(self, planes: FrameInputs) -> Sums:
        h, w = planes.depth.shape
        rows, columns = -(-h // SAMPLES), -(-w // SAMPLES)
        words = np.empty((rows, columns, 8), np.uint64)
        color, depth, motion = address(planes.color), address(planes.depth), address(planes.motion)
        inputs = color, depth, motion, motion, w, h
        self._bands.run("skip", rows, lambda y0, y1, _: self._sum(*inputs, y0, y1, address(words)))
        return np.asarray(words @ _FACTORS)


def allowed_change(tolerance: float, periods: NDArray[np.int32]) -> Float32:
    """What tiles may change by in a period and yet rest: more, the longer what they look at stands still.

    What has not settled by then goes round in a circle, of which any part is as good.

    Args:
        tolerance: in the first period.
        periods: since the first look at each tile; the first is 1.
    """
    return tolerance * np.array(CIRCLES, np.float32)[np.clip(periods, 1, len(CIRCLES)) - 1]


def _copy(before: NDArray[Any], after: NDArray[Any], box: Rect, worker: int) -> None:  # noqa: ARG001  # any
    y0, y1, x0, x1 = box
    after[y0:y1, x0:x1] = before[y0:y1, x0:x1]
