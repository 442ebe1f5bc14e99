"""Child processes that end with this process, whether it ends normally, by an error, or by a signal.

A supervisor runs the program. A pipe connects it with this process, and closes when this process ends or
calls `stop`. The supervisor then ends the program and the processes that the program started: by SIGTERM, and
after `GRACE` seconds by SIGKILL. On Windows it ends only the program. A frozen application has no Python
interpreter to run the supervisor: there `close` ends the program, but a killed application leaves it running.

This file is also the supervisor's program. It imports only the standard library.
"""

import errno
import os
import shutil
import signal
import subprocess
import sys
import threading
from collections.abc import Mapping, Sequence
from contextlib import nullcontext, suppress
from pathlib import Path
from typing import IO

GRACE = 3.0
"""Seconds between SIGTERM and SIGKILL."""


class ChildProcess:
    """A running program, in a session of its own; its standard input is empty.

    Args:
        command: the program and its arguments.
        environment: environment of the program; None is this process's.
        folder: its working directory; None is this process's.
        joined: whether stdout and stderr share one pipe.

    Attributes:
        output: the pipe of stdout, binary; the reader closes it.

    Raises:
        OSError: the program cannot be started.
    """

    def __init__(
        self,
        command: Sequence[str],
        *,
        environment: Mapping[str, str] | None = None,
        folder: Path | None = None,
        joined: bool = True,
    ) -> None:
        if shutil.which(command[0]) is None:  # the supervisor would report it later
            number = errno.EACCES if os.path.exists(command[0]) else errno.ENOENT  # noqa: PTH110  # never raises
            raise OSError(number, os.strerror(number), command[0])
        # In a frozen application, sys.executable is the application, not a Python interpreter.
        self._supervised = Path(sys.executable or "").stem.lower().startswith("python")
        supervisor = [sys.executable, "-I", "-S", __file__] if self._supervised else []
        read_end, write_end = os.pipe()
        self._stop_pipe: int | None = write_end
        self._closing = threading.Lock()
        try:
            self._process = subprocess.Popen(  # noqa: S603  # the caller names the program
                [*supervisor, *command],
                stdin=read_end if self._supervised else subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT if joined else subprocess.PIPE,
                cwd=folder,
                env=environment,
                start_new_session=True,  # Ctrl-C at a terminal reaches this process, which ends the program
                creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),
            )
        except BaseException:
            os.close(write_end)
            raise
        finally:
            os.close(read_end)
        self.output: IO[bytes] | None = self._process.stdout

    def poll(self) -> int | None:
        """Return the exit code, 128 + n if signal n ended the program; None while it runs."""
        code = self._process.poll()
        return code if code is None or code >= 0 else 128 - code

    def wait(self, seconds: float) -> int | None:
        """Wait until the program ends; return its exit code, or None if it still runs after `seconds`."""
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(seconds)
        return self.poll()

    def stop(self) -> None:
        """Tell the program to end; returns at once."""
        with self._closing:  # a second `os.close` could close another file
            stop_pipe, self._stop_pipe = self._stop_pipe, None
        if stop_pipe is not None:
            os.close(stop_pipe)
            if not self._supervised:
                _signal_group(self._process, _TERMINATE)

    def close(self) -> None:
        """End the program, if it still runs; waits 2 * `GRACE` seconds at most, then kills it."""
        self.stop()
        if self.wait(2 * GRACE) is None:  # the supervisor hangs, or there is none
            _signal_group(self._process, _KILL)
            self.wait(GRACE)

    def __enter__(self) -> "ChildProcess":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def run(
    command: Sequence[str],
    *,
    seconds: float | None,
    environment: Mapping[str, str] | None = None,
    folder: Path | None = None,
) -> "subprocess.CompletedProcess[bytes]":
    """Run a program to its end; its standard input is empty.

    See `ChildProcess` for the arguments; `seconds` is the time limit, None for no limit.

    Raises:
        OSError: the program cannot be started.
        subprocess.TimeoutExpired: the program took longer, and was ended.
    """
    child = ChildProcess(command, environment=environment, folder=folder, joined=False)
    with child._process.stdout or nullcontext(), child._process.stderr or nullcontext(), child:
        output, errors = child._process.communicate(timeout=seconds)
        return subprocess.CompletedProcess(command, child.poll() or 0, output, errors)


def end_text(code: int | None) -> str:
    """Return "code 3" or "SIGABRT" for an exit code of `ChildProcess.poll`."""
    with suppress(ValueError):
        if code is not None and code > 128:
            return signal.Signals(code - 128).name
    return f"code {code}"


_TERMINATE = signal.SIGTERM
_KILL = getattr(signal, "SIGKILL", signal.SIGTERM)  # Windows has no SIGKILL


def _signal_group(process: "subprocess.Popen[bytes]", number: int) -> None:
    """Send a signal to a running process and to the processes that it started."""
    if process.poll() is None:
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(process.pid, number) if hasattr(os, "killpg") else process.send_signal(number)


def _supervise(command: Sequence[str]) -> int:
    """Run a program until it ends or standard input closes; return its exit code."""
    for name in ("SIGTERM", "SIGINT", "SIGHUP"):
        if hasattr(signal, name):  # a handler, as the program would inherit SIG_IGN
            signal.signal(getattr(signal, name), lambda *_: None)
    process = subprocess.Popen(command, stdin=subprocess.DEVNULL)  # noqa: S603  # the parent names it
    threading.Thread(target=_end_when_closed, args=(process,), daemon=True).start()
    code = process.wait()
    if hasattr(os, "killpg"):  # ends processes that the program started and left running
        os.killpg(0, _TERMINATE)
    return code if code >= 0 else 128 - code


def _end_when_closed(process: "subprocess.Popen[bytes]") -> None:
    """Wait until standard input closes, then end a program and this process."""
    while os.read(0, 4096):
        pass
    try:
        os.killpg(0, _TERMINATE) if hasattr(os, "killpg") else process.terminate()
        process.wait(GRACE)
    except subprocess.TimeoutExpired:
        process.kill()
    finally:
        os.killpg(0, _KILL) if hasattr(os, "killpg") else os._exit(1)


if __name__ == "__main__":
    sys.exit(_supervise(sys.argv[1:]))
