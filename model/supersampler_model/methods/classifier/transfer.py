"""Weights of `classifier` for relatives whose network reads or blends other things, before their training."""

from collections.abc import Mapping, Sequence
from typing import Any

import torch
from torch import Tensor

from supersampler.errors import ArgumentError
from supersampler.methods.classifier.spec import ClassifierConfig
from supersampler_model.methods.classifier.model import Classifier
from supersampler_model.methods.weights_file import Trained


def transferred(trained: Trained, config: ClassifierConfig) -> Mapping[str, Tensor]:
    """Return the weights for another config of the same widths.

    Inputs and blended colours that `classifier` lacks begin at weights of 0; those that it has alone are left
    out.

    Args:
        trained: weights of `classifier`.
        config: of the relative.

    Raises:
        ArgumentError: they are of another method.
    """
    if trained.method != Classifier.name:
        raise ArgumentError("weights", got=f"of {trained.method}", want=f"of {Classifier.name}")
    theirs: Any = Classifier.configured(trained.config).config
    inputs = _places(theirs.inputs, config.inputs)
    blended = _places(_blended(theirs), _blended(config))
    tensors = dict(trained.tensors)
    for name in ("net.encoder.blocks.0.0.0.weight", "net.hidden.0.weight"):
        tensors[name] = _moved(tensors[name], inputs, 4 * theirs.planes, dim=1)
    for name in ("net.blend.weight", "net.blend.bias"):
        tensors[name] = _moved(tensors[name], blended, 4 * theirs.blend_parameters, dim=0)
    return tensors


def _blended(config: ClassifierConfig) -> tuple[str, ...]:
    """Names of the blend parameters, in their order."""
    colors = ["history", *["rectified"] * config.rectified, *["own"] * config.own_motion]
    names = [*colors, "sample", "frame", "kernel"]
    return (*names, *(f"{part}{i}" for part, count in enumerate(config.filters) for i in range(count)))


def _places(theirs: Sequence[str], own: Sequence[str]) -> list[int]:
    """Index in `theirs` of each of our names; -1: not there."""
    return [theirs.index(name) if name in theirs else -1 for name in own]


def _moved(weight: Tensor, places: Sequence[int], packed: int, dim: int) -> Tensor:
    """Take groups of four channels from their places along an axis; what follows `packed` channels stays."""
    groups, rest = weight.split_with_sizes([packed, weight.shape[dim] - packed], dim=dim)
    none = torch.zeros_like(groups.narrow(dim, 0, 4))
    moved = [groups.narrow(dim, 4 * place, 4) if place >= 0 else none for place in places]
    return torch.cat([*moved, rest], dim=dim)
