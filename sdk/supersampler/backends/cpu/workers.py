"""Worker threads that take work items from a queue. Locks, not futures: a future costs more than a stage.

The thread that waits for an item runs it where no worker has begun it. So a forked child, a process that
cannot start threads, and a closed pool go on with the threads that they have, at least the caller's.
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
    """Work that exactly one thread runs: a worker, or the thread that waits for it.

    Args:
        work: the function to call.

    Attributes:
        ended: whether a worker has run it.
        error: exception that it raised there; None where there was none.
    """

    __slots__ = ("_end", "_owner", "_work", "ended", "error")

    def __init__(self, work: Callable[[], None]) -> None:
        self._work = work
        self._owner: dict[None, str] = {}  # `setdefault` is atomic and can be repeated
        self._end = allocate_lock()  # held until a worker has ended
        self._end.acquire()
        self.ended = False
        self.error: BaseException | None = None

    def run(self) -> None:
        """Run the work as a worker, unless the waiting thread has begun; exceptions are kept in `error`."""
        if self._owner.setdefault(None, _WORKER) is not _WORKER:
            return
        try:
            self._work()
        except BaseException as error:  # raised again by the waiting thread
            self.error = error
        del self._work  # frees what the work holds before the waiting thread continues
        self.ended = True
        self._end.release()

    def finish(self) -> None:
        """Run the work where no worker has begun it, else wait for its end; raises its exception."""
        if self._owner.setdefault(None, _WAITER) is _WAITER:
            self._work()
            return
        self._wait()
        if self.error is not None:
            raise self.error

    def settle(self) -> None:
        """Return once no worker runs the work or ever will. Suppresses exceptions of signal handlers."""
        while not (self._owner.setdefault(None, _WAITER) is _WAITER or self.ended):
            with suppress(BaseException):
                self._wait()

    def _wait(self) -> None:
        if not self.ended:  # an interrupted wait may have taken the lock already
            self._end.acquire()


class WorkerThreads:
    """Worker threads, started with the first work, stopped by `close` or with this object.

    Args:
        count: number of threads.
    """

    def __init__(self, count: int) -> None:
        self._count = count
        self._crew = _Crew()
        self.close = weakref.finalize(self, self._crew.stop)
        _CREWS.add(self._crew)

    def run(self, works: Sequence[Callable[[], None]]) -> None:
        """Run all functions, the first in this thread; when this returns or raises, none is running.

        This holds where a signal handler raises (Ctrl-C), which Python runs between any two operations of the
        main thread. Functions that no thread has begun are then left out.

        Raises:
            BaseException: what a function or a signal handler raises.
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
        finally:  # a second signal may have interrupted the first call
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
    """Queue and threads of one `WorkerThreads`. A forked child starts its own: threads are not copied."""

    def __init__(self) -> None:
        self.begin()

    def begin(self) -> None:
        """Start with no threads."""
        self.queue: SimpleQueue[WorkItem | None] = SimpleQueue()
        self._started = 0
        self._lock = allocate_lock()

    def start(self, count: int) -> None:
        """Start threads up to this many; fewer where the system refuses."""
        if self._started < count:
            with self._lock, suppress(RuntimeError):
                while self._started < count:
                    threading.Thread(
                        target=_take, args=(self.queue,), name="supersampler", daemon=True
                    ).start()
                    self._started += 1

    def stop(self) -> None:
        """Stop the threads, each after its current item."""
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
        del item  # frees what the item holds before the next one
    queue.put(None)  # for the next thread: an interrupted start may not have been counted
