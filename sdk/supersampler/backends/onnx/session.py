"""An ONNX graph in a session of ONNX Runtime, and a frame as graphs take it."""

from collections.abc import Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from supersampler.backends.onnx.graph_file import refusal_of
from supersampler.backends.onnx.runs import OnnxRun
from supersampler.backends.onnx.runtime import ort
from supersampler.errors import ModelError
from supersampler.frame import Float32, Frame, Size
from supersampler.io.display import usable_exposure
from supersampler.methods.gbuffers import GBUFFERS
from supersampler.methods.model_file import MAX_FILE, is_shipped
from supersampler.methods.model_info import TensorInfo

ORT_TYPES = {"float32": "tensor(float)", "int64": "tensor(int64)"}
"""ONNX Runtime's names of types."""
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
    path: Path,
    options: ort.SessionOptions,
    providers: Sequence[Provider],
    graph: bytes | None = None,
    *,
    takes: Iterable[TensorInfo] = (),
    gives: Iterable[TensorInfo] = (),
) -> ort.InferenceSession:
    """Load the graph at `path`, or in its place the one that was made of it.

    ONNX Runtime sees no graph that has data in other files, or operators that are not ONNX's own. Those that
    ship with this package are known to have neither.

    Args:
        path: of the graph.
        options: of the session.
        providers: execution providers, in order.
        graph: made of the one at `path`.
        takes: all inputs of the graph; none are checked where there are none.
        gives: outputs that it has, others among them; likewise.

    Raises:
        ModelError: it is too large, not a plain graph, or not one of these tensors; or ONNX Runtime cannot.
    """
    inputs, outputs = list(takes), list(gives)
    named = {tensor.name for tensor in outputs}
    try:
        session = ort.InferenceSession(graph or _content(path), options, providers=list(providers))
        if inputs:
            _check_tensors(path, "input", inputs, session.get_inputs())
        there = [node for node in session.get_outputs() if node.name in named]
        _check_tensors(path, "output", outputs, there)
    except ModelError:
        raise
    except Exception as error:  # ONNX Runtime's own exceptions share no base but this one
        raise ModelError(f"{path}: ONNX Runtime cannot load it: {error}") from error
    return session


@contextmanager
def running(path: Path) -> Iterator[None]:
    """A run of the graph at `path`: turns what ONNX Runtime raises into ModelError; see `OnnxRun`."""
    try:
        with OnnxRun():
            yield
    except Exception as error:  # ONNX Runtime's own exceptions share no base but this one
        raise ModelError(f"{path}: ONNX Runtime cannot run it: {error}") from error


def _content(path: Path) -> bytes:
    """The bytes of a graph that ONNX Runtime may see."""
    if path.stat().st_size > MAX_FILE:
        raise ModelError(f"{path}: is {path.stat().st_size} bytes; want at most {MAX_FILE}.")
    content = path.read_bytes()
    refusal = None if is_shipped(path) else refusal_of(content)
    if refusal is not None:
        raise ModelError(f"{path}: {refusal}. `supersampler export` writes graphs that are taken.")
    return content


def _check_tensors(path: Path, kind: str, wanted: Sequence[TensorInfo], nodes: Sequence[Any]) -> None:
    """Raise ModelError unless a graph's inputs or outputs are model.json's: by name, type and shape."""
    there = {node.name: node for node in nodes}
    if set(there) != {tensor.name for tensor in wanted}:
        want = ", ".join(sorted(tensor.name for tensor in wanted))
        raise ModelError(f"{path}: {kind}s are {', '.join(sorted(there))}; model.json says {want}.")
    for tensor in wanted:
        node = there[tensor.name]
        same = len(node.shape) == len(tensor.shape) and all(
            got == want if isinstance(got, int) else True
            for got, want in zip(node.shape, tensor.shape, strict=True)
        )
        if node.type != ORT_TYPES[tensor.type] or not same:
            got = f"{tuple(node.shape)} {node.type}"
            raise ModelError(
                f"{path}: {kind} {tensor.name!r} is {got}; model.json says {tensor.shape} {tensor.type}."
            )


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
