"""Ctrl-C and SIGTERM while training: the update in progress is finished and saved first; nothing is lost."""

import signal
from types import FrameType, TracebackType
from typing import Any, Self

from supersampler.cli.terminal import Terminal

_SIGNALS = (signal.SIGINT, signal.SIGTERM)


class StopRequest:
    """Context manager that records the first SIGINT or SIGTERM; the second one raises KeyboardInterrupt.

    Args:
        console: prints the message of the first one.

    Attributes:
        requested: whether one came.
    """

    def __init__(self, console: Terminal) -> None:
        self._console, self.requested = console, False
        self._before: dict[int, Any] = {}

    def __enter__(self) -> Self:
        self._before = {number: signal.signal(number, self._note) for number in _SIGNALS}
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        for number, before in self._before.items():
            signal.signal(number, before)

    def _note(self, number: int, frame: FrameType | None) -> None:  # noqa: ARG002  # as a handler is called
        self.requested = True
        for one in _SIGNALS:
            signal.signal(one, signal.default_int_handler)
        self._console.print("Stopping after this update; Ctrl-C again stops at once and loses the last ones.")
