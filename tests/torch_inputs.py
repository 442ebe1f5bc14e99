"""Inputs of a step in torch, those of a frame and those that most tests leave as they are, and the step."""

from collections.abc import Collection, Mapping
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from supersampler.backends.onnx.session import frame_inputs
from supersampler.frame import Float32, Frame, Size
from supersampler_model import ops
from supersampler_model.methods.base import Method, Outputs


def tensors_of(
    frame: Frame, display: Size, names: Collection[str], *, adds_samples: float = 1.0
) -> dict[str, Tensor]:
    """Return these inputs of a step on a frame by name."""
    arrays = frame_inputs(frame, display, names, adds_samples=adds_samples)
    return {name: torch.from_numpy(array) for name, array in arrays.items()}


def plain_inputs(render: Size) -> dict[str, Tensor]:
    """Return `reactive`, `pre_exposure` and `adds_samples` of an ordinary frame of size (width, height)."""
    width, height = render
    return {
        "reactive": torch.zeros(1, 1, height, width),
        "pre_exposure": torch.ones(1),
        "adds_samples": torch.ones(1),
    }


@torch.no_grad()
def step_by_name(method: Method, inputs: Mapping[str, Tensor], history: list[Tensor]) -> Outputs:
    """Step with those of the inputs that the method takes."""
    return method.step(*(inputs[name] for name in method.inputs()), *history)


class Stepped:
    """A method that steps through frames, with its history."""

    def __init__(self, method: Method, display: Size, adds_samples: float = 1.0) -> None:
        self.method, self.display, self.adds_samples = method, display, adds_samples
        self.history: list[Tensor] = []

    def step(self, frame: Frame) -> Float32:
        if frame.reset or not self.history:
            self.history = self.method.first_history(ops.Size(*self.display), ops.Size(*frame.size))
        names = self.method.inputs()
        inputs = tensors_of(frame, self.display, names, adds_samples=self.adds_samples)
        image, self.history, aux_outputs = step_by_name(self.method, inputs, self.history)
        self.frozen: Float32 = (aux_outputs or [torch.zeros(1, 1, 1, 1)])[-1][0, 0].numpy()
        return np.asarray(image[0].permute(1, 2, 0).numpy())

    def tensor(self, name: str) -> NDArray[Any]:
        return np.asarray(self.history[list(self.method.history).index(name)].numpy())
