"""Helpers that make, replay and change recordings, with matching checksums."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from shared_models import shared_model
from supersampler import Model, Upscaler
from supersampler.io.safetensors import open_safetensors, write_safetensors
from supersampler.recording import _crc_of, open_recording
from supersampler.recording.replay import Replay, Replayed

DISPLAY = (64, 36)


def recorded(file: Path, model: Model | None = None, **arguments: Any) -> Upscaler:
    """Return an Upscaler that records its calls, of `taau` by default."""
    model = model or shared_model("taau")
    return Upscaler(model, **{"display_size": DISPLAY, "validate": "off", "record": file, **arguments})


def replayed(file: Path, **arguments: Any) -> list[Replayed]:
    replay = Replay(open_recording(file), **arguments)
    return [step for step in map(replay.call, replay.recording) if step is not None]


def read(path: Path) -> tuple[str, dict[str, NDArray[Any]]]:
    tensors, texts = open_safetensors(path)
    return texts["record"], {name: np.array(array) for name, array in tensors.items()}


def rewrite(path: Path, text: str, arrays: Mapping[str, NDArray[Any]]) -> None:
    """Write a file of a recording with a matching checksum, whatever its text is."""
    write_safetensors(path, arrays, {"record": text, "crc32": str(_crc_of(text, arrays))})
