"""Inputs of a step in torch: those of a frame, and those that most tests leave as they are."""

from collections.abc import Collection

import torch
from torch import Tensor

from supersampler.backends.onnx.session import frame_inputs
from supersampler.frame import Frame, Size


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
