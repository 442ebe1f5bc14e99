"""Parts of an image shared out among threads."""

import time
from collections.abc import Callable, Sequence
from functools import partial
from typing import NamedTuple

from supersampler.backends.cpu.workers import WorkerThreads

Work = Callable[[int, int, int], None]
"""Does rows from the first to before the second, as the worker of the third number."""


class Rect(NamedTuple):
    """Rows y0 to before y1, columns x0 to before x1."""

    y0: int
    y1: int
    x0: int
    x1: int


RectWork = Callable[[Rect, int], None]
"""Does a box, as the worker of this number."""


class Job(NamedTuple):
    """Boxes to do.

    Attributes:
        boxes: do not overlap.
        work: on each.
        multiple: of rows, after a box's first, at which it may be cut.
    """

    boxes: Sequence[Rect]
    work: RectWork
    multiple: int = 1


class ThreadPool:
    """Threads that do bands of rows; the caller's own is one of them.

    Kernels let other threads run, so Python's lock is no limit. What a row becomes must not depend on the
    band that it is in: then the number of threads changes no bit.

    Args:
        threads: how many.

    Attributes:
        seconds: wall time by stage; None: not noted.
    """

    def __init__(self, threads: int) -> None:
        self.threads = threads
        self.seconds: dict[str, float] | None = None
        self._workers = WorkerThreads(threads - 1)

    def run(self, stage: str, rows: int, work: Work) -> None:
        """Do all rows."""
        self.cover(stage, [Rect(0, rows, 0, 1)], lambda box, worker: work(box.y0, box.y1, worker))

    def cover(self, stage: str, boxes: Sequence[Rect], work: RectWork, *, multiple: int = 1) -> None:
        """Do all boxes, cut where the threads' shares end; see `Job`."""
        self.together(stage, Job(boxes, work, multiple))

    def together(self, stage: str, *jobs: Job) -> None:
        """Do jobs of which none needs what another does. When this returns or raises, nothing is under way.

        So no thread writes to what the caller then frees or reads; see `WorkerThreads.run`.

        Args:
            stage: what the time counts as.
            jobs: which.
        """
        began = time.perf_counter()
        shares = [shared(job.boxes, self.threads, job.multiple) for job in jobs]

        def do(worker: int) -> None:
            for job, parts in zip(jobs, shares, strict=True):
                for box in parts[worker] if worker < len(parts) else ():
                    job.work(box, worker)

        self._workers.run([partial(do, worker) for worker in range(max(map(len, shares)))])
        if self.seconds is not None:
            self.seconds[stage] = self.seconds.get(stage, 0.0) + time.perf_counter() - began

    def close(self) -> None:
        """Stop the threads; what is still to be done is done by the thread that asks for it."""
        self._workers.close()


def shared(boxes: Sequence[Rect], count: int, multiple: int) -> list[list[Rect]]:
    """Cut boxes into at most `count` shares of about the same area."""
    left = sum((y1 - y0) * (x1 - x0) for y0, y1, x0, x1 in boxes)
    shares: list[list[Rect]] = [[]]
    room = -(-left // count)
    for box in boxes:
        y, width = box.y0, box.x1 - box.x0
        while y < box.y1:
            if room <= 0 and len(shares) < count:
                shares.append([])
                room = -(-left // (count - len(shares) + 1))
            rows = box.y1 - y
            if len(shares) < count:
                rows = min(rows, max(-(-room // (width * multiple)), 1) * multiple)
            shares[-1].append(Rect(y, y + rows, box.x0, box.x1))
            y, room, left = y + rows, room - rows * width, left - rows * width
    return shares
