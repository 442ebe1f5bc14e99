"""Buffers for frames of one size, lent to one step at a time."""

from collections import OrderedDict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Generic, TypeVar

from supersampler.backends.locks import ForkSafeLock
from supersampler.frame import Size

Space = TypeVar("Space")
KEPT = 4  # sizes: what a dynamic resolution goes back and forth between


class Workspaces(Generic[Space]):
    """Makes buffers where none are free; several threads may borrow.

    Args:
        make: of the sizes that `borrow` is called with.
    """

    def __init__(self, make: Callable[..., Space]) -> None:
        self._make = make
        self._lock = ForkSafeLock()
        self._free: OrderedDict[tuple[Size, ...], list[Space]] = OrderedDict()

    @contextmanager
    def borrow(self, *sizes: Size) -> Iterator[Space]:
        """Lend buffers; those of sizes that have not been asked for in a while are given up."""
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
