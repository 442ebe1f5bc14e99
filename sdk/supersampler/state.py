"""What an Upscaler remembers, as a copy."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from numpy.typing import NDArray

from supersampler.frame import Size


@dataclass(frozen=True)
class State:
    """A copy of an Upscaler's history; plain arrays and numbers, so it can be pickled or sent elsewhere."""

    method: str
    display_size: Size | None
    render_size: Size | None
    history: Mapping[str, NDArray[Any]] | None
