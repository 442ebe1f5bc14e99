"""A thread pool that splits the rows of an image, or rectangles of it, among threads."""

import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

from supersampler.backends.cpu.workers import WorkerThreads

RowFunction = Callable[[int, int, int], None]
"""Called with the first row, the row after the last, and the index of the thread."""


class Rect(NamedTuple):
    """Rows y0 to before y1, columns x0 to before x1."""

    y0: int
    y1: int
    x0: int
    x1: int


RectFunction = Callable[[Rect, int], None]
"""Called with a rectangle and the index of the thread."""


class RectTask(NamedTuple):
    """A function to call on rectangles.

    Attributes:
        rects: do not overlap.
        function: called on each rectangle, or on parts of it.
        multiple: a rectangle is split only at multiples of this many rows after its first.
    """

    rects: Sequence[Rect]
    function: RectFunction
    multiple: int = 1


class ThreadPool:
    """Splits work by rows among threads, of which the calling thread is one.

    Kernels release Python's lock. The result of a row must not depend on how rows are split: then the number
    of threads changes no bit of an image.

    Args:
        threads: number of threads, the caller's included.

    Attributes:
        seconds: accumulated wall time by stage; None where it is not measured.
    """

    def __init__(self, threads: int) -> None:
        self.threads = threads
        self.seconds: dict[str, float] | None = None
        self._workers = WorkerThreads(threads - 1)

    def run_rows(self, stage: str, rows: int, function: RowFunction) -> None:
        """Call a function on all rows, from 0 on."""
        self.run_rects(stage, [Rect(0, rows, 0, 1)], lambda rect, thread: function(rect.y0, rect.y1, thread))

    def run_rects(
        self, stage: str, rects: Sequence[Rect], function: RectFunction, *, multiple: int = 1
    ) -> None:
        """Call a function on all rectangles; see `RectTask`."""
        self.run_tasks(stage, RectTask(rects, function, multiple))

    def run_tasks(self, stage: str, *tasks: RectTask) -> None:
        """Run tasks that do not depend on each other.

        When this returns or raises, no thread is at work: nothing writes to buffers that the caller then
        frees or reads; see `WorkerThreads.run`.

        Args:
            stage: name under which the time is counted.
            tasks: in the order in which each thread runs its share of them.
        """
        began = time.perf_counter()
        parts = [split(task.rects, self.threads, task.multiple) for task in tasks]

        def run_share(thread: int) -> None:
            for task, shares in zip(tasks, parts, strict=True):
                for rect in shares[thread] if thread < len(shares) else ():
                    task.function(rect, thread)

        self._workers.run([partial(run_share, thread) for thread in range(max(map(len, parts)))])
        if self.seconds is not None:
            self.seconds[stage] = self.seconds.get(stage, 0.0) + time.perf_counter() - began

    def close(self) -> None:
        """Stop the threads; later work runs on the calling thread."""
        self._workers.close()


def split(rects: Sequence[Rect], count: int, multiple: int) -> list[list[Rect]]:
    """Split rectangles into at most `count` lists of about the same area."""
    remaining = sum((y1 - y0) * (x1 - x0) for y0, y1, x0, x1 in rects)
    shares: list[list[Rect]] = [[]]
    room = -(-remaining // count)
    for rect in rects:
        y, width = rect.y0, rect.x1 - rect.x0
        while y < rect.y1:
            if room <= 0 and len(shares) < count:
                shares.append([])
                room = -(-remaining // (count - len(shares) + 1))
            rows = rect.y1 - y
            if len(shares) < count:
                rows = min(rows, max(-(-room // (width * multiple)), 1) * multiple)
            shares[-1].append(Rect(y, y + rows, rect.x0, rect.x1))
            y, room, remaining = y + rows, room - rows * width, remaining - rows * width
    return shares
