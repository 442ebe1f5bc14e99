"""CPU backend of `classifier`: gather, int8 network and finish, row by row on several threads."""

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
from supersampler.backends.cpu.layout import CLASSIFIER_PIXEL, LANES, PAD, PAST, SEEN, TILE
from supersampler.backends.cpu.memory import LINE, address, aligned
from supersampler.backends.cpu.resample_tables import Filter, catmull_rom, gaussian, up_to
from supersampler.backends.cpu.structs import FrameInputs, pack
from supersampler.backends.cpu.threads import Rect, RectTask, ThreadPool
from supersampler.backends.cpu.tile_reuse import TILE_REUSE_KERNELS
from supersampler.backends.cpu.tile_state import TileState
from supersampler.backends.cpu.tiles import Tiles
from supersampler.backends.cpu.workspaces import Workspaces
from supersampler.backends.plan import held_bytes
from supersampler.frame import Float32, Frame, Size
from supersampler.io.display import is_flash, usable_exposure
from supersampler.methods.classifier.int8_network import LEVEL, ByteNetwork, Encoder
from supersampler.methods.classifier.spec import CLASSES, CLASSIFIER
from supersampler.methods.classifier.structs import (
    ClassifierHistoryInput,
    FinishConstants,
    FinishScratch,
    Gathered,
    GatherScratch,
)
from supersampler.methods.classifier.variant import Variant
from supersampler.methods.model_file import ModelInfo
from supersampler.methods.spec import constants_array

ALL = 255.0
GATHER = "methods.classifier.kernels.gather.make_gather_rows"
FINISH = "methods.classifier.kernels.finish.make_finish_rows"
KEEP_DEPTH = "backends.cpu.kernels.frame.keep_depth"


@dataclass(eq=False)
class ClassifierHistory:
    """The history that one frame hands to the next.

    Attributes:
        render: size of that frame.
        pixels: (H, W, CLASSIFIER_PIXEL) linear RGB, count, least and most luma.
        classes: (H / 2, W / 2, 8) probabilities of six classes, ALL is 1.
        surfaces: (h, PAD + stride + PAD, 2) depth as it is and by morphological opening.
        jitter: of that frame.
        tile_state: for static-tile reuse.
        exposure: of that frame, as `followed_exposure` returns it; 0 where there is none.
        glares: whether pixels may hold counts of frames with light over GLARING.
    """

    render: Size
    pixels: Float32
    classes: NDArray[np.uint8]
    surfaces: Float32
    tile_state: TileState
    jitter: tuple[float, float] = (0.0, 0.0)
    exposure: float = 0.0
    glares: bool = False


class _Space:
    """Buffers for displays of one size."""

    def __init__(self, host: "ClassifierCpu", display: Size) -> None:
        self.display = big_w, big_h = display
        half = self.half = (big_w + 1) // 2, (big_h + 1) // 2
        width = self.width = up_to(big_w, LANES)
        history = aligned((big_h * width + LANES, PAST))
        rest = aligned((big_h * width, host.variant.rest), np.uint16)
        self.gathered = Gathered(history, rest, big_w, big_h, width)
        self.encoder = Encoder(host.network, half, host.pool)
        self.scratch = [_Scratch(self, host.variant) for _ in range(host.pool.threads)]


class _Scratch:
    """Rows that one thread works on."""

    def __init__(self, space: _Space, variant: Variant) -> None:
        width, half_w = space.width, space.half[0] + LANES
        self.gather = GatherScratch(
            aligned((3, width + 2 * PAD)),
            aligned((12, LANES), np.int32),
            aligned((12, LANES)),
            aligned((LANES, LANES)),
            aligned((2 * width + LANES,)),
            aligned((4 * SEEN * width + 2 * LANES,), np.uint8),
            aligned((4 * width + 2 * LANES,)),
        )
        read, decoded = aligned((2, half_w, 32), np.uint8)
        hidden = aligned((half_w, 4 * LANES), np.uint8)
        self.finish = FinishScratch(
            read,
            read.view(np.int32),
            decoded,
            decoded.view(np.int32),
            hidden,
            hidden.view(np.int32),
            aligned((variant.outputs, half_w)),
            aligned((LANES, LANES), np.int32),
            aligned((LANES, 8)),
        )


class ClassifierCpu(CpuExecutor):
    """Runs `classifier` and its relatives; see `Executor`.

    Args:
        info: the model.
        pool: threads that compute.
    """

    precision = "int8"

    def __init__(self, info: ModelInfo, pool: ThreadPool) -> None:
        self.variant = Variant.of(info.config)
        gather, finish = self.variant.kernel(GATHER), self.variant.kernel(FINISH)
        kernels = load_kernels(gather, *PREPROCESS_KERNELS, *TILE_REUSE_KERNELS, KEEP_DEPTH, LEVEL, finish)
        super().__init__(kernels, pool)
        self.network = ByteNetwork(info, self.variant.outputs, kernels[LEVEL])
        self._config = c = info.config
        self._constants = constants_array(CLASSIFIER, c)
        self._filters = [
            Filter(gaussian(c["sample_sigma"]), True),
            Filter(catmull_rom, False),
            Filter(gaussian(c["moment_sigma"]), False),
        ]
        self._windows = [gaussian(c["kernel_sigma"])]
        self._gather, self._keep_depth, self._finish = (
            kernels[name] for name in (gather, KEEP_DEPTH, finish)
        )
        self._spaces = Workspaces(lambda display: _Space(self, display))
        self._resampled = Workspaces(self._resampled_frame)

    def zeros(self, display: Size, render: Size) -> ClassifierHistory:
        """See `Executor`."""
        (w, h), (big_w, big_h) = render, display
        return ClassifierHistory(
            render,
            aligned((big_h, big_w, CLASSIFIER_PIXEL)),
            np.zeros(((big_h + 1) // 2, (big_w + 1) // 2, 8), np.uint8),
            np.zeros((h, up_to(w, LANES) + 2 * PAD, 2), np.float32),
            TileState(display),
        )

    def fits(self, buffers: ClassifierHistory, display: Size, render: Size) -> bool:
        """See `Executor`."""
        return buffers.render == render and buffers.pixels.shape[1::-1] == display

    def _compute_tiles(
        self,
        inputs: FrameInputs,
        frame: Frame,
        history: ClassifierHistory,
        next_history: ClassifierHistory,
        image: Float32,
        weight: Weight,
        tiles: Tiles,
    ) -> None:
        """See `CpuExecutor`."""
        exposure = self._preprocess.exposure(frame, inputs.color, history.exposure)
        next_history.jitter, next_history.exposure = frame.jitter, exposure
        display = image.shape[1], image.shape[0]
        with self._spaces.borrow(display) as space, self._resampled.borrow(frame.size, display) as view:
            view.set_jitter(frame.jitter)
            self._preprocess.read(inputs, abs(exposure), view.samples)
            next_history.glares = bool(view.samples.glares.any()) or (history.glares and not tiles.all)
            self._gather_all(space, view, history, next_history, tiles)
            space.encoder.run(tiles)
            flash = is_flash(usable_exposure(frame.exposure), exposure, history.exposure)
            self._compose(space, view, history, next_history, image, weight, tiles, flash=flash)

    def _keep_frame_state(self, history: ClassifierHistory, next_history: ClassifierHistory) -> None:
        """See `CpuExecutor`."""
        next_history.jitter, next_history.exposure = history.jitter, history.exposure
        next_history.glares = history.glares
        next_history.surfaces[:] = history.surfaces

    def _images_by_tile(
        self, history: ClassifierHistory, next_history: ClassifierHistory
    ) -> Sequence[tuple[int, NDArray[Any], NDArray[Any]]]:
        """See `CpuExecutor`."""
        classes = TILE // 2, history.classes, next_history.classes
        return [(TILE, history.pixels, next_history.pixels), classes]

    def needs(self, display: Size, render: Size) -> tuple[int, int | None]:
        """See `Executor`."""
        space, view = _Space(self, display), self._resampled_frame(render, display)
        working = held_bytes(space) + view.most_bytes() + self._tile_reuse.most_bytes(display, render)
        return held_bytes(self.zeros(display, render)), working

    def tensor(self, buffers: ClassifierHistory, name: str) -> Float32:
        """See `Executor`."""
        (w, _), pixels = buffers.render, buffers.pixels
        tensors: dict[str, NDArray[Any]] = {
            "history.color": pixels[None, ..., :3].transpose(0, 3, 1, 2),
            "history.state": pixels[None, ..., 3:6].transpose(0, 3, 1, 2),
            "history.classes": buffers.classes[None, ..., :CLASSES].transpose(0, 3, 1, 2) / np.float32(ALL),
            "history.depth": buffers.surfaces[None, :, PAD : PAD + w].transpose(0, 3, 1, 2),
            "history.jitter": np.array([buffers.jitter]),
            "history.exposure": np.array([buffers.exposure]),
        }
        return np.ascontiguousarray(tensors[name], np.float32)

    def load(self, buffers: ClassifierHistory, tensors: Mapping[str, NDArray[Any]]) -> None:
        """See `Executor`."""
        buffers.tile_state.load(tensors)
        pixels = buffers.pixels
        pixels[..., :3] = tensors["history.color"][0].transpose(1, 2, 0)
        pixels[..., 3:6] = tensors["history.state"][0].transpose(1, 2, 0)
        buffers.glares = bool(tensors["history.state"][0, 2].max() > 1.0)
        shares = np.round(tensors["history.classes"][0].transpose(1, 2, 0) * ALL)
        buffers.classes[..., :CLASSES] = np.clip(shares, 0.0, ALL)
        buffers.surfaces[:] = bordered(tensors["history.depth"][0], buffers.surfaces.shape[1])
        x, y = (float(j) for j in tensors["history.jitter"][0])
        buffers.jitter, buffers.exposure = (x, y), float(tensors["history.exposure"][0])

    def _resampled_frame(self, render: Size, display: Size) -> ResampledFrame:
        return ResampledFrame(render, display, self._filters, self.pool.threads, self._windows)

    def _gather_all(
        self,
        space: _Space,
        view: ResampledFrame,
        history: ClassifierHistory,
        next_history: ClassifierHistory,
        tiles: Tiles,
    ) -> None:
        """Compute the network inputs and all that finish needs, and the depth for the next frame."""
        s, read = space, view.samples
        (old_w, old_h), (w, h), (big_w, big_h) = history.render, next_history.render, s.display
        numbers = np.array(
            [
                *self._constants, abs(next_history.exposure), w, h, big_w, big_h, old_w, old_h,
                *history.jitter, next_history.glares or history.glares,
            ],
            np.float32,
        )  # fmt: skip
        previous = ClassifierHistoryInput(
            history.pixels, history.classes, history.surfaces, history.surfaces.shape[1]
        )
        samples, next_depth = pack(read), address(next_history.surfaces)
        inputs = samples, pack(previous), pack(view.tables()), address(numbers)
        lines, scratch = [address(line) for line in view.lines], [pack(t.gather) for t in s.scratch]
        outputs = pack(s.gathered), pack(s.encoder.inputs)

        def gather(box: Rect, worker: int) -> None:
            self._gather(*inputs, lines[worker], scratch[worker], *outputs, *box)

        def write_depth(box: Rect, _: int) -> None:
            self._keep_depth(samples, next_depth, box.y0, box.y1)

        boxes = tiles.boxes(TILE, (s.width, big_h), halo=True)
        self.pool.run_tasks("gather", RectTask(boxes, gather, 2), RectTask([Rect(0, h, 0, 1)], write_depth))

    def _compose(
        self,
        space: _Space,
        view: ResampledFrame,
        history: ClassifierHistory,
        next_history: ClassifierHistory,
        image: Float32,
        weight: Weight,
        tiles: Tiles,
        *,
        flash: bool,
    ) -> None:
        """Run the last layers; compose the image and the next history from what was gathered."""
        s, n, c, e, big_w = space, self.network, self._config, space.encoder, space.display[0]
        streams = (big_w % 2 == 0) + 2 * (big_w % LANES == 0 and address(image) % LINE == 0)
        constants = FinishConstants(
            n.logits, n.logits_scale, abs(next_history.exposure), c["samples"], c["contraction"],
            next_history.glares or history.glares, flash, streams,
        )  # fmt: skip
        inputs = [
            pack(struct)
            for struct in (e.levels, n.layers, e.inputs, s.gathered, view.samples, view.tables(), constants)
        ]
        outputs = pack(weight.output(next_history.pixels, image)), address(next_history.classes)
        scratch = [pack(thread.finish) for thread in s.scratch]

        def finish(box: Rect, worker: int) -> None:
            self._finish(*inputs, scratch[worker], *outputs, *box)

        self.pool.run_rects("finish", tiles.boxes(TILE // 2, s.half), finish)
