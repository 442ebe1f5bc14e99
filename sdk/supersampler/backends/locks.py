"""Locks that a forked child finds free: the thread that may have held one in the parent is not there."""

import os
import weakref
from _thread import allocate_lock


class ForkSafeLock:
    """A lock for `with lock.lock:`, which a signal handler that raises cannot leave held.

    (Between the acquisition and the block of a `with` on a lock of Python's own no handler runs; in an
    `__enter__` of ours it would.)

    Attributes:
        lock: Python's lock.
    """

    def __init__(self) -> None:
        self.renew()
        _LOCKS.add(self)

    def renew(self) -> None:
        """Replace the lock by a new one, which is free."""
        self.lock = allocate_lock()


_LOCKS: "weakref.WeakSet[ForkSafeLock]" = weakref.WeakSet()


def _renew_all() -> None:
    for lock in _LOCKS:
        lock.renew()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_renew_all)
