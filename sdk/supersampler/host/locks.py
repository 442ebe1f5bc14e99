"""A lock that a forked child finds free: the thread that may have held it in the parent is not there."""

import os
import weakref
from _thread import allocate_lock
from types import TracebackType


class Lock:
    """Use with `with`; as `threading.Lock` otherwise."""

    def __init__(self) -> None:
        self._lock = allocate_lock()
        _LOCKS.add(self)

    def __enter__(self) -> None:
        self._lock.acquire()

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._lock.release()

    def free(self) -> None:
        """Become another lock, which nobody holds."""
        self._lock = allocate_lock()


_LOCKS: "weakref.WeakSet[Lock]" = weakref.WeakSet()


def _free_all() -> None:
    for lock in _LOCKS:
        lock.free()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_free_all)
