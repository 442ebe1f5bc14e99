"""Locks that are free in a forked child, where no thread exists that could release them."""

import os
import weakref
from _thread import allocate_lock


class ForkSafeLock:
    """A lock for `with fork_safe.lock:`.

    The `with` statement must use Python's own lock: no signal handler runs between its acquisition and the
    block, whereas one that raises in an `__enter__` of this class would leave the lock held.

    Attributes:
        lock: Python's lock; a forked child gets a new one.
    """

    def __init__(self) -> None:
        self.lock = allocate_lock()
        _LOCKS.add(self)


_LOCKS: "weakref.WeakSet[ForkSafeLock]" = weakref.WeakSet()


def _renew_all() -> None:
    for fork_safe in _LOCKS:
        fork_safe.lock = allocate_lock()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_renew_all)
