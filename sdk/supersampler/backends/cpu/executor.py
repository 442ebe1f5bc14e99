"""Base of the CPU executors: threads, frame preprocessing, static-tile reuse."""

from collections.abc import Mapping
from typing import Any, Protocol

from numpy.typing import NDArray

from supersampler.backends.cpu.frame_preprocess import FramePreprocess
from supersampler.backends.cpu.kernel_loader import Call
from supersampler.backends.cpu.threads import ThreadPool
from supersampler.backends.cpu.tile_reuse import TileReuse
from supersampler.backends.cpu.tile_state import TileState
from supersampler.frame import Float32, Size


class Buffers(Protocol):
    """A history of any method."""

    tile_state: TileState


class CpuExecutor:
    """Base of the CPU executors; see `Executor`.

    Args:
        kernels: PREPROCESS_KERNELS and TILE_REUSE_KERNELS, at least.
        pool: threads that compute.
    """

    name = "cpu"

    def __init__(self, kernels: Mapping[str, Call], pool: ThreadPool) -> None:
        self.pool = pool
        self._preprocess, self._tile_reuse = FramePreprocess(kernels, pool), TileReuse(kernels, pool)

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
