"""Convergence on the CPU: where nothing moves, the image fades to the mean of its samples."""

from collections.abc import Mapping, Sequence
from functools import lru_cache, partial

import numpy as np
from numpy.typing import NDArray

from supersampler.backends.cpu.executor import Step
from supersampler.backends.cpu.frame_preprocess import ResampledFrame
from supersampler.backends.cpu.history import Plane
from supersampler.backends.cpu.kernel_loader import Call
from supersampler.backends.cpu.layout import LANES, PAD, RENDER_TILE, TILE
from supersampler.backends.cpu.memory import address, aligned
from supersampler.backends.cpu.resample_tables import MAX_PHASES, Filter, Kernel, gaussian, linear, up_to
from supersampler.backends.cpu.structs import (
    ConvergedOutput,
    MeanHistory,
    SampleTables,
    StillSamples,
    pack,
)
from supersampler.backends.cpu.threads import Rect, ThreadPool
from supersampler.backends.cpu.tiles import (
    Bool,
    dilated,
    runs_of,
    scaled,
    tiles_read_by,
    tiles_reading,
)
from supersampler.frame import Float32, Size
from supersampler.methods.convergence import SIGMA

_KERNELS = "backends.cpu.kernels"
CONVERGENCE_KERNELS = (
    f"{_KERNELS}.convergence.find_still",
    f"{_KERNELS}.convergence.prepare_still",
    f"{_KERNELS}.residuals.measure_residuals",
    f"{_KERNELS}.residuals.widen_openings",
    f"{_KERNELS}.convergence.add_samples",
)
CONVERGENCE_PLANES = {"still": Plane(("static_mean",), 4), "opening": Plane(("residual_range",), 4)}
"""The history of the mean, for a `HistoryLayout`."""
MEAN_FILTER = Filter(lambda distance: gaussian(SIGMA)(distance) * linear(distance), True)
"""Weight of a sample in the mean, of which all but the two samples around a pixel are 0."""
_RING = 51  # lines of scratch: see `kernels.residuals.measure_residuals`


class ConvergingFrame(ResampledFrame):
    """A resampled frame, and buffers for its samples in the mean; MEAN_FILTER is the last of the filters."""

    def __init__(
        self,
        render: Size,
        display: Size,
        filters: Sequence[Filter],
        threads: int,
        windows: Sequence[Kernel] = (),
    ) -> None:
        super().__init__(render, display, [*filters, MEAN_FILTER], threads, windows)
        w, h = self._size = render
        self._color, self._planes = aligned((h, 4, self.padded_width)), aligned((4, h, self.padded_width))
        self._learned_step = w * h / (display[0] * display[1])
        self.mean_filter = len(filters)
        self.rows_opened = aligned((h,))
        self.rings = [aligned((_RING, self.padded_width)) for _ in range(threads)]
        self.mean_lines = [aligned((4 * self.padded_width + 8 * LANES,)) for _ in range(threads)]
        self.columns = np.minimum(np.arange(up_to(display[0], LANES)), display[0] - 1).astype(np.int32)
        self.still_tiles = np.zeros((-(-h // RENDER_TILE), -(-w // RENDER_TILE)), np.uint8)
        self.sample_tables = lru_cache(MAX_PHASES)(partial(_sample_tables, render, display))

    def still_samples(self, step: Step) -> StillSamples:
        """Return the buffers in the form that kernels take."""
        (w, h), (moving, moving_2x2, opens, opened) = self._size, self._planes
        counts = float(step.adds_samples and step.frame.jitter != step.history.jitter)
        return StillSamples(
            self._color, moving, moving_2x2, opens, opened, self.rows_opened, step.inputs.reactive,
            step.inputs.has_reactive, w, h, self.padded_width, step.inputs.exposure,
            self._learned_step * counts, counts,
        )  # fmt: skip


class Convergence:
    """Adds a frame's samples to the mean where nothing moves, and fades the image to it.

    `CpuHistory.means` and `CpuHistory.ranges` mark the tiles that have a mean, and a range of residuals. All
    others hold zeros in the history already, so that a frame in which all moves writes nothing.

    Args:
        kernels: CONVERGENCE_KERNELS, among others.
        pool: threads that compute.
    """

    def __init__(self, kernels: Mapping[str, Call], pool: ThreadPool) -> None:
        self._pool = pool
        self._find, self._prepare, self._measure, self._widen, self._add = (
            kernels[name] for name in CONVERGENCE_KERNELS
        )

    def run(self, step: Step, view: ConvergingFrame) -> None:
        """Write the image and the next history of the mean."""
        height, width = step.output.image.shape[:2]
        display, render = (width, height), step.frame.size
        still, still_2x2 = self._find_still(view)
        history, following = step.history, step.next_history
        marked = [history.means, history.ranges, following.means, following.ranges]
        if step.adds_samples:
            marked.append(still_2x2)
        if not any(tiles.any() for tiles in marked):
            _clear_converged(step, step.tiles.computed)
            return
        means = tiles_reading(still_2x2, display, render) & step.tiles.computed
        # where a mean ends in this frame, samples are compared once more
        read = tiles_read_by(means | (step.history.means & step.tiles.computed), display, render)
        ranges = still & read
        self._keep_unwritten(step, means, ranges, still)
        _clear_converged(step, step.tiles.computed & ~means)
        if ranges.any():
            self._prepare_samples(step, view, scaled(runs_of(read | dilated(ranges, 1)), RENDER_TILE, render))
            self._compare(step, view, scaled(runs_of(ranges), RENDER_TILE, render))
            self._add_samples(step, view, scaled(runs_of(means), TILE, display))

    def _find_still(self, view: ConvergingFrame) -> tuple[Bool, Bool]:
        """Return the tiles of the frame with samples that do not move, and those with 2x2 of them."""
        found = view.still_tiles
        if view.samples.still_rows.any():  # one thread: a tile is found in its first row, mostly
            self._find(pack(view.samples), address(found))
        else:
            found[:] = 0
        return found > 0, found > 1

    def _keep_unwritten(self, step: Step, means: Bool, ranges: Bool, still: Bool) -> None:
        """Write the next history of tiles that later passes do not write: zeros, or a copy of the history.

        Tiles that later passes write are marked here already, in case the step is interrupted.
        """
        history, following, computed = step.history, step.next_history, step.tiles.computed
        _clear(following.arrays["still"], following.means & computed & ~means, TILE)
        following.means = np.where(computed, means, history.means | following.means)
        before, after = history.arrays["opening"], following.arrays["opening"]
        kept = np.zeros_like(still)
        if _same_size(step) and not step.tiles.all:
            size = (step.output.image.shape[1], step.output.image.shape[0]), step.frame.size
            kept = still & history.ranges & ~tiles_read_by(computed, *size)
        _clear(after, following.ranges & ~ranges & ~kept, RENDER_TILE)
        following.ranges = ranges | kept

        def copy(box: Rect, _: int) -> None:
            columns = slice(PAD + box.x0, PAD + box.x1)
            after[box.y0 : box.y1, columns] = before[box.y0 : box.y1, columns]

        boxes = scaled(runs_of(kept), RENDER_TILE, step.frame.size)
        self._pool.run_rects("converge", boxes, copy)

    def _prepare_samples(self, step: Step, view: ConvergingFrame, boxes: list[Rect]) -> None:
        """Fill what is read of the samples; see `prepare_still`."""
        inputs = (
            address(step.inputs.color),
            pack(view.samples),
            pack(view.still_samples(step)),
        )
        self._pool.run_rects("converge", boxes, lambda box, _: self._prepare(*inputs, *box))

    def _compare(self, step: Step, view: ConvergingFrame, boxes: list[Rect]) -> None:
        """Compare the samples with the mean; see `measure_residuals`."""
        still, tables = (
            pack(view.still_samples(step)),
            pack(view.sample_tables(step.frame.jitter)),
        )
        history, opening = pack(self._history(step)), address(step.next_history.arrays["opening"])
        scratch = [address(ring) for ring in view.rings]
        view.rows_opened[:] = 0.0
        self._pool.run_rects(
            "converge",
            boxes,
            lambda box, worker: self._measure(history, still, tables, opening, scratch[worker], *box),
        )
        if view.rows_opened.any():
            rows = view.samples.height
            self._pool.run_rows("converge", rows, lambda y0, y1, _: self._widen(still, y0, y1))

    def _add_samples(self, step: Step, view: ConvergingFrame, boxes: list[Rect]) -> None:
        """Add the samples to the mean, and fade the image; see `add_samples`."""
        height, width = step.output.image.shape[:2]
        still = pack(view.still_samples(step))
        converged = np.zeros(1, np.float32) if step.converged is None else step.converged
        output = pack(
            ConvergedOutput(
                step.next_history.arrays["still"], step.output.image, converged,
                int(step.converged is not None), int(view.rows_opened.any()), view.columns, view.mean_filter,
                width, height, len(view.columns),
            )
        )  # fmt: skip
        history, tables = pack(self._history(step)), pack(view.current_tables())
        lines = [address(line) for line in view.mean_lines]
        self._pool.run_rects(
            "converge",
            boxes,
            lambda box, worker: self._add(history, still, tables, lines[worker], output, *box),
        )

    @staticmethod
    def _history(step: Step) -> MeanHistory:
        arrays = step.history.arrays
        return MeanHistory(
            arrays["still"], arrays["opening"], step.output.image.shape[1], int(_same_size(step))
        )


def _same_size(step: Step) -> bool:
    return step.history.render == step.frame.size


def _clear_converged(step: Step, tiles: Bool) -> None:
    if step.converged is not None:
        height, width = step.output.image.shape[:2]
        for y0, y1, x0, x1 in scaled(runs_of(tiles), TILE, (width, height)):
            step.converged[..., y0:y1, x0:x1] = 0.0


def _clear(plane: NDArray[np.float32], tiles: Bool, side: int) -> None:
    """Zero tiles of a plane; rows of PREVIOUS size are padded, and cleared with their neighbours' padding."""
    if tiles.any():
        first = PAD if side == RENDER_TILE else 0
        for y0, y1, x0, x1 in runs_of(tiles):
            plane[y0 * side : y1 * side, first + x0 * side : first + x1 * side] = 0.0


def _sample_tables(render: Size, display: Size, jitter: tuple[float, float]) -> SampleTables:
    """Return the display pixels around the samples, with the float32 arithmetic of the torch module."""
    columns, column_weights = _pixels_around(render[0], display[0], jitter[0])
    rows, row_weights = _pixels_around(render[1], display[1], jitter[1])
    pitch = up_to(render[0], LANES)
    padded, padded_weights = aligned((2, pitch), np.int32), aligned((2, pitch))
    padded[:, : render[0]], padded_weights[:, : render[0]] = columns, column_weights
    return SampleTables(
        padded, padded_weights, np.ascontiguousarray(rows.T), np.ascontiguousarray(row_weights.T), pitch
    )


def _pixels_around(render: int, display: int, jitter: float) -> tuple[NDArray[np.int32], Float32]:
    """Return the two pixels around each sample of an axis and their weights, (2, render) each."""
    half = np.float32(0.5)
    position = (np.arange(render, dtype=np.float32) + half + np.float32(jitter)) * np.float32(display)
    position = position / np.float32(render) - half
    pixels = np.floor(position) + np.arange(2, dtype=np.float32)[:, None]
    return np.clip(pixels, 0, display - 1).astype(np.int32), linear(pixels - position)
