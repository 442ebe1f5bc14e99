"""A glTF file: its JSON, and the buffers, images and arrays (accessors) that it refers to."""

import base64
import binascii
import hashlib
import json
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path, PurePosixPath
from typing import Any, Literal, TypeAlias
from urllib.parse import unquote, urlsplit

import numpy as np
from numpy.typing import NDArray

from supersampler.errors import ShotError
from supersampler.io.files import check_inside
from supersampler_model.data.errors import DataError, SceneError
from supersampler_model.data.scenes.scene import Values

Json: TypeAlias = dict[str, Any]
Integers: TypeAlias = NDArray[np.int64]

LARGEST_FILE = 1 << 31  # bytes
LARGEST_JSON = 1 << 28  # bytes; data URIs are in it
LARGEST_IMAGES = 1 << 31  # bytes of all decoded images
LARGEST_ARRAYS = 1 << 23  # numbers in arrays that any file may hold
ARRAYS_A_BYTE = 32  # further numbers per byte read: primitives may share arrays
MAX_COUNT = 1 << 26  # elements of an array; a larger count is damaged
UNDERSTOOD = {"KHR_mesh_quantization", "KHR_materials_emissive_strength", "KHR_texture_transform"}
_OUTSIDE = re.compile(r"[\\:\x00-\x1f]")  # paths of other systems, and schemes, which end in a colon
_TYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}


class GltfError(DataError, ValueError):
    """A glTF file is broken, or uses unsupported features.

    Attributes:
        path: the file.
        place: the place in it, as "mesh 0 'Chair', primitive 1"; empty for the whole file.
        problem: the reason.
    """

    def __init__(self, path: Path, place: str, problem: str) -> None:
        self.path, self.place, self.problem = path, place, problem
        super().__init__(f"{path}: {place}{': ' if place else ''}{problem}.")


class MalformedError(Exception):
    """The problem, and the places in the file that enclose it, the outermost first; `reading` converts it."""

    def __init__(self, problem: str, *places: str) -> None:
        super().__init__(problem)
        self.problem, self.places = problem.rstrip("."), list(places)


@contextmanager
def at(place: str) -> Iterator[None]:
    """Add `place` to errors raised inside; errors due to unexpected JSON become a MalformedError."""
    try:
        yield
    except MalformedError as error:
        error.places.insert(0, place)
        raise
    except SceneError as error:
        raise MalformedError(str(error), place) from error
    except KeyError as error:
        raise MalformedError(f"{error} is missing", place) from error
    except (LookupError, TypeError, ValueError, AttributeError, ArithmeticError, RecursionError) as error:
        raise MalformedError(f"this is not valid glTF 2.0 ({error})", place) from error


@contextmanager
def reading(path: Path) -> Iterator[None]:
    """Convert errors raised inside to a GltfError of `path`."""
    try:
        with at(""), np.errstate(all="ignore"):  # damaged numbers are found by checks, and named
            yield
    except MalformedError as error:
        raise GltfError(path, ", ".join(filter(None, error.places)), error.problem) from error
    except MemoryError as error:
        raise GltfError(path, "", "there is not enough memory for its content") from error
    except OSError as error:
        raise GltfError(path, "", f"it cannot be read ({error})") from error


class Document:
    """A .glb or .gltf file; buffers are read when they are first used. `content` is the JSON."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._buffers: dict[int, bytes] = {}
        self._digests: list[bytes] = []  # SHA-256 of each file, in order
        self._sizes = {"read": 0, "arrays": 0, "images": 0}
        data = self._read(path, "it")
        text, self._binary = _chunks(data) if data[:4] == b"glTF" else (data, b"")
        if len(text) > LARGEST_JSON:
            raise MalformedError(f"its JSON has {len(text)} bytes; want at most {LARGEST_JSON}")
        try:
            self.content: Json = json.loads(text)
        except (ValueError, RecursionError) as error:
            problem = f"it is neither .glb nor .gltf: its JSON does not parse ({error})"
            raise MalformedError(problem) from error
        if not isinstance(self.content, dict):
            raise MalformedError("its JSON is not an object")
        version = self.content["asset"]["version"]
        if not str(version).startswith("2."):
            raise MalformedError(f"its version is {version}; only glTF 2.0 is read")
        if missing := sorted(set(self.content.get("extensionsRequired", [])) - UNDERSTOOD):
            problem = f"it requires {', '.join(missing)}, which is not supported; export it without"
            raise MalformedError(problem)

    def digest(self) -> str:
        """Return the SHA-256, in hexadecimal, of the file and the files beside it that have been read."""
        return hashlib.sha256(b"".join(self._digests)).hexdigest()

    def item(self, kind: str, index: Any) -> Json:
        """Return an item of a kind, such as "meshes"."""
        items = self.content.get(kind, [])
        if type(index) is not int or not 0 <= index < len(items):
            raise MalformedError(f"it refers to number {index!r} of {len(items)} {kind}, counted from 0")
        item = items[index]
        if not isinstance(item, dict):
            raise MalformedError(f"{kind} {index} is not an object")
        return item

    def name(self, kind: str, index: int) -> str:
        """Return an item's name for messages: "mesh 0 'Chair'"."""
        label = self.item(kind, index).get("name")
        single = {"meshes": "mesh"}.get(kind, kind.removesuffix("s"))
        return f"{single} {index}" + (f" {label!r}" if label else "")

    def view(self, index: Any) -> tuple[bytes, int]:
        """Return the bytes of a buffer view, and its stride, 0 if packed."""
        view = self.item("bufferViews", index)
        data = self._buffer(view["buffer"])
        start, length, stride = (_whole(view, name) for name in ("byteOffset", "byteLength", "byteStride"))
        if start + length > len(data):
            raise MalformedError(f"bufferView {index} ends at byte {start + length} of {len(data)}")
        return data[start : start + length], stride

    def claim(self, kind: Literal["arrays", "images"], count: int) -> None:
        """Count numbers before memory is allocated for them; raise if a file claims too many."""
        self._sizes[kind] += count
        limit = LARGEST_ARRAYS + ARRAYS_A_BYTE * self._sizes["read"] if kind == "arrays" else LARGEST_IMAGES
        if self._sizes[kind] > limit:
            raise MalformedError(f"all {kind} together have more than {limit} numbers")

    def load(self, uri: Any) -> bytes:
        """Return the data of a buffer's or an image's URI: a data URI, or a file beside this one.

        Only files in the folder of this file and below are read; links and `..` that lead out are refused.
        """
        if not isinstance(uri, str):
            raise MalformedError(f"the URI {uri!r} is not a string")
        if not uri.startswith("data:"):
            return self._read(self._beside(uri), repr(uri))
        head, _, text = uri.partition(",")
        if not head.endswith(";base64"):
            raise MalformedError(f"the data URI {head!r} is not in base64")
        try:
            return base64.b64decode(text, validate=True)
        except binascii.Error as error:
            raise MalformedError(f"a data URI is damaged ({error})") from error

    def _beside(self, uri: str) -> Path:
        """Return the file of a relative URI, which must lie in the folder of this file."""
        name = unquote(uri, errors="strict")
        path = PurePosixPath(name)
        outside = path.is_absolute() or ".." in path.parts or _OUTSIDE.search(name)
        if urlsplit(uri).netloc or not path.name or outside:
            raise MalformedError(f"{uri!r} lies outside the folder of this file; only files in it are read")
        try:
            check_inside(self.path.parent, [self.path.parent / name])
        except ShotError as error:
            problem = f"{uri!r} lies outside the folder through a link; copy the file here"
            raise MalformedError(problem) from error
        return self.path.parent / name

    def _read(self, path: Path, name: str) -> bytes:
        """Return the bytes of a regular file, which messages call `name`."""
        try:
            if path.exists() and not path.is_file():  # such as a pipe, which never ends
                raise MalformedError(f"{name} is not a regular file")
            with path.open("rb") as file:
                data = file.read(LARGEST_FILE + 1)
        except OSError as error:
            raise MalformedError(f"{name} cannot be read ({error.strerror})") from error
        if len(data) > LARGEST_FILE:
            raise MalformedError(f"{name} is larger than {LARGEST_FILE >> 20} MiB")
        self._digests.append(hashlib.sha256(data).digest())
        self._sizes["read"] += len(data)
        return data

    def _buffer(self, index: Any) -> bytes:
        buffer = self.item("buffers", index)
        if index not in self._buffers:
            with at(f"buffer {index}"):
                inside = index == 0 and "uri" not in buffer
                data = self._binary if inside else self.load(buffer["uri"])
                length = _whole(buffer, "byteLength")
                if len(data) < length:
                    raise MalformedError(f"it has {len(data)} of {length} bytes; the file may be cut off")
                self._buffers[index] = data[:length]
        return self._buffers[index]

    def floats(self, index: Any, kind: str) -> Values:
        """Return (count, width) numbers of an accessor of this kind, as "VEC3"; normalised: in [-1, 1]."""
        with at(f"accessor {index}"):
            accessor = self.item("accessors", index)
            raw = self._array(accessor, kind)
            values = raw.astype(np.float64)
            if accessor.get("normalized", False) and raw.dtype.kind != "f":
                values = np.maximum(values / np.iinfo(raw.dtype).max, -1.0)
            if not np.isfinite(values).all():
                raise MalformedError("it holds NaN or infinite numbers")
            return values

    def integers(self, index: Any, kind: str) -> Integers:
        """Return (count, width) whole numbers of an accessor of this kind."""
        with at(f"accessor {index}"):
            raw = self._array(self.item("accessors", index), kind)
            if raw.dtype.kind != "u":
                raise MalformedError(f"it holds {raw.dtype.name}; want unsigned integers")
            return raw.astype(np.int64)

    def _array(self, accessor: Json, kind: str) -> NDArray[Any]:
        if accessor["type"] != kind:
            raise MalformedError(f"it holds {accessor['type']}; want {kind}")
        count, dtype, width = _whole(accessor, "count", 1, MAX_COUNT), _dtype(accessor), _WIDTHS[kind]
        self.claim("arrays", count * width)
        has_view = "bufferView" in accessor
        raw = self._elements(accessor, dtype, count, width) if has_view else np.zeros((count, width), dtype)
        if "sparse" in accessor:
            sparse = accessor["sparse"]
            replaced, where = _whole(sparse, "count", 1, count), sparse["indices"]
            rows = self._elements(where, _dtype(where), replaced, 1)[:, 0].astype(np.int64)
            raw = raw.copy()
            raw[rows] = self._elements(sparse["values"], dtype, replaced, width)
        return raw

    def _elements(self, source: Json, dtype: np.dtype[Any], count: int, width: int) -> NDArray[Any]:
        """Return (count, width) elements of a buffer view, starting at the byteOffset of `source`."""
        data, stride = self.view(source["bufferView"])
        start, packed = _whole(source, "byteOffset"), width * dtype.itemsize
        stride = stride or packed
        if stride < packed:
            raise MalformedError(f"its stride is {stride}, of elements of {packed} bytes")
        end = start + (count - 1) * stride + packed
        if end > len(data):
            raise MalformedError(f"it ends at byte {end} of the {len(data)} of its buffer view")
        return np.ndarray((count, width), dtype, data, start, (stride, dtype.itemsize))


def _chunks(data: bytes) -> tuple[bytes, bytes]:
    """Return the JSON and the binary chunk of a .glb."""
    version, length = (int.from_bytes(data[i : i + 4], "little") for i in (4, 8))
    if version != 2:
        raise MalformedError(f"its container's version is {version}; only glTF 2.0 is read")
    if length > len(data):
        raise MalformedError(f"it has {len(data)} of {length} bytes; the file is cut off")
    chunks: dict[bytes, bytes] = {}
    place = 12  # after the header; a chunk is its size, its kind and its data
    while place + 8 <= length:
        size, kind = int.from_bytes(data[place : place + 4], "little"), data[place + 4 : place + 8]
        place += 8
        if place + size > length:
            raise MalformedError(f"its chunk {kind!r} ends beyond the file")
        chunks.setdefault(kind, data[place : place + size])
        place += size
    if b"JSON" not in chunks:
        raise MalformedError("it has no JSON chunk")
    return chunks[b"JSON"], chunks.get(b"BIN\0", b"")


def _whole(item: Json, name: str, minimum: int = 0, maximum: int = LARGEST_FILE) -> int:
    value = item.get(name, 0)
    if type(value) is not int or not minimum <= value <= maximum:
        raise MalformedError(f"its {name} is {value!r}; want {minimum} to {maximum}")
    return value


def _dtype(source: Json) -> np.dtype[Any]:
    code = source["componentType"]
    if code not in _TYPES:
        raise MalformedError(f"its componentType is {code!r}; want one of {', '.join(map(str, _TYPES))}")
    return np.dtype(_TYPES[code])
