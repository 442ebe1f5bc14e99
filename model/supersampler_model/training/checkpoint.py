"""Checkpoints: the state that a run resumes from, and the provenance of weights."""

import hashlib
import pickle
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import torch

from supersampler.errors import ArgumentError
from supersampler.io.child_process import run
from supersampler.io.files import replacing
from supersampler_model.data.dataset import Dataset

CHECKPOINT = "checkpoint.pt"
"""Name in the folder of a run."""
VERSION = 4


def save_checkpoint(path: Path, content: dict[str, Any]) -> None:
    """Write a checkpoint atomically."""
    with replacing(path) as partial:
        torch.save({"version": VERSION, **content}, partial)


def load_checkpoint(path: Path) -> dict[str, Any]:
    """Read a checkpoint.

    Raises:
        ArgumentError: the file is no checkpoint, or of another version.
    """
    try:
        content = torch.load(path, map_location="cpu", weights_only=True)
    except (OSError, RuntimeError, ValueError, EOFError, pickle.UnpicklingError) as error:
        raise ArgumentError("checkpoint", got=f"{path}: {error}", want="one that training wrote") from error
    if not isinstance(content, dict) or content.get("version") != VERSION:
        raise ArgumentError("checkpoint", got=str(path), want=f"a checkpoint of version {VERSION}")
    return content


def data_hash(datasets: Sequence[Dataset]) -> str:
    """sha256 of the descriptions of the data sets."""
    digest = hashlib.sha256()
    for dataset in datasets:
        digest.update(repr(dataset.description).encode())
    return digest.hexdigest()


def assets(datasets: Sequence[Dataset]) -> list[str]:
    """Names of the asset files in the training sequences, for attribution."""
    entries = [entry for dataset in datasets for entry in dataset.entries("train")]
    return sorted({name for entry in entries for name, _ in entry.spec.files})


def source_commit() -> str:
    """Commit of the running code, with `+` if it was modified; `unknown` outside a repository."""
    here = Path(__file__).parent
    try:
        done = run(["git", "describe", "--always", "--dirty=+", "--abbrev=12"], folder=here, seconds=10)
        done.check_returncode()
    except (OSError, subprocess.SubprocessError):
        return "unknown"
    return done.stdout.decode().strip()
