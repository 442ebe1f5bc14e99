"""Rows of an image shared out among threads."""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor

Work = Callable[[int, int, int], None]
"""Does rows from the first to before the second, as the worker of the third number."""


class Bands:
    """Threads that do a band of rows each; the caller's own is one of them.

    Kernels let other threads run, so Python's lock is no limit. What a row becomes must not depend on the
    band that it is in: then the number of threads changes no bit.

    Args:
        threads: how many.
    """

    def __init__(self, threads: int) -> None:
        self.threads = threads
        self._others = ThreadPoolExecutor(threads - 1, "supersampler") if threads > 1 else None

    def run(self, rows: int, work: Work, *, multiple: int = 1) -> None:
        """Do all rows; bands begin at multiples of `multiple`."""
        height = -(-rows // (self.threads * multiple)) * multiple
        starts = range(0, rows, height)
        waiting = [
            self._others.submit(work, first, min(first + height, rows), worker)
            for worker, first in enumerate(starts)
            if worker and self._others is not None
        ]
        work(0, min(height, rows), 0)
        for future in waiting:
            future.result()

    def close(self) -> None:
        """Stop the threads."""
        if self._others is not None:
            self._others.shutdown()
