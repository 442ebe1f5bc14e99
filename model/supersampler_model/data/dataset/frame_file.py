"""Files of training frames: safetensors, memory-mapped, so that only the pixels of a crop are read."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from safetensors.numpy import save

from supersampler import Frame
from supersampler.errors import ShotError
from supersampler.io.files import replacing
from supersampler.io.shot.safetensors import open_safetensors
from supersampler_model.data.errors import DatasetError
from supersampler_model.data.rendered import UNIT_BUFFERS

_AGAIN = "Delete it and render again: what is complete is kept."
_TYPES = {"F16": np.float16, "F32": np.float32, "U8": np.uint8}
_STORED = {"color": "F16", "depth": "F32", "motion": "F16", "reference": "F16", "ghost": "U8", "alias": "U8"}
_DISPLAY, _RENDER = "display.", "render."


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrainingFrame:
    """Inputs of a method in one frame, and the reference.

    Arrays that were read are read-only views into the file: slice them before converting them.

    Attributes:
        color: (h, w, 3) float16 linear RGB, at pixel centre + jitter.
        depth: (h, w) float32 reversed.
        motion: (h, w, 2) float16 render pixels, previous minus current.
        jitter: (x, y) render pixels.
        reset: True on the first frame after a cut.
        exposure: > 0.
        reference: (H, W, 3) float16 linear RGB.
        ghost, alias: (H, W) uint8 classes, `labels.Ghost` and `labels.Alias`.
        gbuffer_display: at display size, by name: `normal` float16, `depth` float32, the others uint8 of
            [0, 1]; None where the set has none.
        gbuffer: the same at render size, without depth; None unless the frame was rendered a second time.
    """

    color: NDArray[np.float16]
    depth: NDArray[np.float32]
    motion: NDArray[np.float16]
    jitter: tuple[float, float]
    reset: bool
    exposure: float
    reference: NDArray[np.float16]
    ghost: NDArray[np.uint8]
    alias: NDArray[np.uint8]
    gbuffer_display: dict[str, NDArray[Any]] | None = None
    gbuffer: dict[str, NDArray[Any]] | None = None

    def frame(self) -> Frame:
        """Return the input of an `Upscaler`."""
        return Frame(
            color=self.color,
            depth=self.depth,
            motion=self.motion,
            jitter=self.jitter,
            reset=self.reset,
            exposure=self.exposure,
            gbuffer=unit_range(self.gbuffer),
            gbuffer_display=unit_range(self.gbuffer_display),
        )


def unit_range(buffers: dict[str, NDArray[Any]] | None) -> dict[str, NDArray[Any]] | None:
    """Convert uint8 buffers to [0, 1]."""
    if buffers is None:
        return None
    return {n: a.astype(np.float32) / 255.0 if n in UNIT_BUFFERS else a for n, a in buffers.items()}


def write_training_frame(path: Path, frame: TrainingFrame) -> None:
    """Write one frame atomically.

    Raises:
        OSError: writing failed.
    """
    tensors = {name: getattr(frame, name) for name in _STORED}
    tensors |= _rounded(_DISPLAY, frame.gbuffer_display or {})
    _write(path, tensors, {"jitter": frame.jitter, "reset": frame.reset, "exposure": frame.exposure})


def read_training_frame(path: Path) -> TrainingFrame:
    """Memory-map one frame.

    Raises:
        DatasetError: the file is missing, cut off, or lacks a tensor.
    """
    tensors, numbers = _read(path)
    display = _split_off(_DISPLAY, tensors)
    try:
        frame = TrainingFrame(**tensors, **numbers, gbuffer_display=display or None)  # type: ignore[arg-type]
        _check(frame)
    except (TypeError, ValueError) as error:
        raise _damaged(path, error) from error
    return frame


def _check(frame: TrainingFrame) -> None:
    """Raise a TypeError or ValueError where arrays or numbers are not those of a frame."""
    render, display = frame.depth.shape, frame.ghost.shape
    shapes = {
        "color": (*render, 3), "motion": (*render, 2), "reference": (*display, 3), "alias": display,
        "depth": render[:2], "ghost": display[:2],
    }  # fmt: skip
    for name, shape in shapes.items():
        if getattr(frame, name).shape != shape or 0 in shape:
            raise ValueError(f"{name} is {getattr(frame, name).shape}")
    for name, array in (frame.gbuffer_display or {}).items():
        if array.shape[:2] != display:
            raise ValueError(f"{_DISPLAY}{name} is {array.shape}")
    if type(frame.reset) is not bool or type(frame.exposure) not in (int, float) or not frame.exposure > 0:
        raise ValueError(f"reset is {frame.reset!r}, exposure {frame.exposure!r}")


class Rerendered(NamedTuple):
    """The inputs of a frame rendered a second time at another ratio; see `TrainingFrame`."""

    color: NDArray[np.float16]
    depth: NDArray[np.float32]
    motion: NDArray[np.float16]
    jitter: tuple[float, float]
    gbuffer: dict[str, NDArray[Any]]


def write_rerendered(path: Path, rerendered: Rerendered) -> None:
    """Write a second rendering atomically.

    Raises:
        OSError: writing failed.
    """
    tensors = {name: getattr(rerendered, name) for name in ("color", "depth", "motion")}
    _write(path, tensors | _rounded(_RENDER, rerendered.gbuffer), {"jitter": rerendered.jitter})


def read_rerendered(path: Path) -> Rerendered:
    """Memory-map a second rendering.

    Raises:
        DatasetError: the file is missing, cut off, or lacks a tensor.
    """
    tensors, numbers = _read(path)
    gbuffer = _split_off(_RENDER, tensors)
    try:
        return Rerendered(**tensors, **numbers, gbuffer=gbuffer)  # type: ignore[arg-type]
    except TypeError as error:
        raise _damaged(path, error) from error


def _split_off(prefix: str, tensors: dict[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """Remove and return the tensors with a prefix."""
    return {n.removeprefix(prefix): tensors.pop(n) for n in list(tensors) if n.startswith(prefix)}


def _write(path: Path, tensors: dict[str, NDArray[Any]], numbers: dict[str, Any]) -> None:
    kinds = {name: _TYPES[_STORED[name]] for name in tensors if name in _STORED}
    stored = {name: a.astype(kinds[name], copy=False) if name in kinds else a for name, a in tensors.items()}
    content = save(
        {name: np.ascontiguousarray(array) for name, array in stored.items()},
        metadata={"frame": json.dumps(numbers)},  # in one entry: safetensors keeps no order of several
    )
    with replacing(path) as partial:
        partial.write_bytes(content)


def _read(path: Path) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
    """Memory-map the tensors, and read the numbers."""
    try:
        tensors, metadata = open_safetensors(path)
        numbers = json.loads(metadata["frame"])
        x, y = (float(value) for value in numbers.pop("jitter"))
    except ShotError as error:
        raise DatasetError(path, f"not a whole training frame: {error.problem}", _AGAIN) from error
    except (ValueError, KeyError, TypeError, AttributeError, OverflowError, RecursionError) as error:
        raise _damaged(path, error) from error
    for name, array in tensors.items():
        if name in _STORED and array.dtype != _TYPES[_STORED[name]]:
            raise _damaged(path, TypeError(f"{name} is {array.dtype}"))
    return tensors, {**numbers, "jitter": (x, y)}


def _damaged(path: Path, error: Exception) -> DatasetError:
    return DatasetError(path, f"not a whole training frame ({type(error).__name__}: {error})", _AGAIN)


def _rounded(prefix: str, buffers: Mapping[str, NDArray[Any]]) -> dict[str, NDArray[Any]]:
    """Return G-buffers as they are stored: [0, 1] as 0 to 255."""
    return {
        prefix + name: _bytes(array) if name in UNIT_BUFFERS else array for name, array in buffers.items()
    }


def _bytes(values: NDArray[Any]) -> NDArray[np.uint8]:
    if values.dtype == np.uint8:
        return values
    return (np.clip(values.astype(np.float32), 0.0, 1.0) * 255.0 + 0.5).astype(np.uint8)
