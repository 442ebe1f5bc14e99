"""The backend protocol: what `Model` needs of the ONNX backend and of the CPU backend."""

from collections.abc import Collection, Mapping
from typing import Any, Protocol

from numpy.typing import NDArray

from supersampler.frame import Float32, Frame, Size

Buffers = Any
"""A history in the layout and memory of one executor."""


class Executor(Protocol):
    """Runs steps. Keeps no state that a result depends on; shareable between threads.

    Attributes:
        name: "onnx" or "cpu".
        precision: of the network, "fp32", "fp16" or "int8".
    """

    name: str
    precision: str

    def zeros(self, display: Size, render: Size) -> Buffers:
        """Allocate an empty history for frames of this size."""

    def fits(self, buffers: Buffers, display: Size, render: Size) -> bool:
        """Whether the history after a frame of this size may be written to these buffers."""

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
        """Upscale a frame that has been checked.

        Args:
            frame: the frame.
            display: (W, H).
            history: after the previous frame; not changed.
            next_history: written to; not `history`.
            image: (H, W, 3), written to.
            aux_outputs: names of auxiliary outputs to return.
            tolerance: of static-tile reuse: a tile of a still scene settles on the mean of its samples before
                a period is whole where its estimated error is at most this, root mean square of display
                values. None: no tile is reused.

        Returns:
            The auxiliary outputs, NCHW, by name.
        """

    def needs(self, display: Size, render: Size) -> tuple[int, int | None]:
        """Bytes of a history, and of the working memory of a step; None where that is unknown."""

    def note_stages(self) -> Mapping[str, float]:
        """Return a mapping in which wall seconds of stages add up from now on; empty where unknown."""

    def tensor(self, buffers: Buffers, name: str) -> Float32:
        """A history tensor of the contract as an array, NCHW."""

    def memory(self, buffers: Buffers) -> Mapping[str, NDArray[Any]]:
        """Copies of the executor's own state beside the history tensors, by name."""

    def work(self, buffers: Buffers, display: Size) -> Float32:
        """Work of the step that wrote these buffers as a share of a full step, by tile: (rows, columns)."""

    def converged(self, buffers: Buffers) -> float:
        """Share of the image that no longer changes while the scene stands still."""

    def load(self, buffers: Buffers, tensors: Mapping[str, NDArray[Any]]) -> None:
        """Fill buffers with all history tensors of the contract, whose shapes have been checked.

        Arrays by `memory` may be among them, of this executor or of another.
        """
