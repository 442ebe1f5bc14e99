"""CPU backend of `classifier-large`: that of `classifier` on a larger display, and a filter."""

from supersampler.backends.cpu.at_rest import StaticBlocks
from supersampler.backends.cpu.frame_preprocess import AuxOutputs
from supersampler.backends.cpu.history import CpuHistory
from supersampler.backends.cpu.kernel_loader import load_kernels
from supersampler.backends.cpu.layout import LANES
from supersampler.backends.cpu.memory import Workspaces, address, held_bytes
from supersampler.backends.cpu.resample_tables import up_to
from supersampler.backends.cpu.structs import FrameInputs, pack
from supersampler.backends.cpu.threads import ThreadPool
from supersampler.backends.cpu.tiles import Bool, Tiles
from supersampler.frame import Float32, Frame, Size
from supersampler.methods.classifier.cpu import ClassifierCpu
from supersampler.methods.classifier_large.downsampling import Downsampling, DownsamplingTables
from supersampler.methods.model_info import ModelInfo
from supersampler.methods.spec import large_size, resized

DOWNSAMPLE = "methods.classifier_large.kernels.downsample"


class LargeCpu(ClassifierCpu):
    """Runs `classifier-large`; all buffers of the step, and its tiles, are of the larger display."""

    def __init__(self, info: ModelInfo, pool: ThreadPool) -> None:
        super().__init__(info, pool)
        self._filter = load_kernels(DOWNSAMPLE)[DOWNSAMPLE]
        self._tables = Workspaces(lambda display: DownsamplingTables(display, pool.threads))

    def own_size(self, display: Size) -> Size:
        """See `CpuExecutor`."""
        return large_size(display)

    def _run(
        self,
        frame: Frame,
        inputs: FrameInputs,
        history: CpuHistory,
        next_history: CpuHistory,
        image: Float32,
        aux: AuxOutputs,
        *,
        tiles: Tiles,
        resting: Bool,
        blocks: StaticBlocks | None,
        display: Size,
    ) -> None:
        """See `CpuExecutor`."""
        large, exposure = large_size(display), inputs.exposure
        own = AuxOutputs(aux.planes, large)
        with self._tables.borrow(display) as tables:
            super()._run(
                frame,
                inputs,
                history,
                next_history,
                tables.image,
                own,
                tiles=tiles,
                resting=resting,
                blocks=blocks,
                display=large,
            )
            self._downsample(tables, exposure, image)
        for name in {"weight"} & {*aux.planes}:
            aux.planes[name][..., : display[0]] = resized(own.results()[name], display)

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

    def _working_bytes(self, display: Size, render: Size) -> int:
        tables = DownsamplingTables(display, self.pool.threads)  # of a larger display than needed
        return super()._working_bytes(display, render) + held_bytes(tables)
