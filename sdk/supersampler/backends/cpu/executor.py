"""`CpuExecutor`: base class of the CPU backends of all methods."""

from abc import ABC, abstractmethod
from collections.abc import Collection, Mapping
from functools import partial
from typing import Any, Generic, NamedTuple, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from supersampler.backends.base import StepReport
from supersampler.backends.cpu.at_rest import AT_REST_KERNELS, AtRest, StaticBlocks, next_generation
from supersampler.backends.cpu.frame_preprocess import (
    MEASURE,
    AuxOutputs,
    FramePreprocess,
    ResampledFrame,
    frame_inputs,
    with_exposure,
)
from supersampler.backends.cpu.history import CpuHistory, Generations, HistoryLayout
from supersampler.backends.cpu.kernel_loader import load_kernels
from supersampler.backends.cpu.memory import Workspaces, held_bytes
from supersampler.backends.cpu.resample_tables import ResampleTableCache
from supersampler.backends.cpu.structs import FrameInputs, Output
from supersampler.backends.cpu.threads import Rect, ThreadPool
from supersampler.backends.cpu.tiles import Bool, Tiles, runs_of, scaled
from supersampler.frame import Float32, Frame, Size
from supersampler.methods.at_rest import block_count, phase_count


class WorkBuffers(Protocol):
    """Work buffers of a step."""

    tables: ResampleTableCache


Space = TypeVar("Space", bound=WorkBuffers)


class Step(NamedTuple):
    """A step of which at least one tile is computed.

    Attributes:
        frame: the frame.
        inputs: arrays and exposure of the frame.
        history: history after the previous frame; not changed.
        next_history: written to, except for the pixels of reused tiles.
        output: the other outputs.
        tiles: the tiles to compute.
        resting: (rows, columns) tiles whose history is kept, whether they are computed or not.
        blocks: static blocks of the frame; None for methods without convergence.
    """

    frame: Frame
    inputs: FrameInputs
    history: CpuHistory
    next_history: CpuHistory
    output: Output
    tiles: Tiles
    resting: Bool
    blocks: StaticBlocks | None

    @property
    def display(self) -> Size:
        """Size of the image."""
        return self.output.width, self.output.height


class CpuExecutor(ABC, Generic[Space]):
    """Base of the CPU executors; see `Executor`.

    Args:
        layout: layout of the method's history.
        pool: the threads that run the kernels.
        kernels: names of the method's kernels; those that take longest to compile are first and last.

    Attributes:
        kernels: all kernels by name.
        pool: as given.
    """

    name = "cpu"

    def __init__(self, layout: HistoryLayout, pool: ThreadPool, *kernels: str) -> None:
        first, *others = kernels
        self.kernels = load_kernels(first, MEASURE, *AT_REST_KERNELS, *others)
        self.pool, self._layout = pool, layout
        self._preprocess = FramePreprocess(self.kernels, pool)
        self._rest = AtRest(self.kernels, pool)
        self._spaces = Workspaces(self._space)

    @abstractmethod
    def _space(self, render: Size, display: Size) -> Space:
        """Allocate the work buffers for these sizes."""

    @abstractmethod
    def _compute_tiles(self, step: Step, space: Space) -> None:
        """Compute the tiles of a step."""

    def zeros(self, display: Size, render: Size) -> CpuHistory:
        """See `Executor`."""
        return CpuHistory(self._layout, self.own_size(display), render, display)

    def fits(self, buffers: CpuHistory, display: Size, render: Size) -> bool:
        """See `Executor`."""
        return buffers.fits(self.own_size(display), render, display)

    def step(
        self,
        frame: Frame,
        display: Size,
        history: CpuHistory,
        next_history: CpuHistory,
        image: Float32,
        aux_outputs: Collection[str],
        *,
        adds_samples: float,
        skip: bool,
    ) -> StepReport:
        """See `Executor`."""
        stages = vars(self.pool.stages)
        stages.clear()
        inputs, own, aux = frame_inputs(frame), self.own_size(display), AuxOutputs(aux_outputs, display)
        exposure = self._preprocess.exposure(frame, inputs.color, history.exposure)
        inputs = with_exposure(inputs, abs(exposure))
        blocks, generation = (
            self._compare(frame, inputs, history, next_history, adds_samples),
            next_generation(),
        )
        resting = np.zeros(next_history.generations.shape, bool)
        if blocks is not None and blocks.stays.any():
            resting = blocks.resting(own, frame.size)
        held = next_history.begin_step()
        leaves_out = skip and "weight" not in aux_outputs  # AOVs may change where no colour does
        tiles = Tiles(~resting if leaves_out else np.ones_like(resting))
        if tiles.any:
            next_history.jitter, next_history.exposure = frame.jitter, exposure
            self._run(
                frame,
                inputs,
                history,
                next_history,
                image,
                aux,
                tiles=tiles,
                resting=resting,
                blocks=blocks,
                display=display,
            )
            next_history.frame_generation = generation
        self._keep(history, next_history, tiles, resting, generation, held)
        if blocks is not None and history.rest is not None and next_history.rest is not None:
            rested = history.rest, next_history.rest, blocks
            self._rest.show(frame, inputs, *rested, image, generation, held.mean)
            aux.fill("converged", blocks.frozen, frame.size)
        if frame.pre_exposure != 1.0:
            self._multiply(image, frame.pre_exposure)
        return StepReport(aux.results(), dict(stages))

    def own_size(self, display: Size) -> Size:
        """Return the size of the images that the method keeps."""
        return display

    def _compare(
        self, frame: Frame, inputs: FrameInputs, history: CpuHistory, next_history: CpuHistory, adds: float
    ) -> StaticBlocks | None:
        if history.rest is None or next_history.rest is None:
            return None
        return self._rest.compare(frame, inputs, history.rest, next_history.rest, adds)

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
        """Compute tiles of the method's own image and next history."""
        output = aux.output(next_history.tiled()[0][1], image)
        with self._spaces.borrow(frame.size, display) as space:
            step = Step(frame, inputs, history, next_history, output, tiles, resting, blocks)
            self._compute_tiles(step, space)

    def _keep(
        self,
        history: CpuHistory,
        next_history: CpuHistory,
        tiles: Tiles,
        resting: Bool,
        generation: int,
        held: Generations,
    ) -> None:
        """Make tiles that rest in the next history those of the history."""
        stale = resting & (tiles.computed | (held.tiles != history.generations))
        if resting.all():
            next_history.keep_frame(history, generation if tiles.any else held.frame)
        if stale.any():
            runs = runs_of(stale)
            for (unit, source), (_, target) in zip(history.tiled(), next_history.tiled(), strict=True):
                boxes = scaled(runs, unit, (source.shape[1], source.shape[0]))
                self.pool.run_rects("rest", boxes, partial(_copy, source, target))
        next_history.generations = np.where(resting, history.generations, generation)

    def _multiply(self, image: Float32, factor: float) -> None:
        """Multiply an image in place."""

        def multiply(y0: int, y1: int, _: int) -> None:
            image[y0:y1] *= np.float32(factor)

        self.pool.run_rows("finish", len(image), multiply)

    def _resample(self, step: Step, view: ResampledFrame) -> None:
        """Preprocess the frame of a step into `view`; note whether it or its history has glare."""
        view.set_jitter(step.frame.jitter)
        view.set_masks(step.inputs)
        self._preprocess.read(step.inputs, view.samples)
        kept = step.history.glares and bool(step.resting.any())
        step.next_history.glares = bool(view.samples.glares.any()) or kept

    def required_bytes(self, display: Size, render: Size) -> tuple[int, int | None]:
        """See `Executor`."""
        history = held_bytes(self.zeros(display, render)) + self._rest_bytes(display, render)
        return history, self._working_bytes(self.own_size(display), render)

    def _rest_bytes(self, display: Size, render: Size) -> int:
        """Return the bytes of the mean and the signatures of one history, which are allocated at rest."""
        if not self._layout.rests:
            return 0
        across, down = block_count(render)
        return 16 * display[0] * display[1] + 8 * across * down * phase_count(display, render)

    def _working_bytes(self, display: Size, render: Size) -> int:
        """Return the bytes of the work buffers."""
        space = self._space(render, display)
        return held_bytes(space) + space.tables.most_bytes()

    def tensor(self, buffers: CpuHistory, name: str) -> Float32:
        """See `Executor`."""
        return buffers.tensor(name)

    def load(self, buffers: CpuHistory, tensors: Mapping[str, NDArray[Any]]) -> None:
        """See `Executor`."""
        buffers.load(tensors)


def _copy(source: NDArray[Any], target: NDArray[Any], box: Rect, worker: int) -> None:  # noqa: ARG001  # any
    y0, y1, x0, x1 = box
    target[y0:y1, x0:x1] = source[y0:y1, x0:x1]
