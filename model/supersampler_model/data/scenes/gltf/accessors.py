"""Reads arrays (accessors) of a glTF file: strided, normalised or sparse."""

from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from supersampler_model.data.scenes.gltf.document import Document, Json
from supersampler_model.data.scenes.gltf.errors import MalformedError, at
from supersampler_model.data.values import Values

Integers: TypeAlias = NDArray[np.int64]

_TYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
MAX_COUNT = 1 << 26  # elements; more is a damaged count, not a mesh


def floats(document: Document, index: Any, kind: str) -> Values:
    """Return (count, width) numbers of an accessor of this kind, as "VEC3"; normalised ones in [-1, 1]."""
    with at(f"accessor {index}"):
        accessor = document.item("accessors", index)
        raw = _read(document, accessor, kind)
        values = raw.astype(np.float64)
        if accessor.get("normalized", False) and raw.dtype.kind != "f":
            values = np.maximum(values / np.iinfo(raw.dtype).max, -1.0)
        if not np.isfinite(values).all():
            raise MalformedError("it holds NaN or infinite numbers")
        return values


def integers(document: Document, index: Any, kind: str) -> Integers:
    """Return (count, width) whole numbers of an accessor of this kind."""
    with at(f"accessor {index}"):
        raw = _read(document, document.item("accessors", index), kind)
        if raw.dtype.kind != "u":
            raise MalformedError(f"it holds {raw.dtype.name}; want unsigned integers")
        return raw.astype(np.int64)


def _read(document: Document, accessor: Json, kind: str) -> NDArray[Any]:
    if accessor["type"] != kind:
        raise MalformedError(f"it holds {accessor['type']}; want {kind}")
    count, dtype, width = accessor["count"], _dtype(accessor), _WIDTHS[kind]
    if type(count) is not int or not 0 < count <= MAX_COUNT:
        raise MalformedError(f"its count is {count!r}; want 1 to {MAX_COUNT}")
    document.claim("arrays", count * width)
    if "bufferView" in accessor:
        raw = _elements(document, accessor, dtype, count, width)
    else:
        raw = np.zeros((count, width), dtype)
    return _patched(document, raw, accessor["sparse"]) if "sparse" in accessor else raw


def _patched(document: Document, raw: NDArray[Any], sparse: Json) -> NDArray[Any]:
    """Return `raw` with the rows that `sparse` replaces."""
    count, where = sparse["count"], sparse["indices"]
    if type(count) is not int or not 0 < count <= len(raw):
        raise MalformedError(f"its sparse count is {count!r}; want 1 to {len(raw)}")
    rows = _elements(document, where, _dtype(where), count, 1)[:, 0].astype(np.int64)
    if rows.min() < 0 or rows.max() >= len(raw):
        raise MalformedError(f"it replaces element {int(rows.max())} of {len(raw)}")
    patched = raw.copy()
    patched[rows] = _elements(document, sparse["values"], raw.dtype, count, raw.shape[1])
    return patched


def _elements(document: Document, source: Json, dtype: np.dtype[Any], count: int, width: int) -> NDArray[Any]:
    """Return (count, width) of a buffer view, from `source`'s byteOffset on."""
    data, stride = document.view(source["bufferView"])
    start, packed = source.get("byteOffset", 0), width * dtype.itemsize
    stride = stride or packed
    if type(start) is not int or start < 0 or stride < packed:
        raise MalformedError(
            f"its byteOffset is {start!r} and its stride {stride}, of elements of {packed} bytes"
        )
    end = start + (count - 1) * stride + packed
    if end > len(data):
        raise MalformedError(f"it ends at byte {end} of the {len(data)} of its buffer view")
    return np.ndarray((count, width), dtype, data, start, (stride, dtype.itemsize))


def _dtype(source: Json) -> np.dtype[Any]:
    code = source["componentType"]
    if code not in _TYPES:
        raise MalformedError(f"its componentType is {code!r}; want one of {', '.join(map(str, _TYPES))}")
    return np.dtype(_TYPES[code])
