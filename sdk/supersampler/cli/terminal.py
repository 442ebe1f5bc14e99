"""Output on the terminal: text, warnings and progress.

Control codes and markup in the names of other people's files have no effect.
"""

import json
import time
import warnings
from collections.abc import Callable, Collection, Iterator
from contextlib import contextmanager
from typing import Any, Self

import typer
from rich.console import Console
from rich.segment import Segment

from supersampler.errors import FrameWarning, printable

LOG_SECONDS = 15.0
"""Time between two lines of progress in a log."""


def echo(line: str, *, err: bool = False) -> None:
    """Print a line to stdout, or to stderr."""
    typer.echo(printable(line), err=err)


class Terminal(Console):
    """Console that prints text verbatim: no markup, no emoji codes, no control codes except line ends."""

    def __init__(self, *, stderr: bool = False) -> None:
        super().__init__(stderr=stderr, highlight=False, markup=False, emoji=False)
        if not self.width:  # COLUMNS=0, as of a terminal whose size is unknown: every line would be empty
            self.width = 80

    def render(self, *arguments: Any, **options: Any) -> Iterator[Segment]:
        """Yield the segments of text or of a table, without unprintable characters."""
        for segment in super().render(*arguments, **options):
            lines = map(printable, segment.text.split("\n"))
            yield segment if segment.control else segment._replace(text="\n".join(lines))


@contextmanager
def counted(
    console: Terminal, text: str, total: int, done: int = 0, *, resumes: bool = False
) -> Iterator[Callable[[], None]]:
    """Show a progress bar on a terminal, or lines elsewhere; yield a function to call after each step.

    `done` steps are from an earlier run. If the same command `resumes` a stopped run, Ctrl-C prints that.
    """
    from rich import progress  # --help does not need it

    columns = [progress.TextColumn("{task.description}"), progress.BarColumn()]
    columns += [progress.MofNCompleteColumn(), progress.TimeRemainingColumn()]
    on_terminal = console.is_terminal
    with progress.Progress(*columns, console=console, transient=not resumes, disable=not on_terminal) as bar:
        task = bar.add_task(text, total=total, completed=done)
        logged = time.monotonic()

        def advance() -> None:
            nonlocal logged
            bar.advance(task)
            if not on_terminal and time.monotonic() - logged >= LOG_SECONDS:
                logged = time.monotonic()
                console.print(f"{text}: {bar.tasks[0].completed:.0f} of {total}", soft_wrap=True)

        try:
            yield advance
        except KeyboardInterrupt:
            if resumes:
                console.print("Stopped. Run the same command to resume.", soft_wrap=True)
            raise


@contextmanager
def frame_warnings(
    console: Terminal, index: int, ignored: Collection[str] = (), only: Collection[str] | None = None
) -> Iterator[None]:
    """Print each FrameWarning of the block as one line with the frame's index; show others as usual.

    Kinds in `ignored` are not printed; if `only` is given, no other kinds are.
    """
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", FrameWarning)
        yield
    for warning in caught:
        if isinstance(warning.message, FrameWarning):
            kind = warning.message.kind
            if kind in ignored or (only is not None and kind not in only):
                continue
            console.print(f"warning: frame {index}: {warning.message}", style="yellow", soft_wrap=True)
        else:
            warnings.showwarning(warning.message, warning.category, warning.filename, warning.lineno)


def rate_text(frames: int, seconds: float) -> str:
    """Return a frame rate: "7.5 frames/s", or "12.0 s/frame" where a frame takes longer than a second."""
    if 0 < frames < seconds:
        return f"{seconds / frames:.1f} s/frame"
    return f"{frames / max(seconds, 1e-9):.1f} frames/s"


class RunProgress:
    """Progress of a run: a bar on a terminal, a line every 15 s in a log, or a line of JSON per frame."""

    def __init__(self, console: Terminal, total: int, *, json: bool) -> None:
        from rich import progress  # --help does not need it

        self._console, self._total, self._json = console, total, json
        self._began = self._logged = time.monotonic()
        self._done = 0
        columns: list[Any] = [progress.TextColumn("{task.description}"), progress.BarColumn()]
        columns += [progress.MofNCompleteColumn(), progress.TextColumn("{task.fields[rate]}")]
        columns += [progress.TimeRemainingColumn(), progress.TextColumn("left")]
        self._bar = progress.Progress(
            *columns, console=console, transient=True, disable=not console.is_terminal
        )
        self._task = self._bar.add_task("", total=total, rate="")

    def __enter__(self) -> Self:
        self._bar.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._bar.stop()

    def advance(self, activity: str) -> None:
        """Count a step; `activity` is "upscaling", "replaying" or "stepping backward"."""
        self._done += 1
        now = time.monotonic()
        text = rate_text(self._done, now - self._began)
        self._bar.update(self._task, advance=1, description=activity, rate=text)
        if not self._console.is_terminal and not self._json and now - self._logged >= LOG_SECONDS:
            self._logged = now
            left = (self._total - self._done) * (now - self._began) / self._done
            minutes, seconds = divmod(round(left), 60)
            hours, minutes = divmod(minutes, 60)
            remaining = f"{hours}:{minutes:02d}:{seconds:02d}" if hours else f"{minutes}:{seconds:02d}"
            self._console.print(f"{activity} {self._done} of {self._total}: {text}, {remaining} left")

    def event(self, event: str, **values: Any) -> None:
        """Print a line of JSON, if JSON was requested."""
        if self._json:
            print(json.dumps({"event": event, **values}), flush=True)
