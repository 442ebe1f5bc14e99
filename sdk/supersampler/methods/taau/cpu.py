"""CPU backend of `taau`, temporal upsampling without a network."""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from supersampler.backends.cpu.at_rest import blocks_at, nearest_pixels
from supersampler.backends.cpu.executor import CpuExecutor, Step
from supersampler.backends.cpu.frame_preprocess import READ_KERNELS, ResampledFrame
from supersampler.backends.cpu.history import HistoryLayout, Plane
from supersampler.backends.cpu.layout import LANES, TAAU_PIXEL, TILE
from supersampler.backends.cpu.memory import address, aligned
from supersampler.backends.cpu.resample_tables import Filter, catmull_rom, gaussian, line_filters, up_to
from supersampler.backends.cpu.structs import NO_MASK, pack
from supersampler.backends.cpu.threads import Rect, ThreadPool
from supersampler.backends.cpu.tiles import Bool
from supersampler.frame import Float32, Size
from supersampler.methods.at_rest import block_count
from supersampler.methods.model_info import ModelInfo
from supersampler.methods.spec import constants_array
from supersampler.methods.taau.lag import compared, samples_kept
from supersampler.methods.taau.spec import FLASH, FLASH_MEMORY, LEAST_FLASH, TAAU
from supersampler.methods.taau.structs import ComparedBlocks, TaauHistoryInput, TaauScratch

KERNELS = "methods.taau.kernels"
STEP, COMPARE, SHADE = (f"{KERNELS}.{name}" for name in ("step_rows", "compare_with_history", "shade"))
LAYOUT = HistoryLayout(
    TAAU,
    {
        "pixels": Plane(("color", "samples"), TAAU_PIXEL),
        "surface": Plane(("surface",), 4),
    },
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
        """Write `history.light`: twin of `light_after` of the torch method."""
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
        if step.still is not None and (blocks := compared(step.still)).any():
            kept = samples_kept(self._difference(step, space, blocks), step.still, self._config)
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
