"""Threads that take work from a queue. Locks, not futures: a stage may be shorter than what a future costs.

Who waits for an item does it himself where no thread has begun it. So a forked child, a process that gets no
thread from the system, and a closed pool go on with the threads that they have, the caller's at least.
"""

import os
import threading
import weakref
from _thread import allocate_lock
from collections.abc import Callable, Sequence
from contextlib import suppress
from queue import SimpleQueue


class WorkItem:
    """Work that exactly one thread does.

    Args:
        work: what to do.

    Attributes:
        error: what it raised; None where nothing.
    """

    __slots__ = ("_claim", "_end", "_work", "error")

    def __init__(self, work: Callable[[], None]) -> None:
        self._work = work
        self._claim = allocate_lock()  # taken by the thread that does the work, and never released
        self._end = allocate_lock()  # held until the work has ended
        self._end.acquire()
        self.error: BaseException | None = None

    def run(self) -> None:
        """Do the work, unless another thread has begun; what it raises is kept in `error`."""
        if not self._claim.acquire(blocking=False):
            return
        try:
            self._work()
        except BaseException as error:  # raised again by who waits
            self.error = error
        del self._work  # what it holds may be freed before who waits goes on
        self._end.release()

    def wait(self) -> None:
        """Wait for the end."""
        self._end.acquire()


class Workers:
    """So many threads, started with the first work, until `close` or until this object is dropped.

    Args:
        count: how many.
    """

    def __init__(self, count: int) -> None:
        self._count = count
        self._crew = _Crew()
        self.close = weakref.finalize(self, self._crew.stop)
        _CREWS.add(self._crew)

    def submit(self, work: Callable[[], None]) -> WorkItem:
        """Have a thread do it, or who waits for it."""
        item = WorkItem(work)
        if self.close.alive:
            self._crew.start(self._count)
            self._crew.queue.put(item)
        return item


def finish(items: Sequence[WorkItem]) -> None:
    """Do what no thread has begun, wait for the rest, and then raise what one of them raised.

    For threads that signal handlers do not interrupt (see `uninterrupted`).
    """
    for item in items:
        item.run()
    for item in items:
        item.wait()
    for item in items:
        if item.error is not None:
            raise item.error


class _Crew:
    """Queue and threads of one `Workers`; others in a forked child, where none of the threads is."""

    def __init__(self) -> None:
        self.begin()

    def begin(self) -> None:
        """Have no threads yet."""
        self.queue: SimpleQueue[WorkItem | None] = SimpleQueue()
        self._started = 0
        self._lock = allocate_lock()

    def start(self, count: int) -> None:
        """Start threads up to this many; fewer where the system gives no more."""
        if self._started < count:
            with self._lock, suppress(RuntimeError):
                while self._started < count:
                    threading.Thread(
                        target=_take, args=(self.queue,), name="supersampler", daemon=True
                    ).start()
                    self._started += 1

    def stop(self) -> None:
        """End the threads, each after what it does."""
        for _ in range(self._started):
            self.queue.put(None)


_CREWS: "weakref.WeakSet[_Crew]" = weakref.WeakSet()


def _begin_all() -> None:
    for crew in _CREWS:
        crew.begin()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_begin_all)


def _take(queue: "SimpleQueue[WorkItem | None]") -> None:
    while (item := queue.get()) is not None:
        item.run()
        del item  # what it holds may be freed before the next
