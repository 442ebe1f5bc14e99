"""`ThreadPool`: splits the rows or rectangles of an image among threads.

Worker threads take work items from a queue. They use locks, as futures are slower than some stages. A thread
that waits for an item runs it itself if no worker has started it. Work therefore completes even in a forked
child, in a process that cannot start threads, and in a closed pool.
"""

import os
import threading
import time
import weakref
from _thread import allocate_lock
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from queue import SimpleQueue
from threading import local
from typing import NamedTuple

RowFunction = Callable[[int, int, int], None]
"""Called with the first row, the row after the last, and the index of the thread."""


class Rect(NamedTuple):
    """A rectangle of pixels: rows y0 to y1 - 1, columns x0 to x1 - 1."""

    y0: int
    y1: int
    x0: int
    x1: int


RectFunction = Callable[[Rect, int], None]
"""Called with a rectangle and the index of the thread."""


class RectTask(NamedTuple):
    """A function to call on rectangles.

    Attributes:
        rects: rectangles that do not overlap.
        function: called on each rectangle, or on parts of it.
        multiple: a rectangle is split only at multiples of this number of rows.
    """

    rects: Sequence[Rect]
    function: RectFunction
    multiple: int = 1


class ThreadPool:
    """Splits work by rows among threads; the calling thread is one of them.

    The result of a row must not depend on how rows are split, so that any number of threads computes the same
    image, bit for bit.

    Args:
        threads: number of threads, the calling one included.

    Attributes:
        threads: as given.
        stages: attributes of each thread that calls: its wall seconds by stage.
    """

    def __init__(self, threads: int) -> None:
        self.threads = threads
        self.stages = local()
        self._workers = WorkerThreads(threads - 1)

    def run_rows(self, stage: str, rows: int, function: RowFunction) -> None:
        """Call a function on rows 0 to rows - 1, in parts."""
        self.run_rects(stage, [Rect(0, rows, 0, 1)], lambda rect, thread: function(rect.y0, rect.y1, thread))

    def run_rects(
        self, stage: str, rects: Sequence[Rect], function: RectFunction, *, multiple: int = 1
    ) -> None:
        """Call a function on rectangles; see `RectTask`."""
        self.run_tasks(stage, RectTask(rects, function, multiple))

    def run_tasks(self, stage: str, *tasks: RectTask) -> None:
        """Run tasks that do not depend on each other.

        When this returns or raises, all threads have stopped, so the caller may free the buffers that they
        write to; see `WorkerThreads.run`.

        Args:
            stage: name in `stages`.
            tasks: the tasks; each thread runs its parts of them in this order.
        """
        started = time.perf_counter()
        parts = [split(task.rects, self.threads, task.multiple) for task in tasks]

        def run_parts(thread: int) -> None:
            for task, task_parts in zip(tasks, parts, strict=True):
                for rect in task_parts[thread] if thread < len(task_parts) else ():
                    task.function(rect, thread)

        self._workers.run([partial(run_parts, thread) for thread in range(max(map(len, parts)))])
        stages = vars(self.stages)
        stages[stage] = stages.get(stage, 0.0) + time.perf_counter() - started

    def close(self) -> None:
        """Stop the threads; later work runs in the calling thread."""
        self._workers.close()


def split(rects: Sequence[Rect], count: int, multiple: int) -> list[list[Rect]]:
    """Split rectangles into at most `count` lists of about the same area."""
    remaining = sum((y1 - y0) * (x1 - x0) for y0, y1, x0, x1 in rects)
    parts: list[list[Rect]] = [[]]
    room = -(-remaining // count)  # pixels that still belong into the last list
    for rect in rects:
        y, width = rect.y0, rect.x1 - rect.x0
        while y < rect.y1:
            if room <= 0 and len(parts) < count:
                parts.append([])
                room = -(-remaining // (count - len(parts) + 1))
            rows = rect.y1 - y
            if len(parts) < count:
                rows = min(rows, max(-(-room // (width * multiple)), 1) * multiple)
            parts[-1].append(Rect(y, y + rows, rect.x0, rect.x1))
            y, room, remaining = y + rows, room - rows * width, remaining - rows * width
    return parts


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
