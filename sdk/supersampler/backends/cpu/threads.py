"""`ThreadPool`: splits the rows or rectangles of an image among threads."""

import time
from collections.abc import Callable, Sequence
from functools import partial
from threading import local
from typing import NamedTuple

from supersampler.backends.cpu.workers import WorkerThreads

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
