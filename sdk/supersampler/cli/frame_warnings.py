"""Warnings about frames, as lines above a progress bar."""

import warnings
from collections.abc import Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.markup import escape

from supersampler.errors import FrameWarning


@contextmanager
def frame_warnings(console: Console, index: int) -> Iterator[None]:
    """Print FrameWarnings in one line that names the frame; others are shown as always."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", FrameWarning)
        yield
    for warning in caught:
        if issubclass(warning.category, FrameWarning):
            text = escape(f"frame {index}: {warning.message}")
            console.print(f"[yellow]warning:[/yellow] {text}", soft_wrap=True)
        else:
            warnings.showwarning(warning.message, warning.category, warning.filename, warning.lineno)
