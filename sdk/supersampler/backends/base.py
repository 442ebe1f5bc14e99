"""How a model runs: what `Model` asks of ONNX Runtime's graph, and of kernels on this processor."""

from collections.abc import Collection, Mapping
from typing import Any, Protocol

from numpy.typing import NDArray

from supersampler.frame import Float32, Frame, Size

Buffers = Any
"""What one frame leaves for the next, in the form and place that suits an executor."""


class Executor(Protocol):
    """Runs steps; keeps nothing between them that a result depends on. Shareable between threads.

    Attributes:
        name: "onnx" or "cpu".
        precision: of the learned part, "fp32", "fp16" or, in bytes, "int8".
    """

    name: str
    precision: str

    def zeros(self, display: Size, render: Size) -> Buffers:
        """No past, and room for what a frame of this size leaves."""

    def fits(self, buffers: Buffers, display: Size, render: Size) -> bool:
        """Whether what a frame of this size leaves may be written there."""

    def step(
        self,
        frame: Frame,
        display: Size,
        past: Buffers,
        left: Buffers,
        image: Float32,
        aux_outputs: Collection[str],
        *,
        tolerance: float | None,
    ) -> Mapping[str, Float32]:
        """Upscale a checked frame.

        Args:
            frame: the frame.
            display: (W, H).
            past: what the frame before left.
            left: where this one leaves it; not `past`.
            image: (H, W, 3), written to.
            aux_outputs: names of tensors, of those that model.json lists as such.
            tolerance: how far a tile that stays as it is, where the scene stands still, may be from what it
                was one period of the jitter before: root mean square of what a screen shows. None: all is
                drawn.

        Returns:
            Those tensors, NCHW.
        """

    def needs(self, display: Size, render: Size) -> tuple[int, int | None]:
        """Bytes of what a frame leaves, and of all that a step works in; None where that is not known."""

    def note_stages(self) -> Mapping[str, float]:
        """From now on add up wall seconds by stage, there; nothing where stages are not known."""

    def tensor(self, buffers: Buffers, name: str) -> Float32:
        """A history tensor of the contract, NCHW, in memory."""

    def memory(self, buffers: Buffers) -> Mapping[str, NDArray[Any]]:
        """Copies of what else goes from frame to frame, by names of the executor's own."""

    def work(self, buffers: Buffers, display: Size) -> Float32:
        """Share of a whole step's work that the step that left these did: (rows, columns) of tiles."""

    def load(self, buffers: Buffers, tensors: Mapping[str, NDArray[Any]]) -> None:
        """Fill buffers with all history tensors of the contract; shapes are as they must be.

        What `memory` copied may lie among them, of this executor or of another.
        """
