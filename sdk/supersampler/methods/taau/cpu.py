"""CPU backend of `taau`."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from supersampler.backends.cpu.executor import CpuExecutor
from supersampler.backends.cpu.frame_preprocess import (
    PREPROCESS_KERNELS,
    ResampledFrame,
    Weight,
    bordered,
)
from supersampler.backends.cpu.kernel_loader import load_kernels
from supersampler.backends.cpu.layout import LANES, PAD, TAAU_PIXEL, TILE
from supersampler.backends.cpu.memory import address
from supersampler.backends.cpu.resample_tables import Filter, catmull_rom, gaussian, up_to
from supersampler.backends.cpu.structs import FrameInputs, pack
from supersampler.backends.cpu.threads import Rect, ThreadPool
from supersampler.backends.cpu.tile_reuse import TILE_REUSE_KERNELS
from supersampler.backends.cpu.tile_state import TileState
from supersampler.backends.cpu.tiles import Tiles
from supersampler.backends.cpu.workspaces import Workspaces
from supersampler.backends.plan import held_bytes
from supersampler.frame import Float32, Frame, Size
from supersampler.methods.model_file import ModelInfo
from supersampler.methods.spec import constants_array
from supersampler.methods.taau.spec import FLASH, FLASH_MEMORY, LEAST_FLASH, TAAU
from supersampler.methods.taau.structs import TaauHistoryInput, TaauScratch

KERNELS = "methods.taau.kernels"


@dataclass(eq=False)
class TaauHistory:
    """The history that one frame hands to the next.

    Attributes:
        render: size of that frame.
        pixels: (H, W, TAAU_PIXEL).
        surface: (h, PAD + stride + PAD, 4) opened depth, mean and deviation of luma, glare.
        tile_state: for static-tile reuse.
        jitter: of that frame.
        exposure: of that frame, as `followed_exposure` returns it; 0 where there is none.
        light: (4,) see TAAU.
        glares: whether pixels may hold counts of frames with light over GLARING.
    """

    render: Size
    pixels: Float32
    surface: Float32
    light: Float32
    tile_state: TileState
    jitter: tuple[float, float] = (0.0, 0.0)
    exposure: float = 0.0
    glares: bool = False


class _Space(ResampledFrame):
    """Buffers for frames of one size; `scratch`: what one thread works on."""

    def __init__(self, render: Size, display: Size, filters: Sequence[Filter], threads: int) -> None:
        super().__init__(render, display, filters, threads)
        self.shades = np.zeros((threads, 3, self.wide), np.float32)
        self.sums = np.zeros((render[1], 2), np.float32)
        self.scratch = [
            TaauScratch(
                self.lines[worker],
                np.zeros((10, LANES), np.int32),
                np.zeros((10, LANES), np.float32),
                np.zeros((LANES, 8), np.float32),
                np.zeros((LANES, 8), np.float32),
            )
            for worker in range(threads)
        ]


class TaauCpu(CpuExecutor):
    """Runs `taau`; see `Executor`.

    Args:
        info: the model.
        pool: threads that compute.
    """

    precision = "fp32"

    def __init__(self, info: ModelInfo, pool: ThreadPool) -> None:
        kernels = load_kernels(
            f"{KERNELS}.step_rows", f"{KERNELS}.shade", *TILE_REUSE_KERNELS, *PREPROCESS_KERNELS
        )
        super().__init__(kernels, pool)
        c, self._constants = info.config, constants_array(TAAU, info.config)
        self._filters = [
            Filter(gaussian(c["frame_sigma"]), False),
            Filter(catmull_rom, False),
            Filter(gaussian(c["moment_sigma"]), False),
            Filter(gaussian(c["sample_sigma"]), True),
        ]
        self._step, self._shade = (
            kernels[f"{KERNELS}.step_rows"],
            kernels[f"{KERNELS}.shade"],
        )
        self._spaces = Workspaces(self._space)

    def zeros(self, display: Size, render: Size) -> TaauHistory:
        """See `Executor`."""
        (w, h), (big_w, big_h) = render, display
        pixels = np.zeros((big_h, big_w, TAAU_PIXEL), np.float32)
        surface = np.zeros((h, up_to(w, LANES) + 2 * PAD, 4), np.float32)
        return TaauHistory(render, pixels, surface, np.zeros(4, np.float32), TileState(display))

    def fits(self, buffers: TaauHistory, display: Size, render: Size) -> bool:
        """See `Executor`."""
        return buffers.render == render and buffers.pixels.shape[1::-1] == display

    def _compute_tiles(
        self,
        inputs: FrameInputs,
        frame: Frame,
        history: TaauHistory,
        next_history: TaauHistory,
        image: Float32,
        weight: Weight,
        tiles: Tiles,
    ) -> None:
        """See `CpuExecutor`."""
        exposure = self._preprocess.exposure(frame, inputs.color, history.exposure)
        next_history.jitter, next_history.exposure = frame.jitter, exposure
        with self._spaces.borrow(frame.size, (image.shape[1], image.shape[0])) as space:
            space.set_jitter(frame.jitter)
            self._preprocess.read(inputs, abs(exposure), space.samples)
            self._write_surface(space, next_history)
            change = abs(exposure / history.exposure) if history.exposure else 1.0
            self._write_light(space, history, next_history, change)
            next_history.glares = bool(space.samples.glares.any()) or (history.glares and not tiles.all)
            self._compute(space, history, next_history, image, weight, tiles, change)

    def _keep_frame_state(self, history: TaauHistory, next_history: TaauHistory) -> None:
        """See `CpuExecutor`."""
        next_history.jitter, next_history.exposure = history.jitter, history.exposure
        next_history.glares = history.glares
        next_history.surface[:], next_history.light[:] = history.surface, history.light

    def _images_by_tile(
        self, history: TaauHistory, next_history: TaauHistory
    ) -> Sequence[tuple[int, NDArray[Any], NDArray[Any]]]:
        """See `CpuExecutor`."""
        return [(TILE, history.pixels, next_history.pixels)]

    def needs(self, display: Size, render: Size) -> tuple[int, int | None]:
        """See `Executor`."""
        space = self._space(render, display)
        working = space.most_bytes() + self._tile_reuse.most_bytes(display, render)
        return held_bytes(self.zeros(display, render)), working

    def tensor(self, buffers: TaauHistory, name: str) -> Float32:
        """See `Executor`."""
        w = buffers.render[0]
        tensors = {
            "history.color": buffers.pixels[None, ..., :3].transpose(0, 3, 1, 2),
            "history.samples": buffers.pixels[None, ..., 3:].transpose(0, 3, 1, 2),
            "history.surface": buffers.surface[None, :, PAD : PAD + w, :3].transpose(0, 3, 1, 2),
            "history.jitter": np.array([buffers.jitter]),
            "history.exposure": np.array([buffers.exposure]),
            "history.light": buffers.light[None],
        }
        return np.ascontiguousarray(tensors[name], np.float32)

    def load(self, buffers: TaauHistory, tensors: Mapping[str, NDArray[Any]]) -> None:
        """See `Executor`."""
        buffers.tile_state.load(tensors)
        buffers.pixels[..., :3] = tensors["history.color"][0].transpose(1, 2, 0)
        buffers.pixels[..., 3:] = tensors["history.samples"][0].transpose(1, 2, 0)
        buffers.glares = bool(tensors["history.samples"][0, 1].max() > 1.0)
        buffers.surface[..., :3] = bordered(tensors["history.surface"][0], buffers.surface.shape[1])
        buffers.light[:] = tensors["history.light"][0]
        x, y = (float(j) for j in tensors["history.jitter"][0])
        buffers.jitter, buffers.exposure = (x, y), float(tensors["history.exposure"][0])

    def _space(self, render: Size, display: Size) -> _Space:
        return _Space(render, display, self._filters, self.pool.threads)

    def _write_surface(self, space: _Space, next_history: TaauHistory) -> None:
        """Write the surface that the next frame compares with."""
        samples, surface, sums = pack(space.samples), address(next_history.surface), address(space.sums)
        lines = [address(line) for line in space.shades]

        def shade(y0: int, y1: int, worker: int) -> None:
            self._shade(samples, lines[worker], surface, sums, y0, y1)

        self.pool.run_rows("read", space.samples.height, shade)

    def _write_light(
        self, space: _Space, history: TaauHistory, next_history: TaauHistory, change: float
    ) -> None:
        """Write `history.light`: twin of `light_after` of the torch method."""
        mean, *contrasts, flashes = history.light
        slope = change / (1.0 + (change - 1.0) * mean) ** 2
        last, older = slope * slope * np.array(contrasts)
        (w, h), light = next_history.render, next_history.light
        light[:2] = space.sums.sum(axis=0, dtype=np.float64) / (w * h)
        known = older if flashes > 0.0 else max(last, older)
        flash = known > 0.0 and flashes < 2.0 and light[1] > FLASH * known + LEAST_FLASH
        light[2:] = max(last, FLASH_MEMORY * older), flash * (flashes + 1.0)

    def _compute(
        self,
        space: _Space,
        history: TaauHistory,
        next_history: TaauHistory,
        image: Float32,
        weight: Weight,
        tiles: Tiles,
        change: float,
    ) -> None:
        flash = next_history.light[3]
        (old_w, old_h), (w, h), (big_h, big_w) = history.render, next_history.render, image.shape[:2]
        numbers = np.array(
            [
                *self._constants, abs(next_history.exposure), w, h, big_w, big_h, old_w, old_h,
                *history.jitter, change, flash > 0.0 or next_history.glares or history.glares, flash,
            ],
            np.float32,
        )  # fmt: skip
        inputs = (
            pack(space.samples), address(next_history.surface),
            pack(TaauHistoryInput(history.pixels, history.surface, history.surface.shape[1])),
            pack(space.tables()), address(numbers),
        )  # fmt: skip
        output, scratch = pack(weight.output(next_history.pixels, image)), [pack(s) for s in space.scratch]

        def compute(box: Rect, worker: int) -> None:
            self._step(*inputs, scratch[worker], output, *box)

        self.pool.run_rects("draw", tiles.boxes(TILE, (big_w, big_h)), compute)
