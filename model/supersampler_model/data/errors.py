"""Errors of `supersampler_model.data`, and the check of a number."""

import math
from pathlib import Path

from supersampler.errors import ArgumentError, SupersamplerError


class DataError(SupersamplerError):
    """Base of the errors of `supersampler_model.data`."""


class SceneError(DataError, ArgumentError):
    """A part of a scene is invalid, or exceeds a limit; `name` is its field.

    >>> str(SceneError("mesh.indices", got="(0, 3)", want="at least one triangle"))
    'mesh.indices is (0, 3); want at least one triangle.'
    """


class GraphicsError(DataError, RuntimeError):
    """OpenGL is missing, too old or fails; the message, one line, names the packages to install."""


class DatasetError(DataError, OSError):
    """A training set on disk is damaged, or has another description; names file, problem and remedy."""

    def __init__(self, path: Path, problem: str, hint: str = "") -> None:
        self.path, self.problem, self.hint = path, problem, hint
        super().__init__(f"{path}: {problem}. {hint}".rstrip())


def check_number(name: str, value: float, low: float, high: float, *, open_below: bool = False) -> None:
    """Raise a SceneError unless `value` is finite and in [low, high], or in (low, high] if `open_below`."""
    inside = low < value <= high if open_below else low <= value <= high  # NaN fails both
    if not inside or abs(value) == math.inf:
        upper = "" if high == math.inf else f" and <= {high:g}"
        want = f"a finite number {'>' if open_below else '>='} {low:g}{upper}"
        raise SceneError(name, got=value, want=want)
