"""Worker threads that take work items from a queue. They use locks, as futures are slower than some stages.

A thread that waits for an item runs it itself if no worker has started it. Work therefore completes even in a
forked child, in a process that cannot start threads, and in a closed pool.
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
        error: the exception that it raised in the worker, or None.
    """

    __slots__ = ("_end", "_owner", "_work", "ended", "error")

    def __init__(self, work: Callable[[], None]) -> None:
        self._work = work
        self._owner: dict[None, str] = {}  # `setdefault` is atomic, and may be repeated after an interrupt
        self._end = allocate_lock()  # held until a worker has run the work
        self._end.acquire()
        self.ended = False
        self.error: BaseException | None = None

    def run(self) -> None:
        """Run the work as a worker, unless the waiting thread has started it; keep its exception."""
        if self._owner.setdefault(None, _WORKER) is not _WORKER:
            return
        try:
            self._work()
        except BaseException as error:  # `finish` raises it in the waiting thread
            self.error = error
        del self._work  # frees its references before the waiting thread continues
        self.ended = True
        self._end.release()

    def finish(self) -> None:
        """Run the work if no worker has started it, else wait until it has ended; raise its exception."""
        if self._owner.setdefault(None, _WAITER) is _WAITER:
            self._work()
            return
        self._wait()
        if self.error is not None:
            raise self.error

    def settle(self) -> None:
        """Wait until no worker runs the work or can start it; suppress exceptions of signal handlers."""
        while not (self._owner.setdefault(None, _WAITER) is _WAITER or self.ended):
            with suppress(BaseException):
                self._wait()

    def _wait(self) -> None:
        if not self.ended:  # an interrupted wait may already have acquired the lock
            self._end.acquire()


class WorkerThreads:
    """Worker threads, started on the first `run`, stopped by `close` or when this object is deleted.

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

        A signal handler (Ctrl-C) may raise between any two operations of the main thread: functions that have
        not started are then skipped, and the others are waited for.

        Raises:
            BaseException: an exception of a function or of a signal handler.
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
        finally:  # in case another signal interrupted the first `_settle`
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
    """The queue and threads of a `WorkerThreads`. A forked child has none of the threads, and starts anew."""

    def __init__(self) -> None:
        self.forget()

    def forget(self) -> None:
        """Forget all threads and queued items."""
        self.queue: SimpleQueue[WorkItem | None] = SimpleQueue()
        self._started = 0
        self._lock = allocate_lock()

    def start(self, count: int) -> None:
        """Start threads until there are `count`; fewer if the system refuses."""
        if self._started < count:
            with self._lock, suppress(RuntimeError):
                while self._started < count:
                    thread = threading.Thread(target=_run_items, args=(self.queue,), daemon=True)
                    thread.name = "supersampler"
                    thread.start()
                    self._started += 1

    def stop(self) -> None:
        """Stop each thread after its current item."""
        self.queue.put(None)


_CREWS: "weakref.WeakSet[_Crew]" = weakref.WeakSet()


def _forget_threads() -> None:
    for crew in _CREWS:
        crew.forget()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_forget_threads)


def _run_items(queue: "SimpleQueue[WorkItem | None]") -> None:
    while (item := queue.get()) is not None:
        item.run()
        del item  # frees its references while the thread waits for the next one
    queue.put(None)  # stops the next thread; an interrupted `start` may not have counted all threads
