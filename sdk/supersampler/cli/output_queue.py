"""`OutputQueue`: writes the images of a run on other threads, a few at a time."""

import os
from collections import deque
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from types import TracebackType
from typing import Generic, TypeVar

Written = TypeVar("Written")


class OutputQueue(Generic[Written]):
    """Runs functions on threads, and hands their results on in order, on the caller's thread.

    At most one function more than there are threads waits, so that images in memory are few.

    Args:
        then: called with each result, in the order of `put`.
    """

    def __init__(self, then: Callable[[Written], None]) -> None:
        threads = max(2, min(8, os.cpu_count() or 1))
        self._pool = ThreadPoolExecutor(threads, thread_name_prefix="write")
        self._then, self._most = then, threads + 1
        self._waiting: deque[Future[Written]] = deque()

    def put(self, function: Callable[[], Written]) -> None:
        """Run a function when a thread is free; raises what an earlier one raised."""
        self._waiting.append(self._pool.submit(function))
        while self._waiting and (len(self._waiting) > self._most or self._waiting[0].done()):
            self._then(self._waiting.popleft().result())

    def __enter__(self) -> "OutputQueue[Written]":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Wait until all functions have run, also after an error; after an error no result is handed on."""
        try:
            while error is None and self._waiting:
                self._then(self._waiting.popleft().result())
        finally:
            self._pool.shutdown()
