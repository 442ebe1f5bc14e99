"""Storage of frames and images that are needed later, in memory and in a scratch file."""

import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import IO, Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray

from supersampler.errors import ShotError
from supersampler.frame import Frame
from supersampler.io.files import is_folder, os_errors_as_shot_error
from supersampler.methods.gbuffers import IMAGES, arrays_by_name, frame_of, values_of

MEMORY = 2.0**30
"""Bytes of frames and images that are kept in memory before the scratch file is used."""
_NO_ROOM = "Is the disk full? `scratch` names a folder on another disk; finished images are kept."


class Stored(NamedTuple):
    """Reference to arrays in a `FrameStore`: a key, and type and shape of each array, in the file's order."""

    key: int
    arrays: Mapping[str, tuple[np.dtype[Any], tuple[int, ...]]]


class StoredFrame(NamedTuple):
    """Reference to a frame in a `FrameStore`: its arrays, and `values_of` it."""

    stored: Stored
    values: Mapping[str, Any]


class FrameStore:
    """Keeps arrays until they are dropped: in memory up to a limit, beyond it in a scratch file.

    The system removes the file however the process ends.

    Args:
        memory: limit of the memory in bytes; None is MEMORY.
        folder: folder of the scratch file; None is the system's temporary folder.
        names: tensor names of the G-buffers of frames to keep.

    Raises:
        ShotError: `folder` is not a folder.
    """

    def __init__(
        self, *, memory: float | None = None, folder: Path | None = None, names: frozenset[str] = frozenset()
    ) -> None:
        if folder is not None and not is_folder(folder):
            raise ShotError(folder, "is not a folder", "`scratch` names an existing one.")
        self._names, self._folder = names, folder or tempfile.gettempdir()
        self._free_memory = MEMORY if memory is None else memory
        self._in_memory: dict[int, dict[str, NDArray[Any]]] = {}
        self._next_key = self._file_end = 0
        self._file: IO[bytes] | None = None
        self._in_file: dict[int, tuple[int, int]] = {}  # offset and size, by key
        self._free: list[tuple[int, int]] = []  # gaps in the file, offset and size

    def put(self, arrays: Mapping[str, NDArray[Any]]) -> Stored:
        """Keep arrays, which must not be changed later; raise ShotError if the disk is full."""
        key, self._next_key = self._next_key, self._next_key + 1
        stored = Stored(key, {name: (array.dtype, array.shape) for name, array in arrays.items()})
        size = sum(array.nbytes for array in arrays.values())
        if size <= self._free_memory:
            self._in_memory[key] = dict(arrays)
            self._free_memory -= size
            return stored
        offset, room = self._allocated(size)
        with os_errors_as_shot_error(self._folder, "written", _NO_ROOM):
            if self._file is None:
                self._file = tempfile.TemporaryFile(buffering=0, dir=self._folder)  # noqa: SIM115  # see `close`
            self._file.seek(offset)
            for array in arrays.values():
                remaining = memoryview(np.ascontiguousarray(array).reshape(-1).view(np.uint8))  # type: ignore[arg-type]
                while remaining:  # on a nearly full disk only a part is written
                    remaining = remaining[self._file.write(remaining) :]
        self._in_file[key] = offset, room
        return stored

    def get(self, stored: Stored) -> dict[str, NDArray[Any]]:
        """Return the arrays, which must not be changed."""
        if stored.key in self._in_memory:
            return dict(self._in_memory[stored.key])
        assert self._file is not None  # noqa: S101  # `put` has opened it
        with os_errors_as_shot_error(self._folder, "read"):
            self._file.seek(self._in_file[stored.key][0])
            return {name: self._read(*fact) for name, fact in stored.arrays.items()}

    def put_frame(self, frame: Frame) -> StoredFrame:
        """Keep a copy of a frame, because engines reuse their arrays."""
        kept = {*IMAGES, *self._names}
        copies = {name: array.copy() for name, array in arrays_by_name(frame).items() if name in kept}
        return StoredFrame(self.put(copies), values_of(frame))

    def get_frame(self, frame: StoredFrame) -> Frame:
        """Return a frame."""
        return frame_of(self.get(frame.stored), **frame.values)

    def drop(self, stored: Stored) -> None:
        """Free the memory of arrays, or their space in the file."""
        arrays = self._in_memory.pop(stored.key, None)
        if arrays is not None:
            self._free_memory += sum(array.nbytes for array in arrays.values())
        elif stored.key in self._in_file:
            self._free.append(self._in_file.pop(stored.key))

    def close(self) -> None:
        """Free all memory, and remove the scratch file."""
        self._in_memory.clear()
        if self._file is not None:
            self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _allocated(self, size: int) -> tuple[int, int]:
        """Return offset and size of a range: the smallest gap of up to twice `size`, or the file's end."""
        fitting = [gap for gap in self._free if size <= gap[1] <= 2 * size]
        if fitting:
            best = min(fitting, key=lambda gap: gap[1])
            self._free.remove(best)
            return best
        self._file_end += size
        return self._file_end - size, size

    def _read(self, dtype: np.dtype[Any], shape: tuple[int, ...]) -> NDArray[Any]:
        """Read an array at the file's position."""
        array = np.empty(shape, dtype)
        remaining = memoryview(array.reshape(-1).view(np.uint8))  # type: ignore[arg-type]
        while remaining:
            count = self._file.readinto(remaining) if self._file is not None else 0  # type: ignore[attr-defined]
            if not count:
                raise ShotError(self._folder, "its scratch file was truncated")
            remaining = remaining[count:]
        return array
