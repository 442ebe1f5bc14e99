"""`taa` on a processor, in one pass over the display: Salvi's, with his defaults."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from supersampler.backends.cpu.executor import CpuExecutor
from supersampler.backends.cpu.frame_preprocess import PREPROCESS_KERNELS, Planes, Weight
from supersampler.backends.cpu.kernel_loader import load_kernels
from supersampler.backends.cpu.layout import LANES, PAD, TAA_BOX, TAA_PLANES, TILE
from supersampler.backends.cpu.memory import address
from supersampler.backends.cpu.resample_tables import Columns, Filter, Looks, linear, up_to
from supersampler.backends.cpu.threads import Rect, ThreadPool
from supersampler.backends.cpu.tile_reuse import TILE_REUSE_KERNELS
from supersampler.backends.cpu.tile_state import TileState
from supersampler.backends.cpu.tiles import Tiles
from supersampler.backends.cpu.workspaces import Workspaces
from supersampler.backends.plan import held_bytes
from supersampler.frame import Float32, Frame, Size
from supersampler.methods.model_file import ModelInfo

KERNELS = "methods.taa.kernels"
SHARPNESS = 0.5  # Catmull-Rom


@dataclass(eq=False)
class TaaHistory:
    """What one frame leaves for the next.

    Attributes:
        display: (width, height).
        pixels: linear RGB as values, and one of room.
        trail: see there.
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

    def __init__(self, render: Size, display: Size, threads: int) -> None:
        w, h = render
        self.width, self.stride = up_to(display[0], LANES), up_to(w, LANES)
        self.looks = Looks(render, display, [Filter(linear, False)], rows=Columns)
        self.planes = np.zeros((h, TAA_PLANES, self.stride + 2 * PAD), np.float32)
        self.box = np.zeros((h, TAA_BOX, self.stride), np.float32)
        self.scratch = [
            (
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
        bands: threads.
    """

    precision = "fp32"

    def __init__(self, info: ModelInfo, bands: ThreadPool) -> None:
        kernels = load_kernels(
            f"{KERNELS}.step_rows",
            f"{KERNELS}.boxes",
            f"{KERNELS}.enter",
            *TILE_REUSE_KERNELS,
            *PREPROCESS_KERNELS,
        )
        super().__init__(kernels, bands)
        self._alpha, self._gamma = info.config["alpha"], info.config["gamma"]
        self._enter, self._boxes = kernels[f"{KERNELS}.enter"], kernels[f"{KERNELS}.boxes"]
        self._step = kernels[f"{KERNELS}.step_rows"]
        self._spaces = Workspaces(lambda render, display: _Space(render, display, bands.threads))

    def zeros(self, display: Size, render: Size) -> TaaHistory:  # noqa: ARG002  # as all executors
        """See `Executor`."""
        pixels = np.zeros(3 * display[0] * display[1] + 1, np.float32)
        return TaaHistory(display, pixels, TileState(display))

    def fits(self, buffers: TaaHistory, display: Size, render: Size) -> bool:  # noqa: ARG002
        """See `Executor`."""
        return buffers.display == display

    def step(
        self,
        frame: Frame,
        display: Size,
        past: TaaHistory,
        left: TaaHistory,
        image: Float32,
        aux_outputs: Collection[str],
        *,
        tolerance: float | None,
    ) -> Mapping[str, Float32]:
        """See `Executor`."""
        planes, weight = Planes.of(frame), Weight(aux_outputs, display)
        tiles = self._skipping.begin(
            planes, frame.jitter, display, past.tile_state, left.tile_state, skips=tolerance is not None
        )
        left.exposure = past.exposure
        if tiles.any:
            left.exposure = self._reader.exposure(frame, planes.color, past.exposure)
            with self._spaces.borrow(frame.size, display) as space:
                self._read(space, planes, abs(left.exposure))
                self._draw(space, frame, past, left, image, weight, tiles)
        self._skipping.end(
            tiles, past.tile_state, left.tile_state, [(TILE, past.image, left.image)], image,
            exposure=abs(left.exposure), tolerance=tolerance or 0.0,
        )  # fmt: skip
        return weight.aux_outputs()

    def needs(self, display: Size, render: Size) -> tuple[int, int | None]:
        """See `Executor`."""
        space = _Space(render, display, self.bands.threads)
        working = held_bytes(space) + space.looks.most_bytes() + self._skipping.most_bytes(display, render)
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

    def _read(self, space: _Space, planes: Planes, exposure: float) -> None:
        """Tone the samples, box their neighbourhoods."""
        h, w = planes.depth.shape
        s, color, motion = space, address(planes.color), address(planes.motion)
        to, box = address(s.planes), address(s.box)

        def read(y0: int, y1: int, _: int) -> None:
            # a row more on either side: what two threads both write is the same
            self._enter(color, motion, exposure, w, s.stride, max(y0 - 1, 0), min(y1 + 1, h), to)
            self._boxes(to, self._gamma, w, h, s.stride, y0, y1, box)

        self.bands.run("read", h, read)

    def _draw(
        self,
        space: _Space,
        frame: Frame,
        past: TaaHistory,
        left: TaaHistory,
        image: Float32,
        weight: Weight,
        tiles: Tiles,
    ) -> None:
        s, display = space, left.display
        alpha = self._alpha if abs(past.exposure) > 0.0 else 1.0
        numbers = [abs(left.exposure), *frame.size, *display, alpha, self._gamma, SHARPNESS]
        given = np.array(numbers, np.float32)
        places = [
            (*axis.samples[1:3], *axis.weights[1:3], axis.near) for axis in s.looks.at(frame.jitter)
        ]  # of the tent, the inner two weigh
        inputs = (
            address(s.planes), address(s.box), s.stride, address(past.pixels),
            *(address(a) for a in (*places[0], *places[1], given)), *display, s.width,
        )  # fmt: skip
        outputs = address(left.pixels), address(image), *weight.arguments

        def draw(box: Rect, worker: int) -> None:
            self._step(*inputs, *(address(a) for a in s.scratch[worker]), *outputs, *box)

        self.bands.cover("draw", tiles.boxes(TILE, display), draw)
