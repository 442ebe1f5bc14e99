"""Memory of arrays: addresses for kernels, allocation at cache lines, pools of work buffers."""

from collections import OrderedDict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from ctypes import addressof, c_char
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from supersampler.backends.base import ForkSafeLock
from supersampler.frame import Size

LINE = 64
"""Bytes of a cache line."""


def address(array: NDArray[Any]) -> int:
    """Return the address of an array's values, for kernels. The caller keeps the array alive."""
    try:
        return addressof(c_char.from_buffer(array))  # type: ignore[arg-type]  # 5x faster than `ctypes.data`
    except (TypeError, ValueError):  # read-only, empty or not contiguous
        if not array.flags.c_contiguous:
            raise ValueError("not C-contiguous") from None
        return int(array.ctypes.data)


def aligned(shape: tuple[int, ...], dtype: type[np.generic] = np.float32) -> NDArray[Any]:
    """Return zeros that start at a cache line, followed by at least one spare line.

    Arrays then share no cache line, and threads that write to different arrays do not slow each other down.
    """
    size = int(np.prod(shape)) * np.dtype(dtype).itemsize
    room = np.zeros(size + 2 * LINE, np.uint8)
    first = -room.ctypes.data % LINE
    return room[first : first + size].view(dtype).reshape(shape)


def held_bytes(thing: Any) -> int:
    """Return the bytes of all arrays that an object refers to; shared memory counts once."""
    bases: dict[int, int] = {}
    seen: set[int] = set()
    waiting = [thing]
    while waiting:
        item = waiting.pop()
        if id(item) in seen:
            continue
        seen.add(id(item))
        if isinstance(item, np.ndarray):
            base = item
            while isinstance(base.base, np.ndarray):  # a view
                base = base.base
            bases[id(base)] = base.nbytes
        elif isinstance(item, dict):
            waiting += item.values()
        elif isinstance(item, (list, tuple)):
            waiting += item
        elif type(item).__module__.startswith("supersampler."):
            waiting += getattr(item, "__dict__", {}).values()  # types of JSON files have slots, and no arrays
    return sum(bases.values())


Space = TypeVar("Space")
KEPT = 4  # sizes with free buffers, for dynamic resolution


class Workspaces(Generic[Space]):
    """A pool of buffers by size, for several threads.

    Args:
        make: allocates buffers for the sizes that are passed to `borrow`.
    """

    def __init__(self, make: Callable[..., Space]) -> None:
        self._make = make
        self._lock = ForkSafeLock()
        self._free: OrderedDict[tuple[Size, ...], list[Space]] = OrderedDict()

    @contextmanager
    def borrow(self, *sizes: Size) -> Iterator[Space]:
        """Lend free buffers, or new ones; free those of the least recently used size beyond KEPT sizes."""
        with self._lock.lock:
            free = self._free.get(sizes)
            space = free.pop() if free else None
        space = self._make(*sizes) if space is None else space
        try:
            yield space
        finally:
            with self._lock.lock:
                self._free.setdefault(sizes, []).append(space)
                self._free.move_to_end(sizes)
                while len(self._free) > KEPT:
                    self._free.popitem(last=False)
