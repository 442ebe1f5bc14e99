"""Base of the CPU executors: the step that all methods share, around the stages of one method."""

from abc import ABC, abstractmethod
from collections.abc import Collection, Mapping, Sequence
from typing import Any, Protocol

from numpy.typing import NDArray

from supersampler.backends.cpu.frame_preprocess import FramePreprocess, Weight, frame_inputs
from supersampler.backends.cpu.kernel_loader import Call
from supersampler.backends.cpu.structs import FrameInputs
from supersampler.backends.cpu.threads import ThreadPool
from supersampler.backends.cpu.tile_reuse import TileReuse
from supersampler.backends.cpu.tile_state import TileState
from supersampler.backends.cpu.tiles import Tiles
from supersampler.frame import Float32, Frame, Size


class Buffers(Protocol):
    """A history of any method."""

    tile_state: TileState
    exposure: float


class CpuExecutor(ABC):
    """Base of the CPU executors; see `Executor`.

    Args:
        kernels: PREPROCESS_KERNELS and TILE_REUSE_KERNELS, at least.
        pool: threads that compute.
    """

    name = "cpu"

    def __init__(self, kernels: Mapping[str, Call], pool: ThreadPool) -> None:
        self.pool = pool
        self._preprocess, self._tile_reuse = FramePreprocess(kernels, pool), TileReuse(kernels, pool)

    def step(
        self,
        frame: Frame,
        display: Size,
        history: Buffers,
        next_history: Buffers,
        image: Float32,
        aux_outputs: Collection[str],
        *,
        tolerance: float | None,
    ) -> Mapping[str, Float32]:
        """See `Executor`."""
        inputs, weight = frame_inputs(frame), Weight(aux_outputs, display)
        states = history.tile_state, next_history.tile_state
        tiles = self._tile_reuse.begin(inputs, frame.jitter, display, *states, skips=tolerance is not None)
        if tiles.any:
            self._compute_tiles(inputs, frame, history, next_history, image, weight, tiles)
        else:
            self._keep_frame_state(history, next_history)
        self._tile_reuse.end(
            tiles, *states, self._images_by_tile(history, next_history), image,
            exposure=abs(next_history.exposure), tolerance=tolerance or 0.0,
        )  # fmt: skip
        return weight.aux_outputs()

    @abstractmethod
    def _compute_tiles(
        self,
        inputs: FrameInputs,
        frame: Frame,
        history: Any,
        next_history: Any,
        image: Float32,
        weight: Weight,
        tiles: Tiles,
    ) -> None:
        """Run the stages of the method on these tiles; write `next_history` except its other tiles."""

    @abstractmethod
    def _keep_frame_state(self, history: Any, next_history: Any) -> None:
        """Copy what describes the frame (not its tiles) from a history to the next: no tile is computed."""

    @abstractmethod
    def _images_by_tile(
        self, history: Any, next_history: Any
    ) -> Sequence[tuple[int, NDArray[Any], NDArray[Any]]]:
        """Pixels of a tile's side, and both arrays, for each image of the history; see `TileReuse.end`."""

    def note_stages(self) -> Mapping[str, float]:
        """See `Executor`."""
        self.pool.seconds = {}
        return self.pool.seconds

    def memory(self, buffers: Buffers) -> Mapping[str, NDArray[Any]]:
        """See `Executor`."""
        return buffers.tile_state.arrays()

    def work(self, buffers: Buffers, display: Size) -> Float32:  # noqa: ARG002  # known
        """See `Executor`."""
        return buffers.tile_state.work
