"""Progress of a run: a bar on a terminal, a line now and then in a log, a line of JSON for each frame."""

import json
import time
from types import TracebackType
from typing import Any

from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn
from rich.progress import Progress as Bar

from supersampler.cli.terminal import Terminal

LOG_SECONDS = 15.0
"""Time between two lines of progress in a log."""


class RunProgress:
    """Shows how far a run is.

    Args:
        console: for people.
        total: number of frames to step through.
        json: whether to print lines of JSON for machines on the standard output.
    """

    def __init__(self, console: Terminal, total: int, *, json: bool) -> None:
        self._console, self._total, self._json = console, total, json
        self._began = self._logged = time.monotonic()
        self._done = 0
        self._bar = Bar(
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TextColumn("{task.fields[rate]}"),
            TimeRemainingColumn(),
            TextColumn("left"),
            console=console,
            transient=True,
            disable=not console.is_terminal,
        )
        self._task = self._bar.add_task("", total=total, rate="")

    def __enter__(self) -> "RunProgress":
        self._bar.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._bar.stop()

    def advance(self, what: str) -> None:
        """Count a frame; `what` happens to it: "upscaling", "replaying"."""
        self._done += 1
        now = time.monotonic()
        rate = self._done / max(now - self._began, 1e-9)
        text = f"{rate:.1f} frames/s"
        self._bar.update(self._task, advance=1, description=what, rate=text)
        if not self._console.is_terminal and not self._json and now - self._logged >= LOG_SECONDS:
            self._logged = now
            left = (self._total - self._done) / rate
            self._console.print(f"{what} {self._done} of {self._total}: {text}, {_clock(left)} left")

    def event(self, event: str, **values: Any) -> None:
        """Print a line of JSON, where these are wanted."""
        if self._json:
            print(json.dumps({"event": event, **values}), flush=True)


def _clock(seconds: float) -> str:
    minutes, seconds = divmod(round(seconds), 60)
    return (
        f"{minutes // 60}:{minutes % 60:02d}:{seconds:02d}" if minutes >= 60 else f"{minutes}:{seconds:02d}"
    )
