"""Ctrl-C while training: the update in progress is finished and saved first, so that nothing is lost."""

import signal
from types import FrameType, TracebackType
from typing import Any, Self

from supersampler.cli.terminal import Terminal


class StopRequest:
    """Context manager that records the first SIGINT; the second one raises KeyboardInterrupt.

    Args:
        console: prints the message of the first one.

    Attributes:
        requested: whether a SIGINT came.
    """

    def __init__(self, console: Terminal) -> None:
        self._console, self.requested = console, False
        self._before: Any = None

    def __enter__(self) -> Self:
        self._before = signal.signal(signal.SIGINT, self._note)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        signal.signal(signal.SIGINT, self._before)

    def _note(self, number: int, frame: FrameType | None) -> None:  # noqa: ARG002  # as a handler is called
        self.requested = True
        signal.signal(signal.SIGINT, signal.default_int_handler)
        self._console.print("Stopping after this update; Ctrl-C again stops at once and loses the last ones.")
