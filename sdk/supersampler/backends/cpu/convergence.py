"""Convergence on the CPU: where nothing moves, the image fades to the mean of its samples."""

from collections.abc import Mapping
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from supersampler.backends.cpu.history import CpuHistory, Plane
from supersampler.backends.cpu.kernel_loader import Call
from supersampler.backends.cpu.layout import LANES, PAD, RENDER_TILE, TILE
from supersampler.backends.cpu.memory import address, aligned
from supersampler.backends.cpu.resample_tables import MAX_PHASES, Filter, gaussian, linear, up_to
from supersampler.backends.cpu.structs import (
    ConvergedOutput,
    FrameInputs,
    FrameSamples,
    MeanHistory,
    ResampleTables,
    SampleTables,
    StillSamples,
    pack,
)
from supersampler.backends.cpu.threads import Rect, ThreadPool
from supersampler.backends.cpu.tiles import (
    Bool,
    Tiles,
    dilated,
    runs_of,
    scaled,
    tiles_read_by,
    tiles_reading,
)
from supersampler.frame import Float32, Size
from supersampler.methods.stillness import SIGMA

_KERNELS = "backends.cpu.kernels.convergence"
CONVERGENCE_KERNELS = (
    f"{_KERNELS}.find_still",
    f"{_KERNELS}.prepare_still",
    f"{_KERNELS}.measure_residuals",
    f"{_KERNELS}.widen_openings",
    f"{_KERNELS}.add_samples",
)
CONVERGENCE_PLANES = {"still": Plane(("still",), 4), "opening": Plane(("opening",), 4)}
"""The history of the mean, for a `HistoryLayout`."""
MEAN_FILTER = Filter(lambda distance: gaussian(SIGMA)(distance) * linear(distance), True)
"""Weight of a sample in the mean, of which all but the two samples around a pixel are 0."""
_RING = 28  # lines of scratch: see `kernels.convergence.measure_residuals`


class ConvergenceSpace:
    """Buffers for frames of one size."""

    def __init__(self, render: Size, display: Size, threads: int) -> None:
        w, h = render
        pitch = self.padded_width = up_to(w, LANES) + 2 * PAD
        self.color = aligned((h, 4, pitch))
        self.planes = aligned((4, h, pitch))
        self.rows_opened = aligned((h,))
        self.scratch = [aligned((_RING, pitch)) for _ in range(threads)]
        self.lines = [aligned((4 * pitch + 8 * LANES,)) for _ in range(threads)]
        self.columns = np.minimum(np.arange(up_to(display[0], LANES)), display[0] - 1).astype(np.int32)
        self.still_tiles = np.zeros((-(-h // RENDER_TILE), -(-w // RENDER_TILE)), np.uint8)
        self.tables = lru_cache(MAX_PHASES)(lambda jitter: _sample_tables(render, display, jitter))

    def samples(self, step: "ConvergenceStep") -> StillSamples:
        """Return the buffers in the form that kernels take."""
        width, height, pixels = step.samples.width, step.samples.height, step.image.size // 3
        return StillSamples(
            self.color, *self.planes, self.rows_opened, width, height, self.padded_width,
            step.inputs.exposure, width * height / pixels,
        )  # fmt: skip


class ConvergenceStep(NamedTuple):
    """What a step hands over once the method's image is there.

    Attributes:
        inputs: the frame, with its exposure.
        samples: of the frame, preprocessed.
        tables: resampling tables of the frame; MEAN_FILTER is the last filter.
        jitter: of the frame.
        history: the previous one.
        next_history: the next one.
        tiles: that were computed.
        image: (H, W, 3), changed in place.
        converged: (1, 1, H, pitch) to fill with the fraction of the mean; None where it is not wanted.
    """

    inputs: FrameInputs
    samples: FrameSamples
    tables: ResampleTables
    jitter: tuple[float, float]
    history: CpuHistory
    next_history: CpuHistory
    tiles: Tiles
    image: Float32
    converged: Float32 | None


class Convergence:
    """Adds a frame's samples to the mean where nothing moves, and fades the image to it.

    Tiles of the display or of the frame that have no mean, or no range of residuals, hold zeros in the history;
    `CpuHistory.means` and `CpuHistory.ranges` say which do not, so that frames that move cost no memory.

    Args:
        kernels: CONVERGENCE_KERNELS, among others.
        pool: threads that compute.
    """

    def __init__(self, kernels: Mapping[str, Call], pool: ThreadPool) -> None:
        self._pool = pool
        self._find, self._prepare, self._measure, self._widen, self._add = (
            kernels[name] for name in CONVERGENCE_KERNELS
        )

    def run(self, step: ConvergenceStep, space: ConvergenceSpace) -> None:
        """Write the image and the next history of the mean."""
        height, width = step.image.shape[:2]
        display, render = (width, height), (step.samples.width, step.samples.height)
        still = self._find_still(step, space)
        means = tiles_reading(still, display, render) & step.tiles.computed
        read = tiles_read_by(means, display, render)
        ranges = still if step.tiles.all else still & read
        self._leave(step, means, still, ranges)
        if step.converged is not None:
            for y0, y1, x0, x1 in scaled(runs_of(step.tiles.computed & ~means), TILE, display):
                step.converged[..., y0:y1, x0:x1] = 0.0
        if means.any():
            self._prepare_samples(
                step, space, scaled(runs_of(read | dilated(ranges, 1)), RENDER_TILE, render)
            )
            self._compare(step, space, scaled(runs_of(ranges), RENDER_TILE, render))
            self._add_samples(step, space, scaled(runs_of(means), TILE, display))

    def _find_still(self, step: ConvergenceStep, space: ConvergenceSpace) -> Bool:
        samples, found = pack(step.samples), address(space.still_tiles)
        rows = space.still_tiles.shape[0]
        self._pool.run_rows("converge", rows, lambda y0, y1, _: self._find(samples, found, y0, y1))
        return space.still_tiles > 0

    def _leave(self, step: ConvergenceStep, means: Bool, still: Bool, ranges: Bool) -> None:
        """Make the next history of tiles that are not written here: zeros, or that of reused tiles.

        Tiles that will be written count as not zero from here on, should the step be interrupted.
        """
        history, following, computed = step.history, step.next_history, step.tiles.computed
        _clear(following.arrays["still"], following.means & computed & ~means, TILE)
        following.means = np.where(computed, means, history.means | following.means)
        before, after = history.arrays["opening"], following.arrays["opening"]
        kept = still & ~ranges & history.ranges if _same_size(step) else np.zeros_like(still)
        _clear(after, following.ranges & ~ranges & ~kept, RENDER_TILE)
        following.ranges = ranges | kept

        def copy(box: Rect, _: int) -> None:
            columns = slice(PAD + box.x0, PAD + box.x1)
            after[box.y0 : box.y1, columns] = before[box.y0 : box.y1, columns]

        boxes = scaled(runs_of(kept), RENDER_TILE, (step.samples.width, step.samples.height))
        self._pool.run_rects("converge", boxes, copy)

    def _prepare_samples(self, step: ConvergenceStep, space: ConvergenceSpace, boxes: list[Rect]) -> None:
        """Fill what is read of the samples; see `prepare_still`."""
        inputs = address(step.inputs.color), pack(step.samples), pack(space.samples(step))
        self._pool.run_rects("converge", boxes, lambda box, _: self._prepare(*inputs, *box))

    def _compare(self, step: ConvergenceStep, space: ConvergenceSpace, boxes: list[Rect]) -> None:
        """Compare the samples with the mean; see `measure_residuals`."""
        still, tables = pack(space.samples(step)), pack(space.tables(step.jitter))
        history, opening = pack(self._history(step)), address(step.next_history.arrays["opening"])
        scratch = [address(ring) for ring in space.scratch]
        space.rows_opened[:] = 0.0
        self._pool.run_rects(
            "converge",
            boxes,
            lambda box, worker: self._measure(history, still, tables, opening, scratch[worker], *box),
        )
        if space.rows_opened.any():
            rows = step.samples.height
            self._pool.run_rows("converge", rows, lambda y0, y1, _: self._widen(still, y0, y1))

    def _add_samples(self, step: ConvergenceStep, space: ConvergenceSpace, boxes: list[Rect]) -> None:
        """Add the samples to the mean, and fade the image; see `add_samples`."""
        height, width = step.image.shape[:2]
        still = pack(space.samples(step))
        converged = np.zeros(1, np.float32) if step.converged is None else step.converged
        output = pack(
            ConvergedOutput(
                step.next_history.arrays["still"], step.image, converged, int(step.converged is not None),
                int(space.rows_opened.any()), space.columns, len(step.tables.row_weights) - 1,
                width, height, len(space.columns),
            )
        )  # fmt: skip
        history, tables = pack(self._history(step)), pack(step.tables)
        lines = [address(line) for line in space.lines]
        self._pool.run_rects(
            "converge",
            boxes,
            lambda box, worker: self._add(history, still, tables, lines[worker], output, *box),
        )

    @staticmethod
    def _history(step: ConvergenceStep) -> MeanHistory:
        arrays = step.history.arrays
        return MeanHistory(arrays["still"], arrays["opening"], step.image.shape[1], int(_same_size(step)))


def _same_size(step: ConvergenceStep) -> bool:
    return step.history.render == (step.samples.width, step.samples.height)


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
