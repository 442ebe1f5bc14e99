"""An ONNX graph in a session of ONNX Runtime, and a frame as graphs take it."""

from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import onnxruntime as ort

from supersampler.display import usable_exposure
from supersampler.errors import ModelError
from supersampler.frame import Float32, Frame, Size
from supersampler.gbuffers import GBUFFERS

Provider = str | tuple[str, dict[str, str]]
"""An execution provider's name, with options or without."""


def session_options(threads: int) -> ort.SessionOptions:
    """Return what all sessions have in common; 0 threads take every core."""
    options = ort.SessionOptions()
    options.log_severity_level = 3  # errors only; the rest would print over a progress bar
    options.intra_op_num_threads = threads
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    return options


def open_session(
    path: Path, options: ort.SessionOptions, providers: Sequence[Provider], graph: bytes | None = None
) -> ort.InferenceSession:
    """Load the graph at `path`, or in its place the one that was made of it.

    Raises:
        ModelError: ONNX Runtime cannot.
    """
    try:
        return ort.InferenceSession(graph or str(path), options, providers=list(providers))
    except Exception as error:  # ONNX Runtime's own exceptions share no base but this one
        raise ModelError(f"{path}: ONNX Runtime cannot load it: {error}") from error


def frame_inputs(frame: Frame, display_size: Size, names: Collection[str]) -> dict[str, np.ndarray[Any, Any]]:
    """What a graph takes of a frame that has it, by name: images as contiguous NCHW, vectors for the rest."""
    vectors = vector_inputs(frame.jitter, frame.exposure, display_size)
    return {name: vectors[name] if name in vectors else planes_of(image_of(frame, name)) for name in names}


def image_of(frame: Frame, name: str) -> np.ndarray[Any, Any]:
    """The image that a graph has this name for, as it is in a frame that has it."""
    image: Any = GBUFFERS[name].find(frame) if name in GBUFFERS else getattr(frame, name)
    return np.asarray(image)


def vector_inputs(
    jitter: tuple[float, float], exposure: float | None, display_size: Size
) -> dict[str, np.ndarray[Any, Any]]:
    """What a graph takes of a frame beside images, by name."""
    return {
        "jitter": np.array([jitter], np.float32),
        "exposure": np.array([usable_exposure(exposure) or 0.0], np.float32),
        "display_size": np.array(display_size, np.int64),
    }


def planes_of(image: np.ndarray[Any, Any]) -> Float32:
    """(h, w, c) or (h, w) as contiguous (1, c, h, w)."""
    planes = image.transpose(2, 0, 1)[None] if image.ndim == 3 else image[None, None]
    return np.ascontiguousarray(planes, np.float32)


def pixels_of(planes: Float32) -> Float32:
    """(1, c, h, w) as a contiguous copy (h, w, c), (h, w) where c is 1."""
    pixels: Float32 = planes[0, 0] if planes.shape[1] == 1 else planes[0].transpose(1, 2, 0)
    return pixels.copy()
