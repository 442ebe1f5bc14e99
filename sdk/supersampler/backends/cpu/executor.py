"""`CpuExecutor`: base class of the CPU backends of all methods."""

from abc import ABC, abstractmethod
from collections.abc import Collection, Mapping
from typing import Any, Generic, NamedTuple, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from supersampler.backends.cpu.frame_preprocess import (
    MEASURE,
    AuxOutputs,
    FramePreprocess,
    ResampledFrame,
    frame_inputs,
)
from supersampler.backends.cpu.history import CpuHistory, HistoryLayout
from supersampler.backends.cpu.kernel_loader import load_kernels
from supersampler.backends.cpu.resample_tables import ResampleTableCache
from supersampler.backends.cpu.structs import FrameInputs, Output
from supersampler.backends.cpu.threads import ThreadPool
from supersampler.backends.cpu.tile_reuse import TILE_REUSE_KERNELS, TileReuse
from supersampler.backends.cpu.tiles import Tiles
from supersampler.backends.cpu.workspaces import Workspaces
from supersampler.backends.plan import held_bytes
from supersampler.frame import Float32, Frame, Size


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
        converged: (1, 1, H, pitch) to write the fraction of the mean to, if requested.
        tiles: the tiles to compute.
        adds_samples: see `Executor.step`.
    """

    frame: Frame
    inputs: FrameInputs
    history: CpuHistory
    next_history: CpuHistory
    output: Output
    converged: Float32 | None
    tiles: Tiles
    adds_samples: bool

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
        self.kernels = load_kernels(first, MEASURE, *TILE_REUSE_KERNELS, *others)
        self.pool, self._layout = pool, layout
        self._preprocess = FramePreprocess(self.kernels, pool)
        self._tile_reuse = TileReuse(self.kernels, pool)
        self._spaces = Workspaces(self._space)

    @abstractmethod
    def _space(self, render: Size, display: Size) -> Space:
        """Allocate the work buffers for these sizes."""

    @abstractmethod
    def _compute_tiles(self, step: Step, space: Space) -> None:
        """Compute the tiles of a step."""

    def zeros(self, display: Size, render: Size) -> CpuHistory:
        """See `Executor`."""
        return CpuHistory(self._layout, display, render)

    def fits(self, buffers: CpuHistory, display: Size, render: Size) -> bool:
        """See `Executor`."""
        return buffers.fits(display, render)

    def step(
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
        """See `Executor`."""
        aux = self._step(
            frame, display, history, next_history, image, aux_outputs,
            tolerance=tolerance, adds_samples=adds_samples,
        )  # fmt: skip
        if frame.pre_exposure != 1.0:
            self._multiply(image, frame.pre_exposure)
        return aux

    def _multiply(self, image: Float32, factor: float) -> None:
        """Multiply an image in place."""

        def multiply(y0: int, y1: int, _: int) -> None:
            image[y0:y1] *= np.float32(factor)

        self.pool.run_rows("finish", len(image), multiply)

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
        """Run `step`; the image is without pre-exposure."""
        inputs, aux = frame_inputs(frame), AuxOutputs(aux_outputs, display)
        if inputs.has_reactive:  # may change where no other input does
            tolerance = None
        states = history.tile_state, next_history.tile_state
        images = history.tiled(), next_history.tiled()
        inputs = inputs._replace(exposure=abs(history.exposure))
        tiles = self._tile_reuse.begin(inputs, frame.jitter, *states, tolerance=tolerance)
        if tiles.any:
            next_history.jitter = frame.jitter
            next_history.exposure = self._preprocess.exposure(frame, inputs.color, history.exposure)
            inputs = inputs._replace(exposure=abs(next_history.exposure))
            output, converged = aux.output(images[1][0][1], image), aux.planes.get("converged")
            with self._spaces.borrow(frame.size, display) as space:
                self._compute_tiles(
                    Step(frame, inputs, history, next_history, output, converged, tiles, adds_samples),
                    space,
                )
        else:
            next_history.keep_frame(history)
        inputs = inputs._replace(exposure=abs(next_history.exposure))
        mean = next_history.arrays.get("still"), next_history.arrays.get("opening")
        self._tile_reuse.end(inputs, frame.jitter, *states, *images, mean, image, tolerance=tolerance)
        return aux.results()

    def _resample(self, step: Step, view: ResampledFrame) -> None:
        """Preprocess the frame of a step into `view`; note whether it or its history has glare."""
        view.set_jitter(step.frame.jitter)
        mask, has_mask = step.inputs.reactive, step.inputs.has_reactive
        view.samples = view.samples._replace(reactive=mask, has_reactive=has_mask)
        self._preprocess.read(step.inputs, view.samples)
        kept = step.history.glares and not step.tiles.all
        step.next_history.glares = bool(view.samples.glares.any()) or kept

    def required_bytes(self, display: Size, render: Size) -> tuple[int, int | None]:
        """See `Executor`."""
        working = self._working_bytes(display, render) + self._tile_reuse.most_bytes(display, render)
        return held_bytes(self.zeros(display, render)), working

    def _working_bytes(self, display: Size, render: Size) -> int:
        """Return the bytes of the work buffers."""
        space = self._space(render, display)
        return held_bytes(space) + space.tables.most_bytes()

    def note_stages(self) -> Mapping[str, float]:
        """See `Executor`."""
        self.pool.seconds = {}
        return self.pool.seconds

    def tensor(self, buffers: CpuHistory, name: str) -> Float32:
        """See `Executor`."""
        return buffers.tensor(name)

    def load(self, buffers: CpuHistory, tensors: Mapping[str, NDArray[Any]]) -> None:
        """See `Executor`."""
        buffers.load(tensors)

    def memory(self, buffers: CpuHistory) -> Mapping[str, NDArray[Any]]:
        """See `Executor`."""
        return buffers.tile_state.arrays()

    def work(self, buffers: CpuHistory, display: Size) -> Float32:  # noqa: ARG002  # not needed
        """See `Executor`."""
        return buffers.tile_state.work

    def resting(self, buffers: CpuHistory) -> float | None:
        """See `Executor`."""
        state = buffers.tile_state
        return None if state.static_tiles is None else state.converged
