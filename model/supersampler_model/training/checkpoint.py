"""Checkpoints: all that a run needs to go on as if it had not been stopped, and what it was made from."""

import hashlib
import pickle
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import torch

from supersampler.errors import ArgumentError
from supersampler.io.atomic import replacing
from supersampler_model.data.dataset import Dataset

VERSION = 2


def save_checkpoint(path: Path, content: dict[str, Any]) -> None:
    """Write a checkpoint, in one piece or not at all."""
    with replacing(path) as partial:
        torch.save({"version": VERSION, **content}, partial)


def load_checkpoint(path: Path) -> dict[str, Any]:
    """Read a checkpoint.

    Raises:
        ArgumentError: it is none, or of another version.
    """
    try:
        content = torch.load(path, map_location="cpu", weights_only=True)
    except (OSError, RuntimeError, ValueError, EOFError, pickle.UnpicklingError) as error:
        raise ArgumentError("checkpoint", got=f"{path}: {error}", want="one that training wrote") from error
    if not isinstance(content, dict) or content.get("version") != VERSION:
        raise ArgumentError("checkpoint", got=str(path), want=f"a checkpoint of version {VERSION}")
    return content


def data_hash(datasets: Sequence[Dataset]) -> str:
    """What the sets are made of: sha256 of their descriptions."""
    digest = hashlib.sha256()
    for dataset in datasets:
        digest.update(repr(dataset.description).encode())
    return digest.hexdigest()


def assets(datasets: Sequence[Dataset]) -> list[str]:
    """Names of the files that training sequences are composed of: their licences may ask to be named."""
    entries = [entry for dataset in datasets for entry in dataset.entries("train")]
    return sorted({name for entry in entries for name, _ in entry.spec.files})


def source_commit() -> str:
    """The commit of the code that runs, `unknown` outside a repository, with `+` where it was changed."""
    here = Path(__file__).parent
    try:
        run = subprocess.run(
            ["git", "describe", "--always", "--dirty=+", "--abbrev=12"],  # noqa: S607
            cwd=here, capture_output=True, text=True, timeout=10, check=True,
        )  # fmt: skip
    except (OSError, subprocess.SubprocessError):
        return "unknown"
    return run.stdout.strip()
