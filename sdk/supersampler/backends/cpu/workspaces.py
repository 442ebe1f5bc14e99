"""`Workspaces`: a pool of work buffers by size, from which each step borrows a set."""

from collections import OrderedDict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Generic, TypeVar

from supersampler.backends.base import ForkSafeLock
from supersampler.frame import Size

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
