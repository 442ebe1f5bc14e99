"""Arrays of frames and images that wait for their turn: in memory, or in a scratch folder on disk."""

import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import TracebackType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from supersampler.errors import ShotError
from supersampler.frame import GBUFFER_CHANNELS, GBUFFER_DISPLAY_CHANNELS, Frame
from supersampler.io.atomic import os_errors_as_shot_error

_ROOM = "Is the disk full? `scratch` names a folder on another; images that were written stay."
_IMAGES = ("color", "depth", "motion", "aovs", "motion_next")
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
        jitter, reset, exposure: see `Frame`.
    """

    stored: Stored
    jitter: tuple[float, float]
    reset: bool
    exposure: float | None


class FrameStore:
    """Keeps copies of arrays until they are dropped.

    Args:
        on_disk: whether in files of a scratch folder, which is removed when the store is closed; otherwise
            in memory.
        folder: where to make the scratch folder; None is the system's place for temporary files.
        names: optional arrays of frames to keep, by `input_name`; None keeps all.

    Raises:
        ShotError: the folder cannot be made.
    """

    def __init__(
        self, *, on_disk: bool, folder: Path | None = None, names: frozenset[str] | None = None
    ) -> None:
        self._names = names
        self._folder: tempfile.TemporaryDirectory[str] | None = None
        self._held: dict[int, dict[str, NDArray[Any]]] = {}
        self._next = 0
        if on_disk:
            place = str(folder or tempfile.gettempdir())
            with os_errors_as_shot_error(place, "used for scratch files", "`scratch` names another folder."):
                self._folder = tempfile.TemporaryDirectory(
                    prefix="supersampler-", dir=folder, ignore_cleanup_errors=True
                )

    def put(self, arrays: Mapping[str, NDArray[Any]]) -> Stored:
        """Keep copies of some arrays; ShotError where the disk is full."""
        key, self._next = self._next, self._next + 1
        facts = {name: (array.dtype, array.shape) for name, array in arrays.items()}
        if self._folder is None:
            self._held[key] = {name: array.copy() for name, array in arrays.items()}
            return Stored(key, facts)
        path = self._path(key)
        with os_errors_as_shot_error(path.parent, "written", _ROOM), path.open("wb") as file:
            for array in arrays.values():
                np.ascontiguousarray(array).tofile(file)
        return Stored(key, facts)

    def get(self, stored: Stored) -> dict[str, NDArray[Any]]:
        """Return the arrays; changes of those in memory change what is kept."""
        if self._folder is None:
            return dict(self._held[stored.key])
        path, found = self._path(stored.key), {}
        with os_errors_as_shot_error(path, "read"), path.open("rb") as file:
            for name, (dtype, shape) in stored.arrays.items():
                count = int(np.prod(shape))
                values = np.fromfile(file, dtype, count)
                if values.size != count:
                    raise ShotError(path, "is shorter than it was written", "Does another program change it?")
                found[name] = values.reshape(shape)
        return found

    def put_frame(self, frame: Frame) -> StoredFrame:
        """Keep a copy of a frame, of the optional arrays those of `names`."""
        arrays = {name: getattr(frame, name) for name in _IMAGES if getattr(frame, name) is not None}
        for group in _GROUPS:
            buffers = getattr(frame, group) or {}
            arrays |= {f"{group}_{name}": array for name, array in buffers.items()}
        if self._names is not None:
            required = {"color", "depth", "motion", "motion_next", "aovs"} | self._names
            arrays = {name: array for name, array in arrays.items() if name in required}
        return StoredFrame(self.put(arrays), frame.jitter, frame.reset, frame.exposure)

    def get_frame(self, frame: StoredFrame) -> Frame:
        """Return a frame."""
        arrays = self.get(frame.stored)
        buffers: dict[str, Any] = {name: arrays.get(name) for name in _IMAGES}
        for group, channels in _GROUPS.items():
            found = {name: arrays[f"{group}_{name}"] for name in channels if f"{group}_{name}" in arrays}
            buffers[group] = found or None
        return Frame(**buffers, jitter=frame.jitter, reset=frame.reset, exposure=frame.exposure)

    def drop(self, stored: Stored) -> None:
        """Forget arrays, and free their memory or file."""
        if self._folder is None:
            self._held.pop(stored.key, None)
        else:
            self._path(stored.key).unlink(missing_ok=True)

    def close(self) -> None:
        """Remove all that is kept, and the scratch folder."""
        self._held.clear()
        if self._folder is not None:
            self._folder.cleanup()

    def __enter__(self) -> "FrameStore":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _path(self, key: int) -> Path:
        assert self._folder is not None  # noqa: S101  # checked by the callers
        return Path(self._folder.name) / f"{key}.bin"
