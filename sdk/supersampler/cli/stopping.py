"""Signals that stop a command: it ends what it has started, and keeps what is complete."""

import os
import signal
import sys
from contextlib import suppress
from threading import Thread, main_thread
from types import FrameType

END_WITH_STDIN = "SUPERSAMPLER_END_WITH_STDIN"
"""Environment variable: the command stops, as by Ctrl-C, when its standard input closes.

A program that runs a command keeps this pipe open. It closes the pipe to stop the command, as its own end
does. This works where SIGINT is ignored or, as on Windows, cannot be sent.
"""
_INTERRUPTED = 128 + signal.SIGINT
_received = [int(signal.SIGINT)]


def stop_on_signals() -> None:
    """Make SIGTERM and SIGHUP raise KeyboardInterrupt, unless they are ignored; a second one ends at once."""
    for name in ("SIGTERM", "SIGHUP"):
        number = getattr(signal, name, None)
        if number is not None and signal.getsignal(number) is signal.SIG_DFL:
            signal.signal(number, _interrupt)
    if os.environ.pop(END_WITH_STDIN, "") and sys.stdin is not None:
        signal.signal(signal.SIGINT, signal.default_int_handler)
        Thread(target=_interrupt_when_closed, name="stdin", daemon=True).start()


def exit_code(code: str | int | None) -> str | int | None:
    """Return the code to exit with: 128 + n where signal n has stopped the command."""
    return 128 + _received[-1] if code == _INTERRUPTED else code


def _interrupt(number: int, _: FrameType | None) -> None:
    _received.append(number)
    signal.signal(number, signal.SIG_DFL)
    raise KeyboardInterrupt


def _interrupt_when_closed() -> None:
    with suppress(OSError):
        while os.read(0, 4096):
            pass
    if hasattr(signal, "pthread_kill") and main_thread().ident is not None:  # wakes it where it waits
        signal.pthread_kill(main_thread().ident or 0, signal.SIGINT)
    else:
        signal.raise_signal(signal.SIGINT)
