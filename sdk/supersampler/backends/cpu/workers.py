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

_WORKER, _WAITER = "worker", "waiter"


class WorkItem:
    """Work that exactly one thread does: a worker, or the thread that waits for it.

    Args:
        work: what to do.

    Attributes:
        ended: whether a worker has done it.
        error: what it raised there; None where nothing.
    """

    __slots__ = ("_end", "_owner", "_work", "ended", "error")

    def __init__(self, work: Callable[[], None]) -> None:
        self._work = work
        self._owner: dict[None, str] = {}  # `setdefault` is atomic, and tells the same when asked again
        self._end = allocate_lock()  # held until a worker has ended
        self._end.acquire()
        self.ended = False
        self.error: BaseException | None = None

    def run(self) -> None:
        """Do the work as a worker, unless the waiting thread has begun; what it raises is kept in `error`."""
        if self._owner.setdefault(None, _WORKER) is not _WORKER:
            return
        try:
            self._work()
        except BaseException as error:  # raised again by who waits
            self.error = error
        del self._work  # what it holds may be freed before who waits goes on
        self.ended = True
        self._end.release()

    def finish(self) -> None:
        """Do the work where no worker has begun, else wait for the end; raises what it raised."""
        if self._owner.setdefault(None, _WAITER) is _WAITER:
            self._work()
            return
        self._wait()
        if self.error is not None:
            raise self.error

    def settle(self) -> None:
        """Return once no worker does the work, nor ever will; raises nothing that a signal handler raises."""
        while not (self._owner.setdefault(None, _WAITER) is _WAITER or self.ended):
            with suppress(BaseException):
                self._wait()

    def _wait(self) -> None:
        if not self.ended:  # else a wait that was interrupted may have taken the lock already
            self._end.acquire()


class WorkerThreads:
    """So many threads, started with the first work, until `close` or until this object is dropped.

    Args:
        count: how many.
    """

    def __init__(self, count: int) -> None:
        self._count = count
        self._crew = _Crew()
        self.close = weakref.finalize(self, self._crew.stop)
        _CREWS.add(self._crew)

    def run(self, works: Sequence[Callable[[], None]]) -> None:
        """Do all works, the first in this thread; when this returns or raises, none is under way.

        Also where a signal handler raises, Ctrl-C say: Python runs those between any two operations of the
        main thread. What the threads have not begun is then not done at all.

        Raises:
            BaseException: what one of the works or a signal handler raises.
        """
        items = [WorkItem(work) for work in works[1:]]
        try:
            try:
                self._submit(items)
                works[0]()
                for item in items:
                    item.finish()
            finally:
                _settle(items)
        finally:  # of several signals in a row, one may have struck between the two
            _settle(items)

    def _submit(self, items: Sequence[WorkItem]) -> None:
        if items and self.close.alive:
            self._crew.start(self._count)
            for item in items:
                self._crew.queue.put(item)


def _settle(items: Sequence[WorkItem]) -> None:
    for item in items:
        item.settle()


class _Crew:
    """Queue and threads of one `WorkerThreads`; others in a forked child, where none of the threads is."""

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
    queue.put(None)  # for the next thread: a start that was interrupted may not have been counted
