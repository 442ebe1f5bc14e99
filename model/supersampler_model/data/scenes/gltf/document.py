"""A glTF file: its JSON, and the buffers, images and arrays that it refers to."""

import base64
import binascii
import hashlib
import json
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Any, Literal, TypeAlias
from urllib.parse import unquote, urlsplit

import numpy as np
from numpy.typing import NDArray

from supersampler.errors import ShotError
from supersampler.io.files import check_inside
from supersampler_model.data.errors import DataError, SceneError
from supersampler_model.data.scenes.scene import Values


class GltfError(DataError, ValueError):
    """A glTF file is broken, or uses unsupported features.

    Attributes:
        path: the file.
        place: where in it, as "mesh 0 'Chair', primitive 1"; empty if it is the whole file.
        problem: the reason.
    """

    def __init__(self, path: Path, place: str, problem: str) -> None:
        self.path, self.place, self.problem = path, place, problem
        super().__init__(f"{path}: {place}{': ' if place else ''}{problem}.")


class MalformedError(Exception):
    """A reason, without its place."""

    def __init__(self, problem: str) -> None:
        super().__init__(problem)
        self.problem, self.places = problem.rstrip("."), list[str]()


@contextmanager
def at(place: str) -> Iterator[None]:
    """Add `place` to errors that are raised inside, also to those of unexpected JSON."""
    try:
        yield
    except MalformedError as error:
        error.places.insert(0, place)
        raise
    except SceneError as error:
        raise _placed(str(error), place) from error
    except KeyError as error:
        raise _placed(f"{error} is missing", place) from error
    except (LookupError, TypeError, ValueError, AttributeError, ArithmeticError, RecursionError) as error:
        raise _placed(f"this is not as glTF 2.0 has it ({error})", place) from error


@contextmanager
def reading(path: Path) -> Iterator[None]:
    """Convert errors that are raised inside to a GltfError of `path`."""
    try:
        with at(""), np.errstate(all="ignore"):  # damaged numbers are found by checks, and named
            yield
    except MalformedError as error:
        raise GltfError(path, ", ".join(filter(None, error.places)), error.problem) from error
    except MemoryError as error:
        raise GltfError(path, "", "there is not enough memory for what it holds") from error
    except OSError as error:
        raise GltfError(path, "", f"it cannot be read ({error})") from error


def _placed(problem: str, place: str) -> MalformedError:
    malformed = MalformedError(problem)
    malformed.places.append(place)
    return malformed


Json: TypeAlias = dict[str, Any]

LARGEST_FILE = 1 << 31  # bytes
LARGEST_JSON = 1 << 28  # bytes; data URIs are in it
LARGEST_IMAGES = 1 << 31  # bytes of all that are decoded
LARGEST_ARRAYS = 1 << 23  # numbers in arrays that any file may hold
ARRAYS_A_BYTE = 32  # further numbers per byte read: primitives may share arrays
UNDERSTOOD = {"KHR_mesh_quantization", "KHR_materials_emissive_strength", "KHR_texture_transform"}
_HEADER, _CHUNK = 12, 8  # bytes
_OUTSIDE = re.compile(r"[\\:\x00-\x1f]")  # of other systems' paths; a scheme ends in a colon, too
_JSON, _BINARY = b"JSON", b"BIN\0"


@dataclass(frozen=True, slots=True, eq=False)
class Document:
    """A file that has been read; its buffers are read when they are first used.

    Attributes:
        content: the JSON.
        binary: the buffer inside a .glb, empty where there is none.
    """

    path: Path
    content: Json
    binary: bytes
    _buffers: dict[int, bytes] = field(default_factory=dict)
    _read: list[bytes] = field(default_factory=list)  # SHA-256 of each file, in order
    _sizes: dict[str, int] = field(default_factory=lambda: {"read": 0, "arrays": 0, "images": 0})

    def digest(self) -> str:
        """Return the SHA-256, in hexadecimal, of what has been read: the file, and those beside it."""
        return hashlib.sha256(b"".join(self._read)).hexdigest()

    def item(self, kind: str, index: Any) -> Json:
        """Return one of the file's `kind`, as "meshes"."""
        items = self.content.get(kind, [])
        if type(index) is not int or not 0 <= index < len(items):
            raise MalformedError(f"{kind} {index!r} is referred to, and there are {len(items)}")
        item = items[index]
        if not isinstance(item, dict):
            raise MalformedError(f"{kind} {index} is no object")
        return item

    def name(self, kind: str, index: int) -> str:
        """Return an item's name in messages: "mesh 0 'Chair'"."""
        label = self.item(kind, index).get("name")
        single = {"meshes": "mesh"}.get(kind, kind.removesuffix("s"))
        return f"{single} {index}" + (f" {label!r}" if label else "")

    def view(self, index: Any) -> tuple[bytes, int]:
        """Return the bytes of a buffer view, and its stride, 0 if packed."""
        view = self.item("bufferViews", index)
        data = self._buffer(view["buffer"])
        start, length, stride = (_count(view, name) for name in ("byteOffset", "byteLength", "byteStride"))
        if start + length > len(data):
            raise MalformedError(f"bufferView {index} ends at byte {start + length} of {len(data)}")
        return data[start : start + length], stride

    def claim(self, kind: Literal["arrays", "images"], count: int) -> None:
        """Count numbers before memory is allocated for them; raise when a file claims too many."""
        self._sizes[kind] += count
        most = LARGEST_ARRAYS + ARRAYS_A_BYTE * self._sizes["read"] if kind == "arrays" else LARGEST_IMAGES
        if self._sizes[kind] > most:
            raise MalformedError(f"all {kind} come to more than {most} numbers")

    def load(self, uri: Any) -> bytes:
        """Return the data of a buffer's or an image's URI: a data URI, or a file beside this one.

        Only files in the folder of this one and below are read; links and `..` that lead out are refused.
        """
        if not isinstance(uri, str):
            raise MalformedError(f"the URI {uri!r} is no text")
        if uri.startswith("data:"):
            head, _, text = uri.partition(",")
            if not head.endswith(";base64"):
                raise MalformedError(f"the data URI {head!r} is not in base64")
            try:
                return base64.b64decode(text, validate=True)
            except binascii.Error as error:
                raise MalformedError(f"a data URI is damaged ({error})") from error
        data = _content(self._beside(uri), repr(uri))
        self._count(data)
        return data

    def _beside(self, uri: str) -> Path:
        """Return the file of a relative URI, after a check that it lies in the folder of this one."""
        name = unquote(uri, errors="strict")
        path = PurePosixPath(name)
        outside = path.is_absolute() or ".." in path.parts or _OUTSIDE.search(name)
        if urlsplit(uri).netloc or not path.name or outside:
            raise MalformedError(f"{uri!r} is elsewhere; only files in the folder of this one are read")
        try:
            check_inside(self.path.parent, [self.path.parent / name])
        except ShotError as error:
            raise MalformedError(f"{uri!r} is elsewhere, by a link; copy the file to this one") from error
        return self.path.parent / name

    def _count(self, data: bytes) -> None:
        self._read.append(hashlib.sha256(data).digest())
        self._sizes["read"] += len(data)

    def _buffer(self, index: Any) -> bytes:
        buffer = self.item("buffers", index)
        if index not in self._buffers:
            with at(f"buffer {index}"):
                inside = index == 0 and "uri" not in buffer
                data = self.binary if inside else self.load(buffer["uri"])
                length = _count(buffer, "byteLength")
                if len(data) < length:
                    raise MalformedError(f"it has {len(data)} of {length} bytes; the file may be cut off")
                self._buffers[index] = data[:length]
        return self._buffers[index]


def open_document(path: Path) -> Document:
    """Read a .glb or .gltf file."""
    data = _content(path, "it")
    text, binary = _chunks(data) if data[:4] == b"glTF" else (data, b"")
    if len(text) > LARGEST_JSON:
        raise MalformedError(f"its JSON has {len(text)} bytes; want at most {LARGEST_JSON}")
    try:
        content = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise MalformedError(f"it is neither .glb nor .gltf: its JSON does not parse ({error})") from error
    if not isinstance(content, dict):
        raise MalformedError("its JSON is no object")
    version = content["asset"]["version"]
    if not str(version).startswith("2."):
        raise MalformedError(f"its version is {version}; only glTF 2.0 is read")
    missing = sorted(set(content.get("extensionsRequired", [])) - UNDERSTOOD)
    if missing:
        raise MalformedError(f"it requires {', '.join(missing)}, which is not supported; export it without")
    document = Document(path, content, binary)
    document._count(data)
    return document


def _content(path: Path, name: str) -> bytes:
    """Return the bytes of a regular file; `name` is what messages call it."""
    try:
        if path.exists() and not path.is_file():  # a pipe, say, which never ends
            raise MalformedError(f"{name} is no regular file")
        with path.open("rb") as file:
            data = file.read(LARGEST_FILE + 1)
    except OSError as error:
        raise MalformedError(f"{name} cannot be read ({error.strerror})") from error
    if len(data) > LARGEST_FILE:
        raise MalformedError(f"{name} is larger than {LARGEST_FILE >> 20} MiB")
    return data


def _chunks(data: bytes) -> tuple[bytes, bytes]:
    """Return the JSON and the binary chunk of a .glb."""
    if (version := int.from_bytes(data[4:8], "little")) != 2:
        raise MalformedError(f"its container's version is {version}; only glTF 2.0 is read")
    if (length := int.from_bytes(data[8:12], "little")) > len(data):
        raise MalformedError(f"it has {len(data)} of {length} bytes; the file is cut off")
    chunks: dict[bytes, bytes] = {}
    place = _HEADER
    while place + _CHUNK <= length:
        size = int.from_bytes(data[place : place + 4], "little")
        kind, start = data[place + 4 : place + _CHUNK], place + _CHUNK
        if start + size > length:
            raise MalformedError(f"its chunk {kind!r} ends beyond the file")
        chunks.setdefault(kind, data[start : start + size])
        place = start + size
    if _JSON not in chunks:
        raise MalformedError("it has no JSON chunk")
    return chunks[_JSON], chunks.get(_BINARY, b"")


def _count(item: Json, name: str) -> int:
    value = item.get(name, 0)
    if type(value) is not int or value < 0:
        raise MalformedError(f"{name} is {value!r}; want a whole number from 0 on")
    return value


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
