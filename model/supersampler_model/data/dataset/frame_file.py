"""One frame of a training set in one file: safetensors, read by memory map, so that a crop costs a crop."""

import json
import mmap
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from safetensors.numpy import save

from supersampler import Frame
from supersampler.files import replacing
from supersampler_model.data.errors import DatasetError

_TYPES = {"F16": np.float16, "F32": np.float32, "U8": np.uint8}
_STORED = {"color": "F16", "depth": "F32", "motion": "F16", "reference": "F16", "ghost": "U8", "alias": "U8"}
_DISPLAY = "display."
_BYTES = ("base_color", "roughness", "metallic", "specular")  # in [0, 1]; eight bits, as engines store them


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TrainingFrame:
    """What a method is fed in one frame, and what it should have made of it.

    Arrays that were read are views into the file, not to be written to: slice them before converting them.

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

    def frame(self) -> Frame:
        """Return the `Frame` that an `Upscaler` steps on."""
        buffers = self.gbuffer_display
        if buffers is not None:
            buffers = {n: a.astype(np.float32) / 255.0 if n in _BYTES else a for n, a in buffers.items()}
        return Frame(
            color=self.color,
            depth=self.depth,
            motion=self.motion,
            jitter=self.jitter,
            reset=self.reset,
            exposure=self.exposure,
            gbuffer_display=buffers,
        )


def write_training_frame(path: Path, frame: TrainingFrame) -> None:
    """Write one frame, in one piece or not at all.

    Raises:
        OSError: the disk refused.
    """
    tensors = {name: getattr(frame, name).astype(_TYPES[kind], copy=False) for name, kind in _STORED.items()}
    for name, array in (frame.gbuffer_display or {}).items():
        stored = _rounded(array) if name in _BYTES and array.dtype != np.uint8 else array
        tensors[_DISPLAY + name] = stored
    numbers = {"jitter": frame.jitter, "reset": frame.reset, "exposure": frame.exposure}
    content = save(
        {name: np.ascontiguousarray(array) for name, array in tensors.items()},
        metadata={"frame": json.dumps(numbers)},  # in one entry: safetensors keeps no order of several
    )
    with replacing(path) as partial:
        partial.write_bytes(content)


def read_training_frame(path: Path) -> TrainingFrame:
    """Map one frame into memory; pages are read when they are touched.

    Raises:
        DatasetError: the file is missing, cut off, or lacks a tensor.
    """
    try:
        with path.open("rb") as file:
            mapped = mmap.mmap(file.fileno(), 0, access=mmap.ACCESS_READ)
        length = int.from_bytes(mapped[:8], "little")
        header = json.loads(mapped[8 : 8 + length])
        numbers = json.loads(header.pop("__metadata__")["frame"])
        tensors = {name: _view(mapped, 8 + length, entry) for name, entry in header.items()}
        display = {n.removeprefix(_DISPLAY): tensors.pop(n) for n in list(tensors) if n.startswith(_DISPLAY)}
        content: dict[str, Any] = {**tensors, **numbers, "jitter": tuple(numbers["jitter"])}
        return TrainingFrame(**content, gbuffer_display=display or None)
    except (OSError, ValueError, KeyError, TypeError) as error:
        hint = "Delete it and render again: what is complete is kept."
        raise DatasetError(
            path, f"not a whole training frame ({type(error).__name__}: {error})", hint
        ) from error


def _view(mapped: mmap.mmap, start: int, entry: dict[str, Any]) -> NDArray[Any]:
    first, last = entry["data_offsets"]
    if start + last > len(mapped):
        raise ValueError(f"it ends at byte {len(mapped)}, not {start + last}")
    dtype = np.dtype(_TYPES[entry["dtype"]])
    flat = np.frombuffer(mapped, dtype, (last - first) // dtype.itemsize, start + first)
    return flat.reshape(entry["shape"])


def _rounded(values: NDArray[Any]) -> NDArray[np.uint8]:
    """[0, 1] to 0..255."""
    return (np.clip(values.astype(np.float32), 0.0, 1.0) * 255.0 + 0.5).astype(np.uint8)
