"""Errors of `supersampler_model.data`, and the check of a number.

DataError              base of all below, itself a SupersamplerError
  SceneError           a scene is invalid or exceeds a limit; names the field
  GraphicsError        no usable OpenGL; the message names what to install
  DatasetError         a training set on disk is damaged, or of another description; names the file
"""

from pathlib import Path

import numpy as np

from supersampler.errors import ArgumentError, SupersamplerError


class DataError(SupersamplerError):
    """Base of all errors below."""


class SceneError(DataError, ArgumentError):
    """A part of a scene is invalid; `name` is its field.

    >>> str(SceneError("mesh.indices", got="(0, 3)", want="at least one triangle"))
    'mesh.indices is (0, 3); want at least one triangle.'
    """


class GraphicsError(DataError, RuntimeError):
    """OpenGL is missing, too old or fails; the message is one line and names what to install."""


class DatasetError(DataError, OSError):
    """A file of a training set is unusable; the message names file, problem and remedy."""

    def __init__(self, path: Path, problem: str, hint: str = "") -> None:
        self.path, self.problem, self.hint = path, problem, hint
        super().__init__(f"{path}: {problem}. {hint}".rstrip())


def check_number(name: str, value: float, low: float, high: float, *, open_below: bool = False) -> None:
    """Raise a SceneError unless `value` is finite and in [low, high], or in (low, high] if `open_below`."""
    inside = low < value <= high if open_below else low <= value <= high  # NaN fails both
    if not inside or not np.isfinite(value):
        upper = f" and <= {high:g}" if np.isfinite(high) else ""
        want = f"a finite number {'>' if open_below else '>='} {low:g}{upper}"
        raise SceneError(name, got=value, want=want)
