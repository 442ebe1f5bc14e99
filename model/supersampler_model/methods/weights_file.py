"""Weights files: safetensors whose header holds method, config and provenance."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

from safetensors import SafetensorError, safe_open
from safetensors.torch import save_file
from torch import Tensor

from supersampler.errors import ArgumentError
from supersampler.io.files import replacing
from supersampler.methods.registry import find_method


class Trained(NamedTuple):
    """Weights of one method.

    Attributes:
        method: its name.
        config: of the method, plain data.
        facts: provenance: steps, hash of the data, commit, scores.
        tensors: by name.
    """

    method: str
    config: dict[str, Any]
    facts: dict[str, Any]
    tensors: dict[str, Tensor]


def shipped_weights(method: str) -> Path:
    """Return the path of a method's released weights.

    Raises:
        ArgumentError: it has none.
    """
    spec = find_method(method)
    if spec is None or not spec.weights:
        raise ArgumentError("--weights", got=None, want=f"a file, as none ship for {method}")
    return Path(__file__).parents[1] / "weights" / spec.weights


def save_trained(path: Path, trained: Trained) -> None:
    """Write a weights file atomically."""
    header = {name: getattr(trained, name) for name in ("method", "config", "facts")}
    with replacing(path) as partial:
        save_file(trained.tensors, partial, {"trained": json.dumps(header, sort_keys=True)})


def load_trained(path: Path) -> Trained:
    """Read weights.

    Raises:
        ArgumentError: the file is missing, damaged, or no weights file.
    """
    try:
        with safe_open(path, "pt") as file:
            header: Mapping[str, Any] = json.loads(file.metadata()["trained"])
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118 - no mapping
        return Trained(header["method"], header["config"], header["facts"], tensors)
    except (OSError, SafetensorError, KeyError, TypeError, ValueError) as error:
        raise ArgumentError(
            "weights", got=f"{path} ({error})", want="a weights.safetensors that `supersampler train` wrote"
        ) from error
