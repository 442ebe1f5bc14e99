"""Text for the terminal. Names in other people's files send it no control codes, and are no markup."""

from typing import Any

import typer
from rich.console import Console

from supersampler.errors import printable


def echo(line: str, *, err: bool = False) -> None:
    """Print a line to stdout, or to stderr."""
    typer.echo(printable(line), err=err)


class Terminal(Console):
    """A Console that takes text as it is: no markup, no emoji codes, and no control codes but line ends.

    Args:
        stderr: whether it prints there, else to stdout.
    """

    def __init__(self, *, stderr: bool = False) -> None:
        super().__init__(stderr=stderr, highlight=False, markup=False, emoji=False)

    def print(self, *objects: Any, **options: Any) -> None:
        """Print text or renderables."""
        super().print(*(_safe(item) if isinstance(item, str) else item for item in objects), **options)


def _safe(text: str) -> str:
    return "\n".join(map(printable, text.split("\n")))
