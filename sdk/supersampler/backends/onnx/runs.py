"""Lets the interpreter wait at its end for runs of ONNX Runtime in daemon threads.

Otherwise a run that is in progress while the process unloads ONNX Runtime aborts the process.
"""

import atexit
import os
import time
from _thread import get_ident
from threading import Event
from types import TracebackType

_MAX_SECONDS = 30.0  # that the interpreter waits
_running: set[int] = set()  # threads that are in a run
_ended = Event()


class OnnxRun:
    """Context of a run: `with OnnxRun(): session.run(...)`. No run starts once the interpreter ends."""

    def __enter__(self) -> None:
        _running.add(get_ident())
        if _ended.is_set():
            _running.discard(get_ident())
            Event().wait()  # forever, as this is a daemon thread of a process that ends

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        _running.discard(get_ident())


@atexit.register
def _wait_for_runs() -> None:
    _ended.set()
    latest = time.monotonic() + _MAX_SECONDS
    while _running - {get_ident()} and time.monotonic() < latest:
        time.sleep(0.002)


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_running.clear)
