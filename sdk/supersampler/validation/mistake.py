"""One finding of the checks."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from supersampler.errors import FrameError


@dataclass(frozen=True, slots=True, kw_only=True)
class Mistake:
    """What is wrong with an input, in the parts of a `FrameError`.

    Attributes:
        kind: says which check it is; each kind warns once until the next reset.
        field: name of the `Frame`'s field.
        got, want, hint: as in `FrameError`.
        only_a_hint: True where right frames may look so too; then it never raises.
    """

    kind: str
    field: str
    got: str
    want: str
    hint: str = ""
    only_a_hint: bool = False

    def error(self) -> FrameError:
        """Return it as an error, whose text also serves as a warning."""
        return FrameError(self.field, got=self.got, want=self.want, hint=self.hint)


def where(bad: NDArray[np.bool_]) -> str:
    """Say how many pixels of a mask, some of which are True, there are, and which is the first."""
    row, column = np.argwhere(bad)[0]
    return f"in {int(bad.sum())} pixels, first at (x={column}, y={row})"
