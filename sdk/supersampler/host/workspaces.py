"""Buffers for frames of one size, lent to one step at a time."""

import threading
from collections import OrderedDict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Generic, TypeVar

from supersampler.frame import Size

Space = TypeVar("Space")
KEPT = 8  # pairs of sizes: what dynamic resolution goes through in a while


class Workspaces(Generic[Space]):
    """Makes buffers where none are free; several threads may borrow.

    Args:
        make: of a render and a display size.
    """

    def __init__(self, make: Callable[[Size, Size], Space]) -> None:
        self._make = make
        self._lock = threading.Lock()
        self._free: OrderedDict[tuple[Size, Size], list[Space]] = OrderedDict()

    @contextmanager
    def borrow(self, render: Size, display: Size) -> Iterator[Space]:
        """Lend buffers; those of sizes that have not been asked for in a while are given up."""
        key = render, display
        with self._lock:
            free = self._free.get(key)
            space = free.pop() if free else None
        space = self._make(render, display) if space is None else space
        try:
            yield space
        finally:
            with self._lock:
                self._free.setdefault(key, []).append(space)
                self._free.move_to_end(key)
                while len(self._free) > KEPT:
                    self._free.popitem(last=False)
