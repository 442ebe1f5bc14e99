"""Print `FrameWarning` as lines above a progress bar."""

import warnings
from collections.abc import Iterator
from contextlib import contextmanager

from supersampler.cli.terminal import Terminal
from supersampler.errors import FrameWarning


@contextmanager
def frame_warnings(console: Terminal, index: int) -> Iterator[None]:
    """Print each FrameWarning of the block as one line with the frame's index; show others as usual."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", FrameWarning)
        yield
    for warning in caught:
        if issubclass(warning.category, FrameWarning):
            console.print(f"warning: frame {index}: {warning.message}", style="yellow", soft_wrap=True)
        else:
            warnings.showwarning(warning.message, warning.category, warning.filename, warning.lineno)
