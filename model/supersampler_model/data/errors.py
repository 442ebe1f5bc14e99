"""Errors of `supersampler_model.data`, and checks of a scene's fields.

DataError              base of all below, itself a SupersamplerError
  SceneError           a scene is invalid or exceeds a limit; names the field
  GraphicsError        no usable OpenGL; the message names what to install
  DatasetError         a training set on disk is damaged, or of another description; names the file
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

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


Extent = int | tuple[int, ...] | None
"""Length of an axis: exact, one of several, or any length >= 1 (None)."""


def check_vector(name: str, values: Sequence[float], count: int) -> tuple[float, ...]:
    """Return `values` as `count` finite floats."""
    try:
        floats = tuple(float(value) for value in values)
    except (TypeError, ValueError):
        raise SceneError(name, got=repr(values), want=f"{count} numbers") from None
    if len(floats) != count or not np.isfinite(floats).all():
        raise SceneError(name, got=repr(values), want=f"{count} finite numbers")
    return floats


def check_number(name: str, value: float, low: float, high: float, *, open_below: bool = False) -> None:
    """Raise unless `value` is finite and in [low, high], or in (low, high] if `open_below`."""
    inside = low < value <= high if open_below else low <= value <= high  # NaN fails both
    if not inside or not np.isfinite(value):
        upper = f" and <= {high:g}" if np.isfinite(high) else ""
        want = f"a finite number {'>' if open_below else '>='} {low:g}{upper}"
        raise SceneError(name, got=value, want=want)


def check_color(name: str, color: Sequence[float], maximum: float = np.inf) -> None:
    """Raise unless `color` is three finite numbers in [0, maximum]."""
    for value in check_vector(name, color, 3):
        check_number(name, value, 0.0, maximum)


def check_array(name: str, array: Any, shape: tuple[Extent, ...], dtype: type) -> None:
    """Raise unless `array` is a finite numpy array of this shape and type."""
    if not isinstance(array, np.ndarray):
        raise SceneError(name, got=type(array).__name__, want="a numpy array")
    fits = len(array.shape) == len(shape) and all(map(_fits, array.shape, shape))
    if not fits or array.dtype != dtype:
        text = "(" + ", ".join("n" if extent is None else str(extent) for extent in shape) + ")"
        raise SceneError(name, got=f"{array.shape} {array.dtype}", want=f"{text} {np.dtype(dtype).name}")
    if array.dtype.kind == "f" and not np.isfinite(array).all():
        raise SceneError(name, got="NaN or infinite in places", want="finite numbers")


def check_matrices(name: str, matrices: Any, shape: tuple[int, ...]) -> None:
    """Raise unless `matrices` are finite (..., 4, 4) that act on points: the last row is (0, 0, 0, 1)."""
    check_array(name, matrices, shape, np.float64)
    if not np.allclose(matrices[..., 3, :], (0.0, 0.0, 0.0, 1.0)):
        hint = "Matrices act on column vectors; transpose it."
        raise SceneError(
            f"{name}[..., 3, :]", got=matrices[..., 3, :].tolist(), want="(0, 0, 0, 1)", hint=hint
        )


def _fits(length: int, extent: Extent) -> bool:
    if extent is None:
        return length > 0
    return length in extent if isinstance(extent, tuple) else length == extent
