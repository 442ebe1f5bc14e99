"""CPU backend of `classifier-large`: that of `classifier` on a larger display, and a filter."""

from collections.abc import Collection, Mapping
from functools import lru_cache
from typing import ClassVar

import numpy as np

from supersampler.backends.cpu.history import CpuHistory, HistoryLayout
from supersampler.backends.cpu.kernel_loader import load_kernels
from supersampler.backends.cpu.layout import LANES, TILE
from supersampler.backends.cpu.memory import address
from supersampler.backends.cpu.resample_tables import up_to
from supersampler.backends.cpu.static_weights import LEAST_SAMPLES
from supersampler.backends.cpu.structs import pack
from supersampler.backends.cpu.threads import ThreadPool
from supersampler.backends.cpu.workspaces import Workspaces
from supersampler.backends.plan import held_bytes
from supersampler.frame import Float32, Frame, Size
from supersampler.methods.classifier.cpu import LAYOUT, ClassifierCpu
from supersampler.methods.classifier.spec import CLASSIFIER
from supersampler.methods.classifier_large.downsampling import DownsamplingTables
from supersampler.methods.classifier_large.structs import Downsampling
from supersampler.methods.model_info import ModelInfo
from supersampler.methods.sizes import large_size, resized

DOWNSAMPLE = "methods.classifier_large.kernels.downsample"
PIXELS = 1.4**2  # of the history in one of the display


class LargeCpu(ClassifierCpu):
    """Runs `classifier-large`; all buffers of the step, and its tiles, are of the larger display."""

    layout: ClassVar = HistoryLayout(CLASSIFIER, LAYOUT.planes, LAYOUT.glare, LEAST_SAMPLES / PIXELS)

    def __init__(self, info: ModelInfo, pool: ThreadPool) -> None:
        super().__init__(info, pool)
        self._filter = load_kernels(DOWNSAMPLE)[DOWNSAMPLE]
        self._tables = Workspaces(lambda display: DownsamplingTables(display, pool.threads))

    def zeros(self, display: Size, render: Size) -> CpuHistory:
        """See `Executor`."""
        return super().zeros(large_size(display), render)

    def fits(self, buffers: CpuHistory, display: Size, render: Size) -> bool:
        """See `Executor`."""
        return super().fits(buffers, large_size(display), render)

    def _step(
        self,
        frame: Frame,
        display: Size,
        history: CpuHistory,
        next_history: CpuHistory,
        image: Float32,
        aux_outputs: Collection[str],
        *,
        tolerance: float | None,
        adds_samples: bool,
    ) -> Mapping[str, Float32]:
        """See `CpuExecutor`."""
        large = large_size(display)
        with self._tables.borrow(display) as tables:
            planes = super()._step(
                frame, large, history, next_history, tables.image, aux_outputs,
                tolerance=tolerance, adds_samples=adds_samples,
            )  # fmt: skip
            self._downsample(tables, abs(next_history.exposure), image)
        return {name: resized(plane, display) for name, plane in planes.items()}

    def _downsample(self, tables: DownsamplingTables, exposure: float, image: Float32) -> None:
        """Filter the larger image to that of the display."""
        (height, width), large = image.shape[:2], tables.image.shape
        t = tables
        work = pack(
            Downsampling(
                t.image, image, t.rows, t.row_weights, t.columns, t.column_weights,
                width, up_to(width, LANES), large[1], large[0], exposure,
            )
        )  # fmt: skip
        scratch = [address(buffers) for buffers in tables.scratch]
        self.pool.run_rows(
            "downsample", height, lambda y0, y1, worker: self._filter(work, scratch[worker], y0, y1)
        )

    def required_bytes(self, display: Size, render: Size) -> tuple[int, int | None]:
        """See `Executor`."""
        large = large_size(display)
        working = self._working_bytes(large, render) + self._tile_reuse.most_bytes(large, render)
        tables = held_bytes(DownsamplingTables(display, self.pool.threads))
        return held_bytes(self.zeros(display, render)), working + tables

    def work(self, buffers: CpuHistory, display: Size) -> Float32:
        """See `Executor`."""
        large = large_size(display)
        across, down = (_shares(*extents) for extents in zip(display, large, strict=True))
        work: Float32 = (down @ super().work(buffers, large) @ across.T).astype(np.float32)
        return work


@lru_cache
def _shares(display: int, large: int) -> Float32:
    """Return the share of each tile of the larger display in those of the display: (tiles, larger tiles)."""
    own, larger = (
        np.minimum(np.arange(-(-extent // TILE) + 1) * TILE, extent) / extent for extent in (display, large)
    )
    ends = np.minimum(own[1:, None], larger[1:]) - np.maximum(own[:-1, None], larger[:-1])
    shares: Float32 = (np.maximum(ends, 0.0) / np.diff(own)[:, None]).astype(np.float32)
    return shares
