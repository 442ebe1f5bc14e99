"""Static-tile reuse: where nothing changes, an image fades to the mean of its samples, and is then copied."""

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from supersampler.arguments import ACCUMULATE
from supersampler.backends.cpu.kernel_loader import Call
from supersampler.backends.cpu.layout import LANES, PAD, RENDER_TILE, STATIC_TILE, SUM_VALUES, TILE
from supersampler.backends.cpu.memory import address, aligned
from supersampler.backends.cpu.noisy_tile_reuse import NoisyTileReuse
from supersampler.backends.cpu.static_tiles import Jitter, StaticTiles, Sums, mostly
from supersampler.backends.cpu.static_weights import StaticAxis, StaticWeights
from supersampler.backends.cpu.structs import AddedSamples, AxisSamples, FrameInputs, MeanErrors, pack
from supersampler.backends.cpu.threads import Rect, ThreadPool
from supersampler.backends.cpu.tile_state import (
    MOVING,
    RESTING,
    SETTLING,
    TileState,
    next_generation,
)
from supersampler.backends.cpu.tiles import Bool, Tiles, runs_of, scaled, static_tiles_in, tiles_with
from supersampler.conventions.jitter import jitter_phase_count
from supersampler.frame import Float32, Size
from supersampler.methods.convergence import LEARNED, MARGIN, UNBOUNDED

_KERNELS = "backends.cpu.kernels"
TILE_REUSE_KERNELS = (
    f"{_KERNELS}.tile_reuse.fingerprints",
    f"{_KERNELS}.tile_reuse.copy_colors",
    f"{_KERNELS}.sample_sums.add_samples",
    f"{_KERNELS}.sample_sums.mean_errors",
    f"{_KERNELS}.sample_sums.fade_to_means",
)
_KEEP, _ADD = 1, 2  # as in `kernels.sample_sums`

UNSEEN_RESIDUALS = np.float32(0.25)
"""Widening of the range of a method's residuals, as a part of it, when a tile begins to settle."""


class TileReuse:
    """Decides which tiles a step computes, and makes the others from the samples and the previous image.

    Args:
        kernels: TILE_REUSE_KERNELS, among others.
        pool: threads that compute.
    """

    def __init__(self, kernels: Mapping[str, Call], pool: ThreadPool) -> None:
        self._pool = pool
        self._noisy = NoisyTileReuse(pool)
        self._fingerprint, self._copy_colors, self._add, self._errors, self._fade = (
            kernels[name] for name in TILE_REUSE_KERNELS
        )

    @staticmethod
    def most_bytes(display: Size, render: Size) -> int:
        """Return the bytes that two histories come to hold when the whole scene stands still."""
        phases = jitter_phase_count(display[0] / render[0])
        tiles = -(-render[0] // RENDER_TILE) * -(-render[1] // RENDER_TILE)
        return (
            2 * display[0] * display[1] * SUM_VALUES * 4 + phases * (2 * tiles + display[0] + display[1]) * 8
        )

    def begin(
        self,
        planes: FrameInputs,
        jitter: Jitter,
        previous: TileState,
        current: TileState,
        *,
        tolerance: float | None,
    ) -> Tiles:
        """Choose the tiles to compute, and mark them as not yet valid in `current`.

        Args:
            planes: the frame, with the exposure of the previous one; 0 without one.
            jitter: of the frame.
            previous: state of the history.
            current: state of the next history.
            tolerance: see `end`.
        """
        current.forget()
        if tolerance == ACCUMULATE:
            self._noisy.follow(planes, jitter, previous, current)
        else:
            current.noise = None
        if tolerance is not None and tolerance != ACCUMULATE:
            render = planes.depth.shape[1], planes.depth.shape[0]
            before = previous.static_tiles
            if before is None or before.render != render:  # no tile of it is a tile of this frame
                before, previous = StaticTiles.empty(render), TileState(current.display)
            current.follow(previous, before.after(jitter, partial(self._fingerprints, planes)), jitter)
        required = np.ones(current.work.shape, bool)
        if current.active:
            required = tiles_with(current.records["state"] == MOVING, current.display)
            if mostly(required):
                required[:] = True
        tiles = Tiles(required)
        if tiles.all:  # mostly
            current.generations[:] = next_generation()
        else:
            computed = static_tiles_in(tiles.computed, current.generations.shape)
            current.generations[computed] = next_generation()
        current.work = tiles.work()
        return tiles

    def end(
        self,
        planes: FrameInputs,
        jitter: Jitter,
        previous: TileState,
        current: TileState,
        before: Sequence[tuple[int, NDArray[Any]]],
        after: Sequence[tuple[int, NDArray[Any]]],
        mean: tuple[Float32 | None, Float32 | None],
        image: Float32,
        *,
        tolerance: float | None,
    ) -> None:
        """Write the tiles that are reused, add up samples, and let computed tiles settle.

        Args:
            planes: the frame, with its exposure.
            jitter: of the frame.
            previous: state of the history.
            current: state of the next history.
            before: arrays of the history that tiles divide: pixels of a tile's side, and (H, W, ...); the
                first array has linear RGB in its first channels.
            after: likewise of the next history.
            mean: of the method in the next history: "still", (H, W, 4), and "opening", (h, PAD + w + PAD, 4);
                None for a method without a mean.
            image: (H, W, 3), written to.
            tolerance: estimated root mean square error of a mean, of toned colors, up to which a tile settles
                before its period is whole. ACCUMULATE: noise does not matter. None: no tile is reused.
        """
        if tolerance is None or not current.active:
            return
        still, opening = mean
        accumulates = tolerance == ACCUMULATE
        if accumulates:
            self._noisy.add(planes, jitter, previous, current)
        else:
            self._add_samples(planes.color, jitter, previous, current)
        state = current.records["state"]
        if (state != MOVING).any():
            self._copy_history(state != MOVING, previous, current, before, after)
            self._write_image(previous, current, after[0][1], still, image)
        if accumulates:
            return
        moved = state == MOVING
        current.settle(self._mean_errors(current, planes.exposure), tolerance)
        begins = moved & (current.records["state"] == SETTLING)
        self._keep_shown(begins, after[0][1], image)
        if opening is not None:
            _end_learning(begins, opening, planes.depth.shape, current.display)

    def _keep_shown(self, tiles: Bool, pixels: NDArray[Any], image: Float32) -> None:
        """Let tiles that begin to settle fade from the image, which may be the method's own mean."""
        if tiles.any():
            boxes = scaled(runs_of(tiles), STATIC_TILE, (image.shape[1], image.shape[0]))
            self._pool.run_rects("skip", boxes, partial(_copy, image, pixels[..., :3]))

    def _copy_history(
        self,
        reused: Bool,
        previous: TileState,
        current: TileState,
        before: Sequence[tuple[int, NDArray[Any]]],
        after: Sequence[tuple[int, NDArray[Any]]],
    ) -> None:
        stale = reused & (current.generations != previous.generations)
        runs = runs_of(stale) if stale.any() else []
        for (unit, source), (_, target) in zip(before, after, strict=True):
            boxes = scaled(runs, unit * STATIC_TILE // TILE, (source.shape[1], source.shape[0]))
            self._pool.run_rects("skip", boxes, partial(_copy, source, target))
        current.generations[reused] = previous.generations[reused]

    def _write_image(
        self,
        previous: TileState,
        current: TileState,
        pixels: NDArray[Any],
        still: Float32 | None,
        image: Float32,
    ) -> None:
        """Copy resting tiles to the image; fade settling ones, in the next history, too."""
        height, width, channels = pixels.shape
        state, size = current.records["state"], (width, height)
        resting, settling = state == RESTING, state == SETTLING
        if resting.any():
            arguments = address(pixels), channels, width
            boxes = scaled(runs_of(resting), STATIC_TILE, size)
            self._pool.run_rects(
                "skip", boxes, lambda box, _: self._copy_colors(*arguments, *box, address(image))
            )
        if settling.any():
            current.generations[settling] = next_generation()
            parts = np.where(settling, current.fade_parts(previous), np.float32(0.0))
            sums = current.allocated_sums() if current.noise is None else current.noise.sums
            inputs = address(sums), address(parts), *size, channels
            means = image if still is None else still
            outputs = address(pixels), address(image), address(means), int(still is not None)
            self._pool.run_rects(
                "skip", runs_of(settling), lambda box, _: self._fade(*inputs, *box, *outputs)
            )

    def _add_samples(self, color: Float32, jitter: Jitter, previous: TileState, current: TileState) -> None:
        """Make the sums of all tiles that have samples those after this frame."""
        weights, added, counts = current.weights, current.added, current.records["count"]
        if weights is None or not counts.any():
            return
        kept = (counts > added) & (added | (current.sum_generations != previous.sum_generations))
        modes = (_KEEP * kept + _ADD * added).astype(np.uint8)
        if not modes.any():
            return
        current.sum_generations[modes > 0] = next_generation()
        sums = current.allocated_sums()
        samples = _added_samples(
            modes, sums if previous.sums is None else previous.sums, sums, color, weights, jitter
        )
        inputs = pack(samples)
        self._pool.run_rects("skip", runs_of(modes > 0), lambda box, _: self._add(inputs, *box))
        copied = kept & ~added
        current.sum_generations[copied] = previous.sum_generations[copied]

    def _mean_errors(self, current: TileState, exposure: float) -> Float32:
        """Return the estimated errors of means, (rows, columns); large where there are too few samples."""
        weights, records = current.weights, current.records
        errors = np.full(records.shape, np.inf, np.float32)
        if weights is None:
            return errors
        counts = records["count"]
        enough = (counts * weights.per_pixel >= current.least_samples) & (counts < weights.frames)
        known = enough & (records["state"] == MOVING) & (records["matched"] > 0)
        for count in np.unique(counts[known]).tolist():
            # no sample of a period is chosen twice
            share = (1.0 - count / weights.frames) / (count * weights.per_pixel - 1.0)
            sums = current.allocated_sums()
            inputs = pack(MeanErrors(sums, errors, sums.shape[1], sums.shape[0], share, exposure))
            self._pool.run_rects(
                "skip", runs_of(known & (counts == count)), partial(self._write_errors, inputs)
            )
        return np.sqrt(errors)

    def _write_errors(self, inputs: bytes, box: Rect, _: int) -> None:
        self._errors(inputs, *box)

    def _fingerprints(self, planes: FrameInputs, wanted: Bool, step: int) -> Sums:
        """See `static_tiles.ReadFingerprints`."""
        h, w = planes.depth.shape
        sums = np.zeros(wanted.shape, np.uint64)
        color, depth, motion = address(planes.color), address(planes.depth), address(planes.motion)
        scratch = aligned((self._pool.threads, LANES), np.int32)
        inputs = color, depth, motion, w, h, address(wanted), step

        def read(y0: int, y1: int, worker: int) -> None:
            self._fingerprint(*inputs, address(scratch[worker]), y0, y1, address(sums))

        self._pool.run_rows("skip", wanted.shape[0], read)
        return sums


def _added_samples(
    modes: NDArray[np.uint8],
    sums_before: Float32,
    sums: Float32,
    color: Float32,
    weights: StaticWeights,
    jitter: Jitter,
) -> AddedSamples:
    phase = weights.phase(jitter) or 0

    def of_frame(axis: StaticAxis) -> AxisSamples:
        return AxisSamples(axis.sample[phase], axis.kind)

    table = weights.table[phase]
    return AddedSamples(
        modes, sums_before, sums, color, of_frame(weights.rows), of_frame(weights.columns),
        table, table.shape[1], color.shape[1], sums.shape[1], sums.shape[0],
    )  # fmt: skip


def _end_learning(tiles: Bool, opening: Float32, frame: tuple[int, ...], display: Size) -> None:
    """Let the method compare with a whole range of residuals once these tiles move again.

    It has learned them for less than a period, so that samples may differ a little more.
    """
    for y0, y1, x0, x1 in scaled(runs_of(tiles), STATIC_TILE, display) if tiles.any() else ():
        (top, bottom), (left, right) = (
            (first * size // full, -(-last * size // full))
            for first, last, size, full in ((y0, y1, frame[0], display[1]), (x0, x1, frame[1], display[0]))
        )
        low, high, learned = np.moveaxis(opening[top:bottom, PAD + left : PAD + right], -1, 0)[:3]
        known = (learned > 0.0) & (high - low < UNBOUNDED)
        more = UNSEEN_RESIDUALS * (high - low) + MARGIN
        low[:], high[:] = np.where(known, low - more, 0.0), np.where(known, high + more, 0.0)
        learned[:] = np.where(known, LEARNED, 0.0)


def _copy(source: NDArray[Any], target: NDArray[Any], box: Rect, worker: int) -> None:  # noqa: ARG001  # any
    y0, y1, x0, x1 = box
    target[y0:y1, x0:x1] = source[y0:y1, x0:x1]
