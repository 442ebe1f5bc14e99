"""Work that signal handlers do not interrupt.

Python runs signal handlers (Ctrl-C raises KeyboardInterrupt in one) between any two operations of the main
thread, and in no other thread. So what must not be left half done is done by another thread, for which the
main thread waits to the end; what a handler raises goes on from there.
"""

import os
import threading
from _thread import allocate_lock, get_ident
from collections.abc import Callable
from contextlib import suppress
from queue import SimpleQueue
from typing import Any, Generic, TypeVar, cast

Returned = TypeVar("Returned")


def uninterrupted(work: Callable[[], Returned]) -> Returned:
    """Do all of `work`, or none of it, whatever signal handlers raise meanwhile.

    What a handler raises is raised after the work has ended; if that had not begun, it never does. From
    threads other than the main one, `work` is called as it is.

    Returns:
        What `work` returns.

    Raises:
        BaseException: what `work` or a signal handler raises.
    """
    if get_ident() != threading.main_thread().ident or not _DRIVER.start():
        return work()
    task: _Task[Returned] = _Task(work)
    try:
        try:
            _DRIVER.queue.put(task)
            task.wait()
        finally:
            task.settle()
    finally:  # of several signals in a row, one may have struck between the two
        task.settle()
    return task.result()


class _Task(Generic[Returned]):
    """What the driver is to do, once."""

    __slots__ = ("_end", "_error", "_returned", "_work", "cancelled", "done")

    def __init__(self, work: Callable[[], Returned]) -> None:
        self._work = work
        self._returned: Returned | None = None
        self._error: BaseException | None = None
        self._end = allocate_lock()  # held until the end
        self._end.acquire()
        self.cancelled = self.done = False

    def run(self) -> None:
        try:
            if not self.cancelled:
                self._returned = self._work()
        except BaseException as error:  # raised again in the main thread
            self._error = error
        del self._work  # what it holds may be freed before the main thread goes on
        self.done = True
        self._end.release()

    def wait(self) -> None:
        if not self.done:  # else a wait that was interrupted may have taken the lock already
            self._end.acquire()

    def settle(self) -> None:
        """Wait for the end, or see to it that the work does not begin; raises nothing."""
        while not self.done:
            self.cancelled = True
            with suppress(BaseException):
                _DRIVER.queue.put(self)  # again, as the first put may not have happened
                self.wait()

    def result(self) -> Returned:
        error, self._error = self._error, None  # else a cycle: the error, its frames, this task
        if error is not None:
            raise error
        return cast("Returned", self._returned)


class _Driver:
    """The thread that does such work for the main one; another in a forked child."""

    def __init__(self) -> None:
        self.begin()

    def begin(self) -> None:
        self.queue: SimpleQueue[_Task[Any]] = SimpleQueue()
        self._started = False

    def start(self) -> bool:
        """Start the thread where it is not running; False where the system gives none."""
        if not self._started:
            with suppress(RuntimeError):
                thread = threading.Thread(
                    target=_drive, args=(self.queue,), name="supersampler steps", daemon=True
                )
                thread.start()
                self._started = True
        return self._started


def _drive(queue: "SimpleQueue[_Task[Any]]") -> None:
    while True:
        task = queue.get()
        if not task.done:
            task.run()
        del task


_DRIVER = _Driver()
if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_DRIVER.begin)
