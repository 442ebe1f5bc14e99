"""Static-tile reuse: where a scene stands still, a step copies tiles of the image and computes the rest."""

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from supersampler.backends.cpu.kernel_loader import Call
from supersampler.backends.cpu.layout import RENDER_TILE, TILE
from supersampler.backends.cpu.memory import address
from supersampler.backends.cpu.static_tiles import Jitter, Sums
from supersampler.backends.cpu.structs import FrameInputs, TileComparison, pack
from supersampler.backends.cpu.threads import Rect, ThreadPool
from supersampler.backends.cpu.tile_state import Pending, ReferenceTiles, TileState, next_generation
from supersampler.backends.cpu.tiles import Tiles, runs_of, scaled, tiles_reading
from supersampler.conventions.jitter import jitter_phase_count
from supersampler.frame import Float32, Size

_KERNELS = "backends.cpu.kernels.tile_reuse"
TILE_REUSE_KERNELS = (
    f"{_KERNELS}.fingerprints",
    f"{_KERNELS}.copy_colors",
    f"{_KERNELS}.compare_tiles",
)
LEAST_SHARE = 0.1
"""Share of reusable tiles below which reuse saves no time."""
SETTLE_FRAMES = 16
"""Least number of frames between two comparisons of a tile, also with short or constant jitter."""
TOLERANCE_GROWTH = 1.0, 4.0, 8.0
"""The tolerance grows by these factors in the first, the second and all further jitter periods."""

_FACTORS = np.array([pow(0x9E3779B97F4A7C15, k, 2**64) for k in range(1, 9)], np.uint64)


class TileReuse:
    """Decides which tiles a step computes, and copies the others.

    Args:
        kernels: TILE_REUSE_KERNELS, among others.
        pool: threads that compute.
    """

    def __init__(self, kernels: Mapping[str, Call], pool: ThreadPool) -> None:
        self._pool = pool
        self._fingerprint, self._copy_colors, self._compare = (kernels[name] for name in TILE_REUSE_KERNELS)

    @staticmethod
    def most_bytes(display: Size, render: Size) -> int:
        """Return the bytes that a history comes to hold when the whole scene stands still."""
        phases = jitter_phase_count(display[0] / render[0])
        tiles = -(-render[0] // RENDER_TILE) * -(-render[1] // RENDER_TILE)
        return display[0] * display[1] * 3 * 4 + phases * tiles * 8

    def begin(
        self,
        planes: FrameInputs,
        jitter: Jitter,
        display: Size,
        previous: TileState,
        current: TileState,
        *,
        skips: bool,
    ) -> Tiles:
        """Choose the tiles to compute, and mark them as not yet valid in `current`.

        Args:
            planes: the frame.
            jitter: of the frame.
            display: size of the image.
            previous: state of the history.
            current: state of the next history.
            skips: whether tiles may be reused; else all are computed.
        """
        required = np.ones(previous.generations.shape, bool)
        current.forget()
        if skips:
            self._commit_reference(previous)
            static_tiles = previous.static_tiles.after(jitter, self._fingerprints(planes))
            same = np.zeros(required.shape, bool)
            if static_tiles.same is not None and static_tiles.same.any():
                same = ~tiles_reading(~static_tiles.same, display, planes.depth.shape[1::-1])
            current.follow(previous, static_tiles, same)
            if current.still.mean() >= LEAST_SHARE:
                required = ~current.still
        tiles = Tiles(required)
        current.generations[tiles.computed] = next_generation()
        current.work = tiles.work()
        return tiles

    def end(
        self,
        tiles: Tiles,
        previous: TileState,
        current: TileState,
        before: Sequence[tuple[int, NDArray[Any]]],
        after: Sequence[tuple[int, NDArray[Any]]],
        image: Float32,
        *,
        exposure: float,
        tolerance: float,
    ) -> None:
        """Copy the tiles that were not computed, and find computed tiles that no longer change.

        Args:
            tiles: that were computed.
            previous: state of the history.
            current: state of the next history.
            before: arrays of the history that tiles divide: pixels of a tile's side, and (H, W, ...); the
                first array has linear RGB in its first channels.
            after: likewise of the next history.
            image: (H, W, 3), written to.
            exposure: of the frame.
            tolerance: root mean square of the change of toned colors within one jitter period, up to which a
                tile counts as static.
        """
        self._settle(tiles, current, after[0][1], exposure, tolerance)
        if tiles.all:
            return
        stale = ~tiles.computed & (current.generations != previous.generations)
        if stale.any():
            runs = runs_of(stale)
            for (unit, source), (_, target) in zip(before, after, strict=True):
                boxes = scaled(runs, unit, (source.shape[1], source.shape[0]))
                self._pool.run_rects("skip", boxes, partial(_copy, source, target))
        current.generations[~tiles.computed] = previous.generations[~tiles.computed]
        pixels, (height, width) = before[0][1], image.shape[:2]
        arguments = address(pixels), pixels.shape[2], width
        boxes = scaled(runs_of(~tiles.computed), TILE, (width, height))
        self._pool.run_rects(
            "skip", boxes, lambda box, _: self._copy_colors(*arguments, *box, address(image))
        )

    def _settle(
        self, tiles: Tiles, current: TileState, pixels: NDArray[Any], exposure: float, tolerance: float
    ) -> None:
        """Once a jitter period, compare tiles with static samples; reuse those that did not change."""
        interval = current.static_tiles.period * -(-SETTLE_FRAMES // max(current.static_tiles.period, 1))
        if not interval:
            return
        due = tiles.computed & (current.matched > 0) & ((current.matched - 1) % interval == 0)
        if not due.any():
            return
        height, width = pixels.shape[:2]
        if current.reference is None:
            current.reference = ReferenceTiles(
                np.zeros((height, width, 3), np.float32), np.zeros(due.shape, np.int64)
            )
        changes = np.zeros(due.shape, np.float32)
        comparison = pack(
            TileComparison(
                pixels,
                current.reference.pixels,
                changes,
                pixels.shape[2],
                width,
                height,
                due.shape[1],
                exposure,
            )
        )
        self._pool.run_rects("skip", runs_of(due), lambda box, _: self._compare(comparison, *box))
        known = (current.reference_generations == current.reference.generations) & (
            current.matched > interval
        )
        allowed = allowed_change(tolerance, (current.matched - 1) // interval)
        current.still |= due & known & (changes <= allowed * allowed)
        current.reference_generations[due] = next_generation()
        current.pending = Pending(due, pixels)

    def _commit_reference(self, previous: TileState) -> None:
        """Copy pending tiles to the reference that all histories share.

        An interrupted step may repeat it: the second time changes nothing.
        """
        if previous.pending is None or previous.reference is None:
            return
        tiles, image = previous.pending
        height, width = image.shape[:2]
        arguments, to = (address(image), image.shape[2], width), address(previous.reference.pixels)
        previous.reference.generations[tiles] = 0  # other histories must not rely on these tiles any more
        boxes = scaled(runs_of(tiles), TILE, (width, height))
        self._pool.run_rects("skip", boxes, lambda box, _: self._copy_colors(*arguments, *box, to))
        previous.reference.generations[tiles] = previous.reference_generations[tiles]

    def _fingerprints(self, planes: FrameInputs) -> Sums:
        h, w = planes.depth.shape
        rows, columns = -(-h // RENDER_TILE), -(-w // RENDER_TILE)
        words = np.empty((rows, columns, 8), np.uint64)
        color, depth, motion = address(planes.color), address(planes.depth), address(planes.motion)
        inputs = color, depth, motion, motion, w, h
        self._pool.run_rows(
            "skip", rows, lambda y0, y1, _: self._fingerprint(*inputs, y0, y1, address(words))
        )
        return np.asarray(words @ _FACTORS)


def allowed_change(tolerance: float, periods: NDArray[np.int32]) -> Float32:
    """Return the change of tiles within one jitter period up to which they count as static.

    The tolerance grows in later periods, because the remaining change is periodic.

    Args:
        tolerance: in the first period.
        periods: since the first comparison of each tile; the first is 1.
    """
    return tolerance * np.array(TOLERANCE_GROWTH, np.float32)[np.clip(periods, 1, len(TOLERANCE_GROWTH)) - 1]


def _copy(source: NDArray[Any], target: NDArray[Any], box: Rect, worker: int) -> None:  # noqa: ARG001  # any
    y0, y1, x0, x1 = box
    target[y0:y1, x0:x1] = source[y0:y1, x0:x1]
