"""Files of training frames: safetensors, memory-mapped, so that only the pixels of a crop are read."""

import json
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
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

_TYPES = {
    "color": np.float16, "depth": np.float32, "motion": np.float16, "reference": np.float16,
    "ghost": np.uint8, "alias": np.uint8,
}  # fmt: skip
_DISPLAY, _RENDER = "display.", "render."  # prefixes of G-buffers
GBuffers = dict[str, NDArray[Any]]


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
        gbuffer_display: display-size G-buffers by name: `normal` float16, `depth` float32, the others uint8
            for [0, 1]; None where the set has none.
        gbuffer: render-size G-buffers, without depth; None unless the frame was rendered a second time.
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
    gbuffer_display: GBuffers | None = None
    gbuffer: GBuffers | None = None

    def frame(self) -> Frame:
        """Return the input of an `Upscaler`."""
        return Frame(
            color=self.color, depth=self.depth, motion=self.motion, jitter=self.jitter, reset=self.reset,
            exposure=self.exposure, gbuffer=_in_unit_range(self.gbuffer),
            gbuffer_display=_in_unit_range(self.gbuffer_display),
        )  # fmt: skip


class Rerendered(NamedTuple):
    """The inputs of a frame rendered a second time at another ratio; see `TrainingFrame`."""

    color: NDArray[np.float16]
    depth: NDArray[np.float32]
    motion: NDArray[np.float16]
    jitter: tuple[float, float]
    gbuffer: GBuffers


def write_training_frame(path: Path, frame: TrainingFrame) -> None:
    """Write one frame atomically.

    Raises:
        OSError: writing failed.
    """
    tensors = {name: getattr(frame, name) for name in _TYPES}
    numbers = {"jitter": frame.jitter, "reset": frame.reset, "exposure": frame.exposure}
    _write(path, tensors, _DISPLAY, frame.gbuffer_display or {}, numbers)


def read_training_frame(path: Path) -> TrainingFrame:
    """Memory-map one frame.

    Raises:
        DatasetError: the file is missing, cut off, or lacks a tensor.
    """
    with _damage_named(path):
        fields, gbuffer = _read(path, _DISPLAY)
        frame = TrainingFrame(**fields, gbuffer_display=gbuffer or None)
        _check(frame)
    return frame


def write_rerendered(path: Path, rerendered: Rerendered) -> None:
    """Write a second rendering atomically.

    Raises:
        OSError: writing failed.
    """
    tensors = {name: getattr(rerendered, name) for name in ("color", "depth", "motion")}
    _write(path, tensors, _RENDER, rerendered.gbuffer, {"jitter": rerendered.jitter})


def read_rerendered(path: Path) -> Rerendered:
    """Memory-map a second rendering.

    Raises:
        DatasetError: the file is missing, cut off, or lacks a tensor.
    """
    with _damage_named(path):
        fields, gbuffer = _read(path, _RENDER)
        return Rerendered(**fields, gbuffer=gbuffer)


def _check(frame: TrainingFrame) -> None:
    """Raise a ValueError where arrays or numbers are not those of a frame."""
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


def _write(
    path: Path, tensors: GBuffers, prefix: str, gbuffer: Mapping[str, NDArray[Any]], numbers: dict[str, Any]
) -> None:
    stored = {name: array.astype(_TYPES[name], copy=False) for name, array in tensors.items()}
    for name, array in gbuffer.items():
        stored[prefix + name] = _to_bytes(array) if name in UNIT_BUFFERS else array
    content = save(
        {name: np.ascontiguousarray(array) for name, array in stored.items()},
        metadata={"frame": json.dumps(numbers)},  # in one entry: safetensors keeps no order of several
    )
    with replacing(path) as partial:
        partial.write_bytes(content)


def _read(path: Path, prefix: str) -> tuple[dict[str, Any], GBuffers]:
    """Return the tensors and numbers by name, and the G-buffers with this prefix."""
    tensors, metadata = open_safetensors(path)
    numbers = json.loads(metadata["frame"])
    x, y = (float(value) for value in numbers.pop("jitter"))
    for name, array in tensors.items():
        if name in _TYPES and array.dtype != _TYPES[name]:
            raise TypeError(f"{name} is {array.dtype}")
    gbuffer = {n.removeprefix(prefix): tensors.pop(n) for n in list(tensors) if n.startswith(prefix)}
    return {**tensors, **numbers, "jitter": (x, y)}, gbuffer


@contextmanager
def _damage_named(path: Path) -> Iterator[None]:
    """Convert errors of damaged content to a DatasetError that names the file."""
    hint = "Delete it and render again: what is complete is kept."
    try:
        yield
    except ShotError as error:
        raise DatasetError(path, f"not a whole training frame: {error.problem}", hint) from error
    except (ValueError, KeyError, TypeError, AttributeError, OverflowError, RecursionError) as error:
        problem = f"not a whole training frame ({type(error).__name__}: {error})"
        raise DatasetError(path, problem, hint) from error


def _in_unit_range(buffers: GBuffers | None) -> GBuffers | None:
    """Convert uint8 buffers to [0, 1]."""
    if buffers is None:
        return None
    return {n: a.astype(np.float32) / 255.0 if n in UNIT_BUFFERS else a for n, a in buffers.items()}


def _to_bytes(values: NDArray[Any]) -> NDArray[np.uint8]:
    if values.dtype == np.uint8:
        return values
    return (np.clip(values.astype(np.float32), 0.0, 1.0) * 255.0 + 0.5).astype(np.uint8)
