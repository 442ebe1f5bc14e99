"""CPU backend of `taau`, temporal upsampling without a network."""

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from supersampler.backends.cpu.at_rest import (
    StaticBlocks,
    blocks_at,
    nearest_pixels,
    spread,
    windowed,
    windows_around,
)
from supersampler.backends.cpu.executor import CpuExecutor, Step
from supersampler.backends.cpu.frame_preprocess import READ_KERNELS, ResampledFrame
from supersampler.backends.cpu.history import HistoryLayout, Plane
from supersampler.backends.cpu.layout import LANES, TAAU_PIXEL, TILE
from supersampler.backends.cpu.memory import address, aligned
from supersampler.backends.cpu.resample_tables import Filter, catmull_rom, gaussian, line_filters, up_to
from supersampler.backends.cpu.structs import NO_MASK, Floats, Words, pack
from supersampler.backends.cpu.threads import Rect, ThreadPool
from supersampler.backends.cpu.tiles import Bool
from supersampler.frame import Float32, Size
from supersampler.methods.at_rest import BLOCK, DARK, WINDOWS, block_count
from supersampler.methods.model_info import ModelInfo
from supersampler.methods.spec import constants_array
from supersampler.methods.taau.spec import (
    FLASH,
    FLASH_MEMORY,
    LAG_STEP,
    LEAST_BLOCKS,
    LEAST_FLASH,
    MOST_SAMPLES,
    TAAU,
)


class TaauHistoryInput(NamedTuple):
    """The history that the kernels read.

    Attributes:
        pixels: (display height, display width, TAAU_PIXEL).
        surface: (height, pitch, 4) of the previous frame, see the kernel `shade`.
        pitch: samples from row to row: PAD + stride + PAD.
        kept: (blocks down, `kept_pitch`) number of samples that are kept, by column of the display.
        kept_rows: (display height,) row of `kept`.
        has_kept: 1 where `kept` has numbers, else 0.
    """

    pixels: Floats
    surface: Floats
    pitch: int
    kept: Floats
    kept_rows: Words
    kept_pitch: int
    has_kept: int


class ComparedBlocks(NamedTuple):
    """Arguments of the kernel `compare_with_history`.

    Attributes:
        pixels: (display height, display width, TAAU_PIXEL) of the history.
        columns, rows: the pixel nearest to each column and row of samples.
        sums: (6, blocks down, `pitch`) RGB of the difference of samples and history, toned; of the history.
        across, pitch: blocks of a row; rounded up to whole vectors.
        down: rows of blocks.
        width: of the display.
        exposure: of this frame.
    """

    pixels: Floats
    columns: Words
    rows: Words
    sums: Floats
    across: int
    pitch: int
    down: int
    width: int
    exposure: float


class TaauScratch(NamedTuple):
    """Scratch of one thread: filtered rows; offsets and weights of the warp; warped and final pixels."""

    line: Floats
    slots: Words
    weights: Floats
    warped: Floats
    out: Floats


def compared_blocks(blocks: StaticBlocks) -> Bool:
    """Return the blocks that are compared with the history, (down, across)."""
    return ~blocks.moves & ~blocks.stays


def samples_kept(sums: Float32, blocks: StaticBlocks, config: Mapping[str, float]) -> Float32 | None:
    """Return the number of samples of the history that are kept, (down, across) blocks; None if all are.

    Args:
        sums: (6, down, across) by the kernel `compare_with_history`.
        blocks: static blocks of the frame.
        config: constants of the model.
    """
    free, side = compared_blocks(blocks), WINDOWS[1]
    rows, columns = windows_around(free)
    free = free[rows, columns]
    sums = sums[:, rows, columns]
    difference, level = sums.reshape(2, 3, *free.shape) / np.float32((BLOCK // LAG_STEP) ** 2)
    values = np.concatenate([difference, np.square(difference), level, free[None]]) * free
    down, across = free.shape
    sums = windowed(np.pad(values, ((0, 0), (0, -down % side), (0, -across % side))), side)
    count = sums[9]
    difference, square, level = sums[:9].reshape(3, 3, *count.shape) / np.maximum(count, 1.0)
    variance = np.maximum(square - np.square(difference), 0.0)
    error = np.sqrt(variance / np.maximum(count - 1.0, 1.0))
    lag = (np.abs(difference) - config["lag_deviations"] * error).max(axis=0)
    excess = lag / (level.max(axis=0) + DARK) - config["lag"]
    least = config["lag_samples"] / MOST_SAMPLES
    limited = (count >= LEAST_BLOCKS * side * side) & (excess > least)
    kept = np.where(limited, config["lag_samples"] / np.maximum(excess, least), MOST_SAMPLES)
    whole = np.full(blocks.stays.shape, MOST_SAMPLES, np.float32)
    whole[rows, columns] = np.where(free, spread(kept, side, free.shape), MOST_SAMPLES)
    return whole if (whole < MOST_SAMPLES).any() else None


KERNELS = "methods.taau.kernels"
STEP, COMPARE, SHADE = (f"{KERNELS}.{name}" for name in ("step_rows", "compare_with_history", "shade"))
LAYOUT = HistoryLayout(
    TAAU,
    {"pixels": Plane(("color", "samples"), TAAU_PIXEL), "surface": Plane(("surface",), 4)},
    glare="samples",
)


class _Space(ResampledFrame):
    """Buffers for frames of one size; `scratch` and `shade_lines` have one entry per thread."""

    def __init__(self, render: Size, display: Size, filters: Sequence[Filter], threads: int) -> None:
        super().__init__(render, display, filters, threads)
        self.shade_lines = aligned((threads, 4, self.padded_width))
        self.sums = aligned((render[1], 2))
        self.scratch = [
            TaauScratch(line, aligned((10, LANES), np.int32), aligned((10, LANES)), *aligned((2, LANES, 8)))
            for line in self.lines
        ]


class TaauCpu(CpuExecutor[_Space]):
    """Runs `taau`; see `Executor`.

    Args:
        info: the model.
        pool: the threads that run the kernels.
    """

    precision = "fp32"

    def __init__(self, info: ModelInfo, pool: ThreadPool) -> None:
        super().__init__(LAYOUT, pool, STEP, COMPARE, *READ_KERNELS, SHADE)
        self._config = c = info.config
        self._constants = constants_array(TAAU, c)
        mean, *line = (Filter(kernel, False) for kernel in line_filters(c["moment_sigma"]))
        self._filters = [
            Filter(gaussian(c["frame_sigma"]), False),
            Filter(catmull_rom, False),
            mean,
            Filter(gaussian(c["sample_sigma"]), True),
            *line,
        ]

    def _space(self, render: Size, display: Size) -> _Space:
        return _Space(render, display, self._filters, self.pool.threads)

    def _compute_tiles(self, step: Step, space: _Space) -> None:
        self._resample(step, space)
        self._write_surface(step, space)
        before = step.history.exposure
        change = abs(step.inputs.exposure / before) if before else 1.0
        self._write_light(step, space, change)
        self._blend(step, space, change)

    def _write_surface(self, step: Step, space: _Space) -> None:
        """Write the surface, for disocclusion and lighting tests of the next frame."""
        samples, surface = pack(space.samples), address(step.next_history.arrays["surface"])
        sums = address(space.sums)
        shade, lines = self.kernels[SHADE], [address(line) for line in space.shade_lines]
        self.pool.run_rows(
            "preprocess",
            space.samples.height,
            lambda y0, y1, worker: shade(samples, lines[worker], surface, sums, y0, y1),
        )

    def _write_light(self, step: Step, space: _Space, change: float) -> None:
        """Write `history.light`; same as `light_after` of the torch method."""
        mean, *contrasts, flashes = step.history.values["light"]
        slope = change / (1.0 + (change - 1.0) * mean) ** 2
        last, older = slope * slope * np.array(contrasts)
        (w, h), light = step.frame.size, step.next_history.values["light"]
        light[:2] = space.sums.sum(axis=0, dtype=np.float64) / (w * h)
        known = older if flashes > 0.0 else max(last, older)
        flash = known > 0.0 and flashes < 2.0 and light[1] > FLASH * known + LEAST_FLASH
        light[2:] = max(last, FLASH_MEMORY * older), flash * (flashes + 1.0)

    def _blend(self, step: Step, space: _Space, change: float) -> None:
        """Compute the image and the pixels of the next history."""
        history, flash = step.history, step.next_history.values["light"][3]
        glares = flash > 0.0 or step.next_history.glares or history.glares
        numbers = np.array(
            [*self._constants, step.inputs.exposure, *history.render, *history.jitter, change, glares, flash],
            np.float32,
        )
        pixels, surface = history.arrays["pixels"], history.arrays["surface"]
        kept = self._kept(step, space)  # alive until the kernels have run
        inputs = (
            pack(space.samples), address(step.next_history.arrays["surface"]),
            pack(TaauHistoryInput(pixels, surface, surface.shape[1], *kept)),
            pack(space.current_tables()), address(numbers),
        )  # fmt: skip
        kernel, output, scratch = self.kernels[STEP], pack(step.output), [pack(s) for s in space.scratch]

        def compute(box: Rect, worker: int) -> None:
            kernel(*inputs, scratch[worker], output, *box)

        self.pool.run_rects("compute", step.tiles.boxes(TILE, step.display), compute)

    def _kept(self, step: Step, space: _Space) -> tuple[Float32, NDArray[np.int32], int, int]:
        """Return the last members of `TaauHistoryInput`."""
        at, kept = blocks_at(step.display, step.frame.size), None
        if step.blocks is not None and (compared := compared_blocks(step.blocks)).any():
            kept = samples_kept(self._difference(step, space, compared), step.blocks, self._config)
        if kept is None:
            return NO_MASK, at.rows, 0, 0
        across = aligned((len(kept), up_to(step.display[0], LANES)))
        across[:, : step.display[0]] = kept[:, at.columns]
        return across, at.rows, across.shape[1], 1

    def _difference(self, step: Step, space: _Space, wanted: Bool) -> Float32:
        """Return differences of samples and history in rows of wanted blocks; see `ComparedBlocks`."""
        across, down = block_count(step.frame.size)
        columns, rows = nearest_pixels(step.display, step.frame.size)
        pixels, sums = step.history.arrays["pixels"], aligned((6, down, up_to(across, LANES)))
        samples, blocks = (
            pack(space.samples),
            pack(
                ComparedBlocks(
                    pixels, columns, rows, sums, across, sums.shape[2], down, step.display[0],
                    step.inputs.exposure,
                )
            ),
        )  # fmt: skip
        compare, used = self.kernels[COMPARE], np.flatnonzero(wanted.any(axis=1))
        box = Rect(int(used[0]), int(used[-1]) + 1, 0, 1)
        self.pool.run_rects("preprocess", [box], lambda box, _: compare(samples, blocks, box.y0, box.y1))
        return sums[..., :across]
