"""How a model runs: what `Model` asks of ONNX Runtime's graph, and of kernels on this processor."""

from collections.abc import Collection, Mapping
from typing import Any, Protocol

from supersampler.frame import Float32, Frame, Size

Buffers = Any
"""What one frame leaves for the next, in the form and place that suits an executor."""


class Executor(Protocol):
    """Runs steps; keeps nothing between them that a result depends on. Shareable between threads.

    Attributes:
        name: "graph" or "host".
        precision: "fp32", or "int8" where the learned part runs in bytes.
    """

    name: str
    precision: str

    def zeros(self, display: Size, render: Size) -> Buffers:
        """No past, and room for what a frame of this size leaves."""

    def fits(self, buffers: Buffers, display: Size, render: Size) -> bool:
        """Whether what a frame of this size leaves may be written there."""

    def step(
        self, frame: Frame, display: Size, past: Buffers, left: Buffers, image: Float32, told: Collection[str]
    ) -> Mapping[str, Float32]:
        """Upscale a checked frame.

        Args:
            frame: the frame.
            display: (W, H).
            past: what the frame before left.
            left: where this one leaves it; not `past`.
            image: (H, W, 3), written to.
            told: names of tensors, of those that model.json lists as told.

        Returns:
            The told tensors, NCHW.
        """

    def tensor(self, buffers: Buffers, name: str) -> Float32:
        """A history tensor of the contract, NCHW, in memory."""

    def load(self, buffers: Buffers, tensors: Mapping[str, Float32]) -> None:
        """Fill buffers with all history tensors of the contract; shapes are as they must be."""
