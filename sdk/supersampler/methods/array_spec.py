"""Checks of arrays that come from files and users: states, recordings, network files."""

import math
import reprlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from supersampler.arguments import MAX_PIXELS, MAX_SIDE

LARGEST = float(np.finfo(np.float32).max)


@dataclass(frozen=True)
class ArraySpec:
    """Type, shape and range of an array.

    Attributes:
        dtype: numpy's name of its type, in the byte order of this machine.
        shape: numbers, and names of free extents. These are 1 to MAX_SIDE, and the same for the same name.
        values: minimum and maximum, which exclude NaN; None allows any values.
    """

    dtype: str
    shape: tuple[int | str, ...]
    values: tuple[float, float] | None = None

    def __str__(self) -> str:
        extents = ", ".join(map(str, self.shape)) + "," * (len(self.shape) == 1)
        return f"({extents}) {self.dtype}"


Refusal = Callable[[str, str], Exception]
"""Makes an exception of the value found ("with 'a' (2,) float64") and the value wanted ("(1,) float32")."""


def checked_arrays(
    arrays: object, specs: Mapping[str, ArraySpec], refusal: Refusal
) -> dict[str, NDArray[Any]]:
    """Check that `arrays` has the arrays of `specs` and no others, and return them in the order of `specs`.

    The result is plain numpy arrays on the same memory. `refusal` makes the exception.
    """
    if not isinstance(arrays, Mapping):
        raise refusal(type(arrays).__name__, "arrays by name")
    unknown = next((name for name in arrays if name not in specs), None)
    if unknown is not None:
        raise refusal(f"with {reprlib.repr(unknown)}", f"only {', '.join(specs) or 'no arrays'}")
    sizes: dict[str, int] = {}
    checked = {}
    for name, spec in specs.items():
        if name not in arrays:
            raise refusal(f"without {name!r}", f"{spec}")
        checked[name] = _checked(name, arrays[name], spec, sizes, refusal)
    return checked


def _checked(
    name: str, array: object, spec: ArraySpec, sizes: dict[str, int], refusal: Refusal
) -> NDArray[Any]:
    if not isinstance(array, np.ndarray) or isinstance(array, np.ma.MaskedArray):
        raise refusal(f"with {name!r} {type(array).__name__}", f"a numpy array {spec}")
    got = f"with {name!r} {array.shape} {array.dtype}"
    if array.dtype != np.dtype(spec.dtype) or array.ndim != len(spec.shape):
        raise refusal(got, f"{spec}")
    for extent, want in zip(array.shape, spec.shape, strict=True):
        if isinstance(want, str) and not 1 <= extent <= MAX_SIDE:
            raise refusal(got, f"{spec}, each named extent from 1 to {MAX_SIDE}")
        if extent != (sizes.setdefault(want, extent) if isinstance(want, str) else want):
            known = ", ".join(f"{free} {sizes[free]}" for free in spec.shape if free in sizes)
            raise refusal(got, f"{spec}" + (f" with {known}" if known else ""))
    free = [extent for extent, want in zip(array.shape, spec.shape, strict=True) if isinstance(want, str)]
    if math.prod(free) > MAX_PIXELS:
        raise refusal(got, f"{spec} with at most {MAX_PIXELS} pixels")
    plain = array.view(np.ndarray)
    if spec.values is not None and plain.size:
        low, high = spec.values
        with np.errstate(invalid="ignore"):
            found = plain.min(), plain.max()
        if not (low <= found[0] and found[1] <= high):  # written so that NaN fails
            raise refusal(f"with {name!r} from {found[0]} to {found[1]}", f"values from {low:g} to {high:g}")
    if plain.dtype == bool and (plain.view(np.uint8) > 1).any():
        raise refusal(f"with {name!r} of bytes beyond 1", f"{spec} of bytes 0 and 1")
    return plain


def values_of(name: str) -> tuple[float, float]:
    """Return the allowed range of a history tensor: [-0.5, 0.5] for jitter, else all finite numbers."""
    return (-0.5, 0.5) if "jitter" in name else (-LARGEST, LARGEST)
