"""CPU backend of `taa` (Salvi 2016, his defaults)."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from supersampler.backends.cpu.executor import CpuExecutor
from supersampler.backends.cpu.frame_preprocess import PREPROCESS_KERNELS, Weight
from supersampler.backends.cpu.kernel_loader import load_kernels
from supersampler.backends.cpu.layout import LANES, PAD, TAA_BOX, TAA_PLANES, TILE
from supersampler.backends.cpu.memory import address
from supersampler.backends.cpu.resample_tables import Columns, Filter, ResampleTableCache, linear, up_to
from supersampler.backends.cpu.structs import FrameInputs, pack
from supersampler.backends.cpu.threads import Rect, ThreadPool
from supersampler.backends.cpu.tile_reuse import TILE_REUSE_KERNELS
from supersampler.backends.cpu.tile_state import TileState
from supersampler.backends.cpu.tiles import Tiles
from supersampler.backends.cpu.workspaces import Workspaces
from supersampler.backends.plan import held_bytes
from supersampler.frame import Float32, Frame, Size
from supersampler.methods.model_file import ModelInfo
from supersampler.methods.taa.structs import LinearAxis, TaaSamples, TaaScratch

KERNELS = "methods.taa.kernels"
SHARPNESS = 0.5  # Catmull-Rom


@dataclass(eq=False)
class TaaHistory:
    """The history that one frame hands to the next.

    Attributes:
        display: (width, height).
        pixels: linear RGB as values, and one of room.
        tile_state: for static-tile reuse.
        exposure: of that frame, as `followed_exposure` returns it; 0 where there is none.
    """

    display: Size
    pixels: Float32
    tile_state: TileState
    exposure: float = 0.0

    @property
    def image(self) -> Float32:
        """(H, W, 3)."""
        return self.pixels[:-1].reshape(*self.display[::-1], 3)


class _Space:
    """Buffers for frames of one size; `scratch`: rows that one thread works on."""

    def __init__(self, render: Size, display: Size, gamma: float, threads: int) -> None:
        w, h = render
        self.stride = up_to(w, LANES)
        self.table_cache = ResampleTableCache(render, display, [Filter(linear, False)], rows=Columns)
        planes = np.zeros((h, TAA_PLANES, self.stride + 2 * PAD), np.float32)
        boxes = np.zeros((h, TAA_BOX, self.stride), np.float32)
        self.samples = TaaSamples(planes, boxes, gamma, w, h, self.stride)
        self.scratch = [
            TaaScratch(
                np.zeros((10, LANES), np.int32),
                np.zeros((10, LANES), np.float32),
                np.zeros((LANES, 4), np.float32),
                np.zeros((LANES, LANES), np.float32),
            )
            for _ in range(threads)
        ]


class TaaCpu(CpuExecutor):
    """Runs `taa`; see `Executor`.

    Args:
        info: the model.
        pool: threads that compute.
    """

    precision = "fp32"

    def __init__(self, info: ModelInfo, pool: ThreadPool) -> None:
        kernels = load_kernels(
            f"{KERNELS}.step_rows",
            f"{KERNELS}.fill_boxes",
            f"{KERNELS}.read_samples",
            *TILE_REUSE_KERNELS,
            *PREPROCESS_KERNELS,
        )
        super().__init__(kernels, pool)
        self._alpha, self._gamma = info.config["alpha"], info.config["gamma"]
        self._read_samples, self._fill_boxes, self._step = (
            kernels[f"{KERNELS}.{name}"] for name in ("read_samples", "fill_boxes", "step_rows")
        )
        self._spaces = Workspaces(self._space)

    def zeros(self, display: Size, render: Size) -> TaaHistory:  # noqa: ARG002  # as all executors
        """See `Executor`."""
        pixels = np.zeros(3 * display[0] * display[1] + 1, np.float32)
        return TaaHistory(display, pixels, TileState(display))

    def fits(self, buffers: TaaHistory, display: Size, render: Size) -> bool:  # noqa: ARG002
        """See `Executor`."""
        return buffers.display == display

    def _compute_tiles(
        self,
        inputs: FrameInputs,
        frame: Frame,
        history: TaaHistory,
        next_history: TaaHistory,
        image: Float32,
        weight: Weight,
        tiles: Tiles,
    ) -> None:
        """See `CpuExecutor`."""
        next_history.exposure = self._preprocess.exposure(frame, inputs.color, history.exposure)
        with self._spaces.borrow(frame.size, history.display) as space:
            self._read(space, inputs._replace(exposure=abs(next_history.exposure)))
            self._compute(space, frame, history, next_history, image, weight, tiles)

    def _keep_frame_state(self, history: TaaHistory, next_history: TaaHistory) -> None:
        """See `CpuExecutor`."""
        next_history.exposure = history.exposure

    def _images_by_tile(
        self, history: TaaHistory, next_history: TaaHistory
    ) -> Sequence[tuple[int, NDArray[Any], NDArray[Any]]]:
        """See `CpuExecutor`."""
        return [(TILE, history.image, next_history.image)]

    def needs(self, display: Size, render: Size) -> tuple[int, int | None]:
        """See `Executor`."""
        space = self._space(render, display)
        working = (
            held_bytes(space) + space.table_cache.most_bytes() + self._tile_reuse.most_bytes(display, render)
        )
        return held_bytes(self.zeros(display, render)), working

    def tensor(self, buffers: TaaHistory, name: str) -> Float32:
        """See `Executor`."""
        if name == "history.exposure":
            return np.array([buffers.exposure], np.float32)
        return np.ascontiguousarray(buffers.image.transpose(2, 0, 1)[None])

    def load(self, buffers: TaaHistory, tensors: Mapping[str, NDArray[Any]]) -> None:
        """See `Executor`."""
        buffers.tile_state.load(tensors)
        buffers.image[:] = tensors["history.color"][0].transpose(1, 2, 0)
        buffers.exposure = float(tensors["history.exposure"][0])

    def _space(self, render: Size, display: Size) -> _Space:
        return _Space(render, display, self._gamma, self.pool.threads)

    def _read(self, space: _Space, frame: FrameInputs) -> None:
        """Tone the samples, and fill the box around each."""
        inputs, samples, h = pack(frame), pack(space.samples), space.samples.height

        def read(y0: int, y1: int, _: int) -> None:
            # a row more on either side: what two threads both write is the same
            self._read_samples(inputs, samples, max(y0 - 1, 0), min(y1 + 1, h))
            self._fill_boxes(samples, y0, y1)

        self.pool.run_rows("read", h, read)

    def _compute(
        self,
        space: _Space,
        frame: Frame,
        history: TaaHistory,
        next_history: TaaHistory,
        image: Float32,
        weight: Weight,
        tiles: Tiles,
    ) -> None:
        display = next_history.display
        alpha = self._alpha if abs(history.exposure) > 0.0 else 1.0
        numbers = [abs(next_history.exposure), *frame.size, *display, alpha, self._gamma, SHARPNESS]
        given = np.array(numbers, np.float32)
        columns, rows = (  # of the four samples around a pixel, a tent weighs the inner two
            pack(LinearAxis(axis.samples[1], axis.samples[2], axis.weights[1], axis.weights[2], axis.near))
            for axis in space.table_cache.at(frame.jitter)
        )
        inputs = pack(space.samples), address(history.pixels), columns, rows, address(given)
        output, scratch = pack(weight.output(next_history.pixels, image)), [pack(s) for s in space.scratch]

        def compute(box: Rect, worker: int) -> None:
            self._step(*inputs, scratch[worker], output, *box)

        self.pool.run_rects("draw", tiles.boxes(TILE, display), compute)
