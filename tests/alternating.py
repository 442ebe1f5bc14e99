"""Steps of an engine that shades only some frames, for the tests of extrapolation."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import torch

from supersampler import Frame, Upscaler, halton_jitter
from supersampler.frame import Float32, Size
from supersampler_model.methods.base import Method
from torch_inputs import step_by_name, tensors_of

Shaded = Callable[[int], Frame]
"""Every frame of a scene, with its colour."""


@dataclass(frozen=True)
class Frames:
    """Frames of a scene by their numbers, with colour; called with further fields that replace those."""

    scene: Any
    size: Size

    def __call__(self, index: int, size: Size | None = None, **fields: Any) -> Frame:
        frame: Frame = self.scene.frame(index, size or self.size, halton_jitter(index, 2.0), **fields)
        return frame

    def unshaded(self, index: int, **fields: Any) -> Frame:
        return self(index, color=None, **fields)

    def run(self, upscaler: Upscaler, pattern: str, start: int = 0) -> list[Float32]:
        """Step through frames: "s" is shaded, "u" is not."""
        return [
            upscaler.step(self(index)) if kind == "s" else upscaler.extrapolate(self.unshaded(index))
            for index, kind in enumerate(pattern, start)
        ]


def extrapolated_by_torch(method: Method, shaded: Shaded, pattern: str) -> list[Float32 | None]:
    """Return the colours (h, w, 3) that a method extrapolates for unshaded frames; None for shaded ones."""
    history: list[torch.Tensor] | None = None
    made: list[Float32 | None] = []
    for index, kind in enumerate(pattern):
        frame, names = shaded(index), [*method.inputs(), "color"]
        height, width = frame.depth.shape
        inputs = tensors_of(frame, (width, height), names)
        if kind == "s":
            history = method.after_shaded(inputs, history)
            made.append(None)
            continue
        assert history is not None
        image, history, _ = step_by_name(method, inputs, history)
        made.append(image[0].numpy().transpose(1, 2, 0))
    return made
