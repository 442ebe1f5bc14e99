"""Print `FrameWarning` as lines above a progress bar."""

import warnings
from collections.abc import Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.markup import escape

from supersampler.errors import FrameWarning


@contextmanager
def frame_warnings(console: Console, index: int) -> Iterator[None]:
    """Print each FrameWarning of the block as one line with the frame's index; show others as usual."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", FrameWarning)
        yield
    for warning in caught:
        if issubclass(warning.category, FrameWarning):
            text = escape(f"frame {index}: {warning.message}")
            console.print(f"[yellow]warning:[/yellow] {text}", soft_wrap=True)
        else:
            warnings.showwarning(warning.message, warning.category, warning.filename, warning.lineno)
