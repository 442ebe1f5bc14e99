"""Inputs of a step in torch that most tests leave as they are: no reactive mask, no pre-exposure."""

import torch
from torch import Tensor

from supersampler.frame import Size


def plain_inputs(render: Size) -> dict[str, Tensor]:
    """Return `reactive`, `pre_exposure` and `adds_samples` of an ordinary frame of size (width, height)."""
    width, height = render
    return {
        "reactive": torch.zeros(1, 1, height, width),
        "pre_exposure": torch.ones(1),
        "adds_samples": torch.ones(1),
    }
