"""Read and write safetensors files: the length of the header, a JSON header, the tensors' bytes."""

import json
import math
from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from supersampler.errors import ShotError, shown
from supersampler.io.files import JSON_BYTES, check_is_file, os_errors_as_shot_error, replacing

_TYPES = {
    "F16": "<f2", "F32": "<f4", "F64": "<f8", "BOOL": "?", "U8": "u1", "I8": "i1", "U16": "<u2",
    "I16": "<i2", "U32": "<u4", "I32": "<i4", "U64": "<u8", "I64": "<i8",
}  # fmt: skip
_NAMES = {np.dtype(kind): name for name, kind in _TYPES.items()}
_MAX_DIMENSIONS = 32  # of numpy 1
_HINT = "The file is damaged or cut off; copy it again."


def open_safetensors(path: Path) -> tuple[dict[str, NDArray[Any]], dict[str, Any]]:
    """Return the memory-mapped arrays by name, and the file's metadata.

    Values are read from the disk on access. The arrays are read-only.

    Raises:
        ShotError: the file is missing, truncated, or not of this format.
    """
    with os_errors_as_shot_error(path, hint=_HINT):
        check_is_file(path)
        size = path.stat().st_size
        if size < 8:
            raise ShotError(path, "is not a safetensors file", _HINT)
        content = np.asarray(np.memmap(path, np.uint8, mode="r"))
    start = 8 + int(content[:8].view("<u8")[0])
    if start > size:
        raise ShotError(path, "is not a safetensors file, or ends in its header", _HINT)
    if start > JSON_BYTES:
        raise ShotError(path, f"has a header of {start} bytes; want at most {JSON_BYTES}", _HINT)
    try:
        header: dict[str, dict[str, Any]] = json.loads(content[8:start].tobytes())
        metadata = header.pop("__metadata__", {})
        arrays = {name: _tensor(content[start:], **entry) for name, entry in header.items()}
        # otherwise copies of the same bytes of a small file could fill the memory
        ranges = sorted((*header[name]["data_offsets"], name) for name, array in arrays.items() if array.size)
        for (_, end, name), (begin, _, other) in pairwise(ranges):
            if begin < end:
                raise ValueError(f"{shown(name)} and {shown(other)} overlap")
    except (ValueError, TypeError, AttributeError, KeyError, OverflowError, RecursionError) as error:
        raise ShotError(path, f"has a header or tensor that cannot be read ({error})", _HINT) from error
    return arrays, metadata


def write_safetensors(
    path: Path, arrays: Mapping[str, NDArray[Any]], metadata: Mapping[str, str] | None = None
) -> None:
    """Write arrays and texts by name, atomically; ShotError for a type that the format does not have."""
    header: dict[str, Any] = {"__metadata__": metadata} if metadata else {}
    parts, end = list[bytes](), 0
    for name, array in sorted(arrays.items(), key=lambda item: -item[1].itemsize):  # aligns all arrays
        if array.dtype not in _NAMES:
            raise ShotError(path, f"cannot hold {name}, of type {array.dtype}")
        parts.append(array.tobytes())
        begin, end = end, end + array.nbytes
        header[name] = {"dtype": _NAMES[array.dtype], "shape": array.shape, "data_offsets": [begin, end]}
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 8)
    with replacing(path) as partial, partial.open("wb") as file:
        file.writelines([len(text).to_bytes(8, "little"), text, *parts])


def _tensor(data: NDArray[np.uint8], dtype: str, shape: list[int], data_offsets: list[int]) -> NDArray[Any]:
    kind = np.dtype(_TYPES[dtype])
    begin, end = data_offsets
    if len(shape) > _MAX_DIMENSIONS:
        raise ValueError(f"an array of {len(shape)} dimensions; want at most {_MAX_DIMENSIONS}")
    if not 0 <= begin <= end <= data.size or end - begin != math.prod(shape) * kind.itemsize:
        raise ValueError(f"bytes {begin} to {end} of {data.size} for {dtype} {shape}")
    return data[begin:end].view(kind).reshape(shape)
