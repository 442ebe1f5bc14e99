"""Arrays of frames and images that wait for their turn, in memory and in a scratch file on disk."""

import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from supersampler.errors import ShotError
from supersampler.frame import GBUFFER_CHANNELS, GBUFFER_DISPLAY_CHANNELS, Frame
from supersampler.io.files import os_errors_as_shot_error

MEMORY = 2.0**30
"""Bytes of frames and images that are kept in memory; what is more goes to the disk."""
_NO_ROOM = "Is the disk full? `scratch` names a folder on another; images that were written stay."
_IMAGES = ("color", "depth", "motion", "reactive", "aovs", "motion_next")
_GROUPS = {"gbuffer": GBUFFER_CHANNELS, "gbuffer_display": GBUFFER_DISPLAY_CHANNELS}


@dataclass(frozen=True)
class Stored:
    """Arrays that a `FrameStore` holds.

    Attributes:
        key: of the store.
        arrays: type and shape of each array, by name, in the order of the file.
    """

    key: int
    arrays: Mapping[str, tuple[np.dtype[Any], tuple[int, ...]]]


@dataclass(frozen=True)
class StoredFrame:
    """A frame that a `FrameStore` holds.

    Attributes:
        stored: its arrays.
        jitter, reset, exposure, pre_exposure: see `Frame`.
    """

    stored: Stored
    jitter: tuple[float, float]
    reset: bool
    exposure: float | None
    pre_exposure: float


class FrameStore:
    """Keeps arrays until they are dropped: in memory up to a limit, the others in a scratch file.

    The file has no name, or one that the system removes: nothing of it is left however the process ends.

    Args:
        memory: bytes to keep in memory.
        folder: where to make the scratch file, when it is needed; None is the system's place for temporary
            files.
        names: optional arrays of frames to keep, by `input_name`; None keeps all.

    Raises:
        ShotError: `folder` is no folder.
    """

    def __init__(
        self, *, memory: float = MEMORY, folder: Path | None = None, names: frozenset[str] | None = None
    ) -> None:
        if folder is not None and not folder.is_dir():
            raise ShotError(folder, "is no folder", "`scratch` names an existing one.")
        self._names, self._place, self._room = names, folder or tempfile.gettempdir(), memory
        self._held: dict[int, dict[str, NDArray[Any]]] = {}
        self._next = 0
        self._file: IO[bytes] | None = None
        self._places: dict[int, tuple[int, int]] = {}  # offset and bytes in the file, by key
        self._free: list[tuple[int, int]] = []
        self._end = 0

    def put(self, arrays: Mapping[str, NDArray[Any]]) -> Stored:
        """Keep some arrays, which must not be changed later; ShotError where the disk is full."""
        key, self._next = self._next, self._next + 1
        facts = {name: (array.dtype, array.shape) for name, array in arrays.items()}
        size = sum(array.nbytes for array in arrays.values())
        if size <= self._room:
            self._held[key] = dict(arrays)
            self._room -= size
            return Stored(key, facts)
        offset, room = self._allocated(size)
        with os_errors_as_shot_error(self._place, "written", _NO_ROOM):
            if self._file is None:
                self._file = tempfile.TemporaryFile(buffering=0, dir=self._place)  # noqa: SIM115  # see `close`
            self._file.seek(offset)
            for array in arrays.values():
                left = memoryview(np.ascontiguousarray(array).reshape(-1).view(np.uint8))  # type: ignore[arg-type]
                while left:  # on a nearly full disk only a part is written
                    left = left[self._file.write(left) :]
        self._places[key] = offset, room
        return Stored(key, facts)

    def get(self, stored: Stored) -> dict[str, NDArray[Any]]:
        """Return the arrays, which must not be changed."""
        if stored.key in self._held:
            return dict(self._held[stored.key])
        assert self._file is not None  # noqa: S101  # `put` made it
        with os_errors_as_shot_error(self._place, "read"):
            self._file.seek(self._places[stored.key][0])
            return {name: self._read(*fact) for name, fact in stored.arrays.items()}

    def put_frame(self, frame: Frame) -> StoredFrame:
        """Keep a copy of a frame, of the optional arrays those of `names`."""
        arrays = {name: getattr(frame, name) for name in _IMAGES if getattr(frame, name) is not None}
        for group in _GROUPS:
            buffers = getattr(frame, group) or {}
            arrays |= {f"{group}_{name}": array for name, array in buffers.items()}
        if self._names is not None:
            required = {*_IMAGES, *self._names}
            arrays = {name: array for name, array in arrays.items() if name in required}
        copies = {name: array.copy() for name, array in arrays.items()}  # engines reuse their buffers
        values = frame.jitter, frame.reset, frame.exposure, frame.pre_exposure
        return StoredFrame(self.put(copies), *values)

    def get_frame(self, frame: StoredFrame) -> Frame:
        """Return a frame."""
        arrays = self.get(frame.stored)
        buffers: dict[str, Any] = {name: arrays.get(name) for name in _IMAGES}
        for group, channels in _GROUPS.items():
            found = {name: arrays[f"{group}_{name}"] for name in channels if f"{group}_{name}" in arrays}
            buffers[group] = found or None
        return Frame(
            **buffers, jitter=frame.jitter, reset=frame.reset, exposure=frame.exposure,
            pre_exposure=frame.pre_exposure,
        )  # fmt: skip

    def drop(self, stored: Stored) -> None:
        """Forget arrays, and free their memory or their place in the file."""
        held = self._held.pop(stored.key, None)
        if held is not None:
            self._room += sum(array.nbytes for array in held.values())
        elif stored.key in self._places:
            self._free.append(self._places.pop(stored.key))

    def close(self) -> None:
        """Remove all that is kept, and the scratch file."""
        self._held.clear()
        if self._file is not None:
            self._file.close()

    def __enter__(self) -> "FrameStore":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _allocated(self, size: int) -> tuple[int, int]:
        """Return offset and bytes of a free place: the smallest that fits, of at most twice the size."""
        fitting = [place for place in self._free if size <= place[1] <= 2 * size]
        if fitting:
            best = min(fitting, key=lambda place: place[1])
            self._free.remove(best)
            return best
        self._end += size
        return self._end - size, size

    def _read(self, dtype: np.dtype[Any], shape: tuple[int, ...]) -> NDArray[Any]:
        """Read an array at the file's position."""
        array = np.empty(shape, dtype)
        left = memoryview(array.reshape(-1).view(np.uint8))  # type: ignore[arg-type]
        while left:
            count = self._file.readinto(left) if self._file is not None else 0  # type: ignore[attr-defined]
            if not count:
                raise ShotError(self._place, "its scratch file is shorter than it was written")
            left = left[count:]
        return array
