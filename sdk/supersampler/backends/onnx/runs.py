"""Runs of ONNX Runtime, which the end of the interpreter waits for.

A daemon thread's run that is under way when the process tears ONNX Runtime down ends the process by abort.
"""

import atexit
import os
import time
from _thread import get_ident
from threading import Event
from types import TracebackType

_PATIENCE = 30.0  # seconds that the end of the interpreter waits at most
_running: set[int] = set()  # threads that are within a run
_ended = Event()


class OnnxRun:
    """Context of one run: `with OnnxRun(): session.run(...)`. Once the interpreter ends, no run begins."""

    def __enter__(self) -> None:
        _running.add(get_ident())
        if _ended.is_set():
            _running.discard(get_ident())
            Event().wait()  # for good: this is a daemon thread of a process that ends

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        _running.discard(get_ident())


@atexit.register
def _wait_for_runs() -> None:
    _ended.set()
    latest = time.monotonic() + _PATIENCE
    while _running - {get_ident()} and time.monotonic() < latest:
        time.sleep(0.002)


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_running.clear)
