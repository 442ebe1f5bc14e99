"""How far tiles of an image may be left as they are: `skip` of an Upscaler."""

from collections.abc import Collection
from typing import Literal, get_args

from supersampler.checked import as_number
from supersampler.errors import ArgumentError, shown

SkipName = Literal["auto", "exact"]
Skip = SkipName | float
TOLERANCE = 0.5 / 255.0
"""Of skip="auto": half a step of an 8-bit screen."""


def checked_skip(skip: Skip) -> Skip:
    """Return what `skip` is.

    Raises:
        ArgumentError: neither a word that is known nor a number in [0, 1].
    """
    words = get_args(SkipName)
    if isinstance(skip, str) and skip in words:
        return skip
    number = as_number(skip)
    if number is None or not 0.0 <= number <= 1.0:
        want = f"{', '.join(map(repr, words))} or a number in [0, 1]"
        raise ArgumentError("skip", got=shown(skip), want=want)
    return number


def tolerance_of(skip: Skip, want: Collection[str]) -> float | None:
    """Return the tolerance for tiles that stay as they are; None where all is to be drawn."""
    if skip == "exact" or "carry" in want:  # what is carried may change where nothing else does
        return None
    return TOLERANCE if skip == "auto" else float(skip)
