"""A file of records, one after the other, each checked by itself: docs/replay.md describes every byte.

What a crash cuts off is the last record alone; nothing that a file holds is ever run.
"""

import json
import os
import re
import struct
import weakref
import zlib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from io import FileIO
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from supersampler.errors import RecordingError
from supersampler.io.atomic import NO_ROOM

MAGIC = b"\x89SSR\r\n\x1a\n"
"""As PNG's: a file that was sent as text, or lost its eighth bits, is known at once."""

MAX_TEXT = 4 << 20
"""Bytes of a record's text, at most."""

_HEAD = struct.Struct("<QII")  # bytes of text and arrays, bytes of the text, CRC-32 of both
_CHECK = struct.Struct("<I")  # CRC-32 of the head
_NUMBERS = re.compile(r"[<>|][biuf]\d{1,2}")  # numpy's names of plain numbers: no objects, no structures
_DAMAGED = "The file is damaged; copy it again."


@dataclass(frozen=True, eq=False)
class Record:
    """One record: what happened, JSON values, and arrays by name."""

    kind: str
    values: Mapping[str, Any] = field(default_factory=dict)
    arrays: Mapping[str, NDArray[Any]] = field(default_factory=dict)


class RecordWriter:
    """Appends records to a new file, each at once, so that they stay when the process ends in any way.

    Args:
        path: the file; its folder is made where it is missing.

    Raises:
        RecordingError: it is there already, or cannot be written.
    """

    def __init__(self, path: Path | str) -> None:
        self.path = Path(path)
        try:
            self.path.parent.mkdir(parents=True, exist_ok=True)
            self._file = FileIO(self.path, "x")  # unbuffered: nothing waits to be written when a disk is full
        except FileExistsError:
            hint = "Choose another name, or move the file away."
            raise RecordingError(path, "is there already", hint) from None
        except OSError as error:
            raise RecordingError(path, f"cannot be written ({error})", NO_ROOM) from error
        self._close = weakref.finalize(self, self._file.close)  # of one that is dropped, without a warning
        self._put([MAGIC])

    @property
    def end(self) -> int:
        """Bytes so far."""
        return self._file.tell()

    def write(self, record: Record) -> None:
        """Append a record.

        Raises:
            RecordingError: it cannot be written; the file ends as before.
        """
        self._put(_encoded(record))

    def cut(self, end: int) -> None:
        """Let the file end there again, as far as the disk allows."""
        with suppress(OSError):
            self._file.seek(end)
            self._file.truncate()

    def close(self) -> None:
        """Close the file."""
        self._close()

    def _put(self, parts: Sequence[bytes | memoryview]) -> None:
        before = self.end
        try:
            for part in parts:
                _write_all(self._file, memoryview(part))
        except BaseException as error:
            self.cut(before)
            if isinstance(error, OSError):
                raise RecordingError(self.path, f"cannot be written ({error})", NO_ROOM) from error
            raise


def is_recording(path: Path | str) -> bool:
    """Tell whether a file begins as recordings do."""
    try:
        with Path(path).open("rb") as file:
            return file.read(len(MAGIC)) == MAGIC
    except OSError:
        return False


def read_records(path: Path | str) -> Iterator[Record]:
    """Yield the records of a file up to the last whole one, each with arrays of its own.

    Raises:
        RecordingError: the file is missing or of another kind; a record is damaged, after those before it.
    """
    path = Path(path)
    try:
        file = path.open("rb")
    except FileNotFoundError:
        hint = "Is the path right, is the drive connected?"
        raise RecordingError(path, "there is no such file", hint) from None
    except OSError as error:
        raise RecordingError(path, f"cannot be read ({error})") from error
    with file:
        if file.read(len(MAGIC)) != MAGIC:
            raise RecordingError(path, "is not a recording", "`supersampler upscale --record` writes them.")
        while (record := _checked_record(file, path)) is not None:
            yield record


def octets(array: NDArray[Any]) -> memoryview:
    """The bytes of an array in C order: its own where it is so, a copy where not."""
    return np.asarray(array, order="C").reshape(-1).view(np.uint8).data


def _encoded(record: Record) -> list[bytes | memoryview]:
    arrays = {name: np.asarray(array, order="C") for name, array in record.arrays.items()}
    for name, array in arrays.items():
        if not _NUMBERS.fullmatch(array.dtype.str):
            raise TypeError(f"{name} is {array.dtype}; a record holds plain numbers")
    listed = [[name, array.dtype.str, array.shape] for name, array in arrays.items()]
    content = {"record": record.kind, **record.values, "arrays": listed}
    text = json.dumps(content, allow_nan=False, separators=(",", ":")).encode()
    data = [octets(array) for array in arrays.values()]
    check = zlib.crc32(text)
    for part in data:
        check = zlib.crc32(part, check)
    head = _HEAD.pack(len(text) + sum(part.nbytes for part in data), len(text), check)
    return [head + _CHECK.pack(zlib.crc32(head)) + text, *data]


def _write_all(file: FileIO, data: memoryview) -> None:
    while data:  # an unbuffered file takes less than all where the disk is nearly full
        data = data[file.write(data) :]


def _checked_record(file: BinaryIO, path: Path) -> Record | None:
    begin = file.tell()
    try:
        return _next_record(file)
    except OSError as error:
        raise RecordingError(path, f"cannot be read ({error})", _DAMAGED) from error
    except MemoryError as error:
        hint = "Replay it on a machine with more memory."
        raise RecordingError(path, f"has a record at byte {begin} beyond memory", hint) from error
    except (ValueError, TypeError, KeyError, AttributeError, RecursionError) as error:
        raise RecordingError(path, f"has a damaged record at byte {begin}", _DAMAGED) from error


def _next_record(file: BinaryIO) -> Record | None:
    """Read a record; None at the file's end, or where the last one is cut off.

    Raises:
        ValueError, TypeError, KeyError, AttributeError, RecursionError: it is damaged.
    """
    left = os.fstat(file.fileno()).st_size - file.tell() - _HEAD.size - _CHECK.size
    if left < 0:
        return None
    head = file.read(_HEAD.size)
    length, text_length, check = _HEAD.unpack(head)
    if file.read(_CHECK.size) != _CHECK.pack(zlib.crc32(head)) or text_length > min(length, MAX_TEXT):
        raise ValueError("head")
    if length > left:
        return None
    text = file.read(text_length)
    content, made = json.loads(text), zlib.crc32(text)
    kind, listed = str(content.pop("record")), _listed(content.pop("arrays"))
    if sum(_bytes_of(dtype, shape) for _, dtype, shape in listed) != length - text_length:
        raise ValueError("lengths")  # before room is made
    arrays: dict[str, NDArray[Any]] = {}
    for name, dtype, shape in listed:
        arrays[name] = np.empty(shape, dtype)
        data = octets(arrays[name])
        file.readinto(data)  # type: ignore[attr-defined]  # as all files that `open` returns
        made = zlib.crc32(data, made)
    if made != check:
        raise ValueError("CRC-32")
    return Record(kind, content, arrays)


def _listed(arrays: Any) -> list[tuple[str, np.dtype[Any], tuple[int, ...]]]:
    """Names, types and shapes of a record's arrays.

    Raises:
        ValueError, TypeError: they are not what a record lists.
    """
    listed = []
    for name, dtype, shape in arrays:
        if not _NUMBERS.fullmatch(dtype) or not all(type(n) is int and n >= 0 for n in shape):
            raise ValueError(f"{name} {dtype} {shape}")
        listed.append((str(name), np.dtype(dtype), tuple(shape)))
    return listed


def _bytes_of(dtype: np.dtype[Any], shape: tuple[int, ...]) -> int:
    count = dtype.itemsize
    for extent in shape:
        count *= extent
    return count
