"""Sessions of ONNX Runtime, and the inputs that graphs read from a frame."""

import sys
import traceback
from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from supersampler.backends.onnx.graph_file import refusal_of
from supersampler.backends.onnx.runtime import CPU, OnnxRun, keep_in_forks, ort, precise
from supersampler.errors import ModelError, ProviderError
from supersampler.frame import Float32, Frame, Size
from supersampler.io.display import usable_exposure
from supersampler.methods.at_rest import ADDS_SAMPLES
from supersampler.methods.gbuffers import GBUFFERS
from supersampler.methods.model_file import MAX_FILE, is_shipped
from supersampler.methods.model_info import TensorInfo
from supersampler.methods.registry import find_method

VECTORS = ("jitter", "exposure", "pre_exposure", ADDS_SAMPLES, "display_size")
"""Inputs of a graph that are not images; they stay in CPU memory."""
ORT_TYPES = {"float32": "tensor(float)", "int64": "tensor(int64)"}
"""ONNX Runtime's names of element types."""
_OWN = {"supersampler", "onnxruntime", *sys.stdlib_module_names}
"""Packages whose errors are about a graph."""


def open_session(
    path: Path,
    threads: int,
    providers: Sequence[str],
    *,
    method: str | None = None,
    inputs: Sequence[TensorInfo] = (),
    outputs: Sequence[TensorInfo] = (),
    records_placement: bool = False,
) -> "ort.InferenceSession":
    """Load the graph at `path`.

    A graph that does not ship with this package is refused if it has data in other files, or operators that
    are not ONNX's own.

    Args:
        path: the graph.
        threads: number of threads; 0 uses every core.
        providers: ONNX Runtime's names of the providers, in order of preference.
        method: the method of model.json; if it is a known one, and the graph states one, it must be the same.
        inputs: all inputs that the graph must have; empty disables the check.
        outputs: outputs that the graph must have; it may have others.
        records_placement: see `node_placement`.

    Raises:
        ModelError: the graph is too large, refused, of another method or with other tensors, or ONNX
            Runtime cannot load it.
        ProviderError: the first provider cannot start.
    """
    output_names, options = {tensor.name for tensor in outputs}, ort.SessionOptions()
    options.log_severity_level = 3  # errors only: other messages would disturb a progress bar
    options.intra_op_num_threads = threads
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    # Planning memory from the sizes of earlier runs saves no time on the CPU, and takes half as much again.
    options.enable_mem_pattern = providers[0] != CPU
    if records_placement:
        options.add_session_config_entry("session.record_ep_graph_assignment_info", "1")
    try:
        content = _content(path)
        with OnnxRun():
            session = ort.InferenceSession(content, options, providers=precise(providers))
        keep_in_forks(session)
        if providers[0] not in session.get_providers():  # ONNX Runtime falls back if libraries are missing
            raise ProviderError(
                f"{providers[0]} is installed but could not start; ONNX Runtime fell back to "
                f"{', '.join(session.get_providers())}. Its libraries (CUDA and cuDNN for "
                "CUDAExecutionProvider) are missing or of another version."
            )
        stated = session.get_modelmeta().custom_metadata_map.get("supersampler.method")
        if method is not None and find_method(method) and stated not in (None, method):
            raise ModelError(f"{path}: is a graph of {stated!r}; model.json says {method!r}.")
        if inputs:
            _check_tensors(path, "input", inputs, session.get_inputs())
        found = [node for node in session.get_outputs() if node.name in output_names]
        _check_tensors(path, "output", outputs, found)
    except (ModelError, ProviderError):
        raise
    except Exception as error:  # exceptions of ONNX Runtime have no other common base
        if _is_of_program(error):
            raise
        raise ModelError(f"{path}: ONNX Runtime cannot load it: {error}") from error
    return session


def node_placement(path: Path, provider: str) -> dict[str, Counter[str]]:
    """Return the number of nodes of the graph at `path` that each provider runs, by operator.

    ONNX Runtime assigns nodes when it loads a graph. The CPU provider gets those that `provider` cannot run.

    Raises:
        ModelError, ProviderError: see `open_session`.
    """
    session = open_session(path, 1, list(dict.fromkeys([provider, CPU])), records_placement=True)
    found: dict[str, Counter[str]] = {}
    for subgraph in session.get_provider_graph_assignment_info():
        counts = found.setdefault(subgraph.ep_name, Counter())
        counts.update(node.op_type for node in subgraph.get_nodes())
    return found


@contextmanager
def running(path: Path) -> Iterator[None]:
    """Context of a run of the graph at `path`: exceptions become ModelError; see `OnnxRun`."""
    try:
        with OnnxRun():
            yield
    except Exception as error:  # exceptions of ONNX Runtime have no other common base
        if _is_of_program(error):
            raise
        raise ModelError(f"{path}: ONNX Runtime cannot run it: {error}") from error


def _is_of_program(error: Exception) -> bool:
    """Return whether code of the program raised an error: a signal handler, which runs during any call."""
    *_, (frame, _) = traceback.walk_tb(error.__traceback__)
    return str(frame.f_globals.get("__name__")).partition(".")[0] not in _OWN


def run_bound(
    session: "ort.InferenceSession",
    path: Path,
    inputs: "Mapping[str, ort.OrtValue]",
    outputs: "Mapping[str, ort.OrtValue | str]",
) -> "ort.IOBinding":
    """Run the graph at `path`, and return the binding, which has the outputs.

    Each output is a value to write to, or the name of a device to allocate it on.
    """
    binding = session.io_binding()
    for name, value in inputs.items():
        binding.bind_ortvalue_input(name, value)
    for name, target in outputs.items():
        if isinstance(target, str):
            binding.bind_output(name, target)
        else:
            binding.bind_ortvalue_output(name, target)
    with running(path):
        binding.synchronize_inputs()  # other libraries may have written on their own streams
        session.run_with_iobinding(binding)
        binding.synchronize_outputs()
    return binding


def _content(path: Path) -> bytes:
    """Return the content of a graph; raise ModelError if ONNX Runtime must not load it."""
    if path.stat().st_size > MAX_FILE:
        raise ModelError(f"{path}: is {path.stat().st_size} bytes; want at most {MAX_FILE}.")
    content = path.read_bytes()
    refusal = None if is_shipped(path) else refusal_of(content)
    if refusal is not None:
        raise ModelError(f"{path}: {refusal}. `supersampler export` writes graphs that are accepted.")
    return content


def _check_tensors(path: Path, kind: str, wanted: Sequence[TensorInfo], nodes: Sequence[Any]) -> None:
    """Raise ModelError unless a graph's tensors have the names, types and shapes in model.json."""
    by_name = {node.name: node for node in nodes}
    if set(by_name) != {tensor.name for tensor in wanted}:
        want = ", ".join(sorted(tensor.name for tensor in wanted))
        raise ModelError(f"{path}: {kind}s are {', '.join(sorted(by_name))}; model.json says {want}.")
    for tensor in wanted:
        node = by_name[tensor.name]
        same = len(node.shape) == len(tensor.shape) and all(
            not isinstance(got, int) or got == want
            for got, want in zip(node.shape, tensor.shape, strict=True)
        )
        if node.type != ORT_TYPES[tensor.type] or not same:
            got = f"{tuple(node.shape)} {node.type}"
            raise ModelError(
                f"{path}: {kind} {tensor.name!r} is {got}; model.json says {tensor.shape} {tensor.type}."
            )


def frame_inputs(
    frame: Frame, display_size: Size, names: Collection[str], *, adds_samples: float = 1.0
) -> dict[str, np.ndarray[Any, Any]]:
    """Return a frame's inputs of a graph by name: images as contiguous NCHW float32, and VECTORS."""
    vectors = vector_inputs(
        frame.jitter, frame.exposure, display_size, frame.pre_exposure, adds_samples=adds_samples
    )
    return {name: vectors[name] if name in vectors else planes_of(image_of(frame, name)) for name in names}


def image_of(frame: Frame, name: str) -> np.ndarray[Any, Any]:
    """Return the image of a frame that a graph reads by this name."""
    if name == "reactive" and frame.reactive is None:
        return np.zeros(frame.depth.shape, np.float32)
    image: Any = GBUFFERS[name].find(frame) if name in GBUFFERS else getattr(frame, name)
    return np.asarray(image)


def vector_inputs(
    jitter: tuple[float, float],
    exposure: float | None,
    display_size: Size,
    pre_exposure: float,
    *,
    adds_samples: float,
) -> dict[str, np.ndarray[Any, Any]]:
    """Return the inputs VECTORS of a graph by name."""
    return {
        "jitter": np.array([jitter], np.float32),
        "exposure": np.array([usable_exposure(exposure) or 0.0], np.float32),
        "pre_exposure": np.array([pre_exposure], np.float32),
        ADDS_SAMPLES: np.array([adds_samples], np.float32),
        "display_size": np.array(display_size, np.int64),
    }


def planes_of(image: np.ndarray[Any, Any]) -> Float32:
    """Convert (h, w, c) or (h, w) to contiguous (1, c, h, w)."""
    planes = image.transpose(2, 0, 1)[None] if image.ndim == 3 else image[None, None]
    return np.ascontiguousarray(planes, np.float32)


def pixels_of(planes: Float32) -> Float32:
    """Return a contiguous copy of (1, c, h, w) as (h, w, c), or as (h, w) where c is 1."""
    pixels: Float32 = planes[0, 0] if planes.shape[1] == 1 else planes[0].transpose(1, 2, 0)
    return pixels.copy()
