"""Inputs of a method from a training frame, by name."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from supersampler.errors import ArgumentError
from supersampler.methods.gbuffers import GBUFFERS
from supersampler_model.data.dataset import TrainingFrame


def frame_inputs(frame: TrainingFrame, names: Sequence[str]) -> list[Tensor]:
    """Return the inputs of these names, in their order.

    Raises:
        ArgumentError: the frame lacks one.
    """
    images = {**gbuffers(frame), "color": frame.color, "depth": frame.depth, "motion": frame.motion}
    numbers = {
        "jitter": torch.tensor([frame.jitter], dtype=torch.float32),
        "exposure": torch.tensor([frame.exposure], dtype=torch.float32),
        "pre_exposure": torch.ones(1),
        "adds_samples": torch.ones(1),
        "reactive": torch.zeros(1, 1, *frame.depth.shape),
        "display_size": torch.tensor(frame.reference.shape[1::-1]),
    }
    if missing := [name for name in names if name not in images and name not in numbers]:
        want = "frames with G-buffers of both sizes: `supersampler render --gbuffers --also 2,4`"
        raise ArgumentError("data", got=f"frames without {', '.join(missing)}", want=want)
    return [numbers[name] if name in numbers else planes(images[name]) for name in names]


def gbuffers(frame: TrainingFrame) -> dict[str, NDArray[Any]]:
    """G-buffers of both sizes by input name, as stored."""
    found = {name: (getattr(frame, place.group) or {}).get(place.key) for name, place in GBUFFERS.items()}
    return {name: image for name, image in found.items() if image is not None}


def planes(image: NDArray[Any]) -> Tensor:
    """(h, w) or (h, w, c) to (1, c, h, w) float32; uint8 to [0, 1]."""
    channels = image[..., None] if image.ndim == 2 else image
    tensor = torch.from_numpy(np.array(channels.transpose(2, 0, 1), np.float32, order="C"))[None]
    return tensor / 255.0 if image.dtype == np.uint8 else tensor
