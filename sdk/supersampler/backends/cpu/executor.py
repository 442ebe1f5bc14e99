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
        bands: threads.
    """

    name = "cpu"

    def __init__(self, kernels: Mapping[str, Call], bands: ThreadPool) -> None:
        self.bands = bands
        self._preprocess, self._tile_reuse = FramePreprocess(kernels, bands), TileReuse(kernels, bands)

    def note_stages(self) -> Mapping[str, float]:
        """See `Executor`."""
        self.bands.seconds = {}
        return self.bands.seconds

    def memory(self, buffers: Buffers) -> Mapping[str, NDArray[Any]]:
        """See `Executor`."""
        return buffers.tile_state.arrays()

    def work(self, buffers: Buffers, display: Size) -> Float32:  # noqa: ARG002  # known
        """See `Executor`."""
        return buffers.tile_state.work
