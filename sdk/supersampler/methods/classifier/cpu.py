"""CPU backend of `classifier`: gather, int8 network and finish, row by row on several threads."""

from typing import Any, ClassVar

import numpy as np

from supersampler.backends.cpu.executor import CpuExecutor, Step
from supersampler.backends.cpu.frame_preprocess import READ_KERNELS, ResampledFrame
from supersampler.backends.cpu.history import HistoryLayout, Plane
from supersampler.backends.cpu.layout import CLASSIFIER_PIXEL, HISTORY_PLANES, INPUT_PLANES, LANES, PAD, TILE
from supersampler.backends.cpu.memory import LINE, Workspaces, address, aligned, held_bytes
from supersampler.backends.cpu.resample_tables import Filter, catmull_rom, gaussian, up_to
from supersampler.backends.cpu.structs import pack
from supersampler.backends.cpu.threads import Rect, RectTask, ThreadPool
from supersampler.backends.cpu.tiles import Bool
from supersampler.frame import Float32, Size
from supersampler.io.display import is_flash, usable_exposure
from supersampler.methods.classifier.int8_network import LEVEL, Int8Network
from supersampler.methods.classifier.spec import CLASSES, CLASSIFIER, FLASH_FRACTION
from supersampler.methods.classifier.structs import (
    ClassifierHistoryInput,
    FinishConstants,
    FinishScratch,
    Gathered,
    GatherScratch,
    Guide,
    Variant,
)
from supersampler.methods.model_info import ModelInfo
from supersampler.methods.spec import constants_array

GATHER = "methods.classifier.kernels.gather.make_gather_rows"
FINISH = "methods.classifier.kernels.finish.make_finish_rows"
KEEP_DEPTH = "backends.cpu.kernels.frame.keep_depth"
LAYOUT = HistoryLayout(
    CLASSIFIER,
    {
        "pixels": Plane(("color", "state"), CLASSIFIER_PIXEL),
        "classes": Plane(("classes",), 8, np.uint8),
        "depth": Plane(("depth",), 2),
    },
    glare="state",
)


_NONE = np.zeros(1, np.float32)
NO_GUIDE = Guide(_NONE, _NONE, _NONE, _NONE, np.zeros(1, np.uint8), np.zeros(1, np.int32), 0.0, 0.0, 0.0, 0.0)
"""Guide of variants that are not `guided`."""


class _Space:
    """Buffers for displays of one size."""

    def __init__(self, executor: "ClassifierCpu", display: Size) -> None:
        big_w, big_h = display
        half = self.half = (big_w + 1) // 2, (big_h + 1) // 2
        width = self.width = up_to(big_w, LANES)
        history = aligned((big_h * width + LANES, HISTORY_PLANES))
        rest = aligned((big_h * width, executor.variant.rest), np.uint16)
        rising = aligned((big_h, width // LANES))
        image = aligned((big_h * executor.variant.guided, 3, width + 2 * PAD), np.uint16)
        self.gathered = Gathered(history, rest, rising, image, big_w, big_h, width)
        self.network = executor.network.buffers(half, executor.pool)
        self.scratch = [_Scratch(self, executor.variant) for _ in range(executor.pool.threads)]


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
            aligned((4 * INPUT_PLANES * width + 2 * LANES,), np.uint8),
            aligned((4 * width + 2 * LANES,)),
            aligned((LANES, 4)),
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
            aligned((variant.outputs + CLASSES, half_w)),
            aligned((LANES, LANES), np.int32),
            aligned((LANES, 8)),
        )


class ClassifierCpu(CpuExecutor[ResampledFrame]):
    """Runs `classifier` and its relatives; see `Executor`.

    Args:
        info: the model.
        pool: threads that compute.

    Attributes:
        layout: of the history.
        guided: whether the kernels are of the variant `guided`.
        preparing: names of kernels that `guide_of` needs.
    """

    layout: ClassVar = LAYOUT
    guided: ClassVar = False
    preparing: ClassVar[tuple[str, ...]] = ()

    def __init__(self, info: ModelInfo, pool: ThreadPool) -> None:
        self.variant = Variant.of(info.config, guided=self.guided)
        names = self.variant.kernel(GATHER), KEEP_DEPTH, LEVEL, self.variant.kernel(FINISH)
        others = *READ_KERNELS, *names[1:-1], *self.preparing
        super().__init__(self.layout, pool, names[0], *others, names[-1])
        self._gather, self._keep_depth, kernel, self._finish = (self.kernels[name] for name in names)
        self.network = Int8Network(info, self.variant.outputs, kernel)
        self.precision = self.network.precision
        self._config = c = info.config
        self._constants = constants_array(CLASSIFIER, c)
        self._filters = [
            Filter(gaussian(c["sample_sigma"]), True),
            Filter(catmull_rom, False),
            Filter(gaussian(c["moment_sigma"]), False),
        ]
        self._windows = [gaussian(c["kernel_sigma"])]
        self._display_spaces = Workspaces(lambda display: _Space(self, display))

    def _space(self, render: Size, display: Size) -> ResampledFrame:
        return ResampledFrame(render, display, self._filters, self.pool.threads, self._windows)

    def _working_bytes(self, display: Size, render: Size) -> int:
        return super()._working_bytes(display, render) + held_bytes(_Space(self, display))

    def _compute_tiles(self, step: Step, space: ResampledFrame) -> None:
        self._resample(step, space)
        with self._display_spaces.borrow(step.display) as buffers:
            self._gather_all(step, space, buffers)
            self._compose(step, space, buffers, buffers.network.run(step.tiles))

    def guide_of(self, step: Step, view: ResampledFrame) -> Guide:  # noqa: ARG002  # of this variant
        """Return what the variant `guided` reads and writes; of others, nothing."""
        return NO_GUIDE

    def _gather_all(self, step: Step, view: ResampledFrame, space: _Space) -> None:
        """Compute the network inputs and all that finish needs, and the depth for the next frame."""
        history, (w, h) = step.history, step.frame.size
        numbers = np.array(
            [
                *self._constants, step.inputs.exposure, w, h, *step.display, *history.render, *history.jitter,
                step.next_history.glares or history.glares,
            ],
            np.float32,
        )  # fmt: skip
        pixels, classes, depth = (history.arrays[name] for name in ("pixels", "classes", "depth"))
        previous = ClassifierHistoryInput(pixels, classes, depth, depth.shape[1])
        samples, next_depth = pack(view.samples), address(step.next_history.arrays["depth"])
        inputs = samples, pack(previous), pack(view.current_tables()), address(numbers)
        guide = self.guide_of(step, view)
        packed_guide = pack(guide)
        lines, scratch = [address(line) for line in view.lines], [pack(t.gather) for t in space.scratch]
        outputs = pack(space.gathered), pack(space.network.inputs)

        def gather(box: Rect, worker: int) -> None:
            self._gather(*inputs, lines[worker], scratch[worker], packed_guide, *outputs, *box)

        def write_depth(box: Rect, _: int) -> None:
            self._keep_depth(samples, next_depth, box.y0, box.y1)

        space.gathered.rising.fill(0.0)  # tiles that are not computed have no such light
        boxes = step.tiles.boxes(TILE, (space.width, step.display[1]), halo=True)
        self.pool.run_tasks("gather", RectTask(boxes, gather, 2), RectTask([Rect(0, h, 0, 1)], write_depth))

    def _compose(
        self, step: Step, view: ResampledFrame, space: _Space, inferred: tuple[tuple[Any, ...], ...]
    ) -> None:
        """Run the layers that are left; compose the image and the next history from what was gathered."""
        given, before = usable_exposure(step.frame.exposure), step.history.exposure
        flash = is_flash(given, step.next_history.exposure, before)
        c, (big_w, big_h) = self._config, step.display
        if step.resting.any():
            _clear(space.gathered.rising, step.resting)
        rises = bool(space.gathered.rising.sum() > FLASH_FRACTION * big_w * big_h)
        step.next_history.glares |= rises
        streams = (big_w % 2 == 0) + 2 * (big_w % LANES == 0 and address(step.output.image) % LINE == 0)
        constants = FinishConstants(
            step.inputs.exposure, c["samples"], c["contraction"],
            step.next_history.glares or step.history.glares, rises, flash, streams,
        )  # fmt: skip
        structs = *inferred, space.gathered, view.samples, view.current_tables(), constants
        inputs, scratch = [pack(struct) for struct in structs], [pack(t.finish) for t in space.scratch]
        outputs = pack(step.output), address(step.next_history.arrays["classes"])

        def finish(box: Rect, worker: int) -> None:
            self._finish(*inputs, scratch[worker], *outputs, *box)

        self.pool.run_rects("finish", step.tiles.boxes(TILE // 2, space.half), finish)


def _clear(groups: Float32, tiles: Bool) -> None:
    """Write 0 to groups of LANES pixels, (height, groups), that lie in these tiles."""
    mask = tiles.repeat(TILE, 0).repeat(TILE // LANES, 1)
    groups[mask[: groups.shape[0], : groups.shape[1]]] = 0.0
