"""Checks of arguments, the same for the whole package.

`as_...` return None for a value of another kind, so that callers raise errors of their own.
`checked_...` return the converted value, or raise ArgumentError.
"""

import operator
import os
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray

from supersampler.errors import ArgumentError, did_you_mean, shown

MAX_SIDE = 32768
"""Largest width or height of an image: float32 coordinates are then exact to 1/512 of a pixel."""
MAX_PIXELS = 2**26
"""Largest number of pixels of an image: kernels and graphs index up to 32 values per pixel with 32 bits."""
IMAGE_SIZES = f"each at least 1 and at most {MAX_SIDE}, at most {MAX_PIXELS} pixels together"
"""The sizes that `is_image_size` accepts, for error messages."""
MAX_THREADS = 256

ieee_arithmetic = np.errstate(all="ignore")
"""Decorator of public functions that compute. NaN, infinities and denormals are valid values: numpy neither
warns nor raises, regardless of the program's `numpy.seterr`."""

# Values of options, which the command line reads from here without the modules that need them.
AtRest = Literal["converge", "accumulate", "off"]
ExecutorName = Literal["auto", "onnx", "cpu", "gpu"]
Precision = Literal["auto", "fp32", "fp16", "int8"]
PresetName = Literal["fast", "balanced", "high"]
Validate = Literal["off", "warn", "strict"]
_Choice = TypeVar("_Choice")


def as_number(value: object) -> float | None:
    """Return a real number as a float, NaN and Inf included; None for bool, text, arrays, complex numbers."""
    if type(value) is float:
        return value
    if type(value) is not int and isinstance(value, (bool, str, bytes, bytearray, np.ma.MaskedArray)):
        return None  # the check of `float` comes first because numpy imports `ma` on first use
    kind = getattr(getattr(value, "dtype", None), "kind", "f")  # only numpy's dtypes have a kind
    if kind not in "iuf" or getattr(value, "ndim", 0) != 0:
        return None
    try:
        return float(value)  # type: ignore[arg-type]  # raises TypeError itself
    except (TypeError, ValueError, OverflowError, RuntimeError):  # torch tensors raise RuntimeError
        return None


def as_index(value: object) -> int | None:
    """Return a whole number as an int; None for float, bool, text, arrays."""
    if isinstance(value, (bool, np.bool_)):
        return None
    try:
        return operator.index(value)  # type: ignore[arg-type]  # raises TypeError itself
    except (TypeError, ValueError, OverflowError, RuntimeError):
        return None


def as_flag(value: object) -> bool | None:
    """Return True, False, 1 or 0 as a bool, numpy's included; None for anything else."""
    if isinstance(value, np.ndarray) and value.ndim == 0:  # as .npz files hold them
        value = value.item()
    if isinstance(value, (bool, np.bool_)):
        return bool(value)
    index = as_index(value)
    return bool(index) if index in (0, 1) else None


def is_row(values: object) -> bool:
    """Return whether this is a sequence (but not text) or a one-dimensional array."""
    if isinstance(values, np.ndarray):
        return values.ndim == 1
    return isinstance(values, Sequence) and not isinstance(values, (str, bytes, bytearray))


def is_image_size(width: int, height: int) -> bool:
    """Return whether an image of this size is neither empty nor too large."""
    return 1 <= width <= MAX_SIDE and 1 <= height <= MAX_SIDE and width * height <= MAX_PIXELS


def checked_choice(name: str, value: _Choice, choices: Collection[_Choice], hint: str = "") -> _Choice:
    """Return the one of `choices` that equals the value; `hint` is added to the error message."""
    if isinstance(value, str) and value in choices:
        return next(choice for choice in choices if choice == value)  # a plain str for numpy's
    *others, last = map(repr, choices)
    want = f"{', '.join(others)} or {last}" if others else last
    hint = f"{did_you_mean(value, [c for c in choices if isinstance(c, str)])} {hint}".strip()
    raise ArgumentError(name, got=shown(value), want=want, hint=hint)


def checked_flag(name: str, value: object) -> bool:
    """Return a bool."""
    flag = as_flag(value)
    if flag is None:
        raise ArgumentError(name, got=shown(value), want="True or False")
    return flag


def checked_threads(threads: int) -> int:
    """Return a number of CPU threads; 0 is every core."""
    count = as_index(threads)
    if count is None or not 0 <= count <= MAX_THREADS:
        want = f"a whole number from 1 to {MAX_THREADS}, or 0 for every core"
        raise ArgumentError("threads", got=shown(threads), want=want)
    return count


def checked_scale(scale: float) -> float:
    """Return display size over render size."""
    number = as_number(scale)
    if number is None or not 1.0 <= number <= MAX_SIDE:
        want = f"a number >= 1, at most {MAX_SIDE}: display size over render size"
        raise ArgumentError("scale", got=shown(scale), want=want)
    return number


def checked_size(name: str, size: Sequence[int] | None) -> tuple[int, int]:
    """Return (width, height) of an image."""
    extents = [] if size is None or not is_row(size) else [as_index(extent) for extent in size]
    if len(extents) != 2 or extents[0] is None or extents[1] is None:
        raise ArgumentError(name, got=shown(size), want="(width, height), two whole numbers of pixels")
    width, height = extents[0], extents[1]
    if not is_image_size(width, height):
        raise ArgumentError(name, got=shown((width, height)), want=f"(width, height), {IMAGE_SIZES}")
    return width, height


def checked_lookahead(passes: int, lookahead: int | None, most: int) -> int | None:
    """Return the number of following frames to read: 0 with one pass, otherwise `lookahead`.

    Raises:
        ArgumentError: `passes` is not 1 or 2; or `lookahead` is not 1 to `most`, or given with one pass.
    """
    if type(passes) is not int or passes not in (1, 2):
        raise ArgumentError("passes", got=shown(passes), want="1 or 2")
    if lookahead is None:
        return 0 if passes == 1 else None
    if passes == 1:
        want = "None, because one pass reads no later frame"
        raise ArgumentError("lookahead", got=shown(lookahead), want=want)
    if type(lookahead) is not int or not 1 <= lookahead <= most:
        want = f"a whole number of frames from 1 to {most}, or None"
        raise ArgumentError("lookahead", got=shown(lookahead), want=want)
    return lookahead


def checked_names(name: str, names: Collection[str]) -> tuple[str, ...]:
    """Return a collection of names as a tuple; a single name, None and generators are refused."""
    several = isinstance(names, Collection) and not isinstance(names, (str, bytes, np.ndarray))
    if not several or not all(isinstance(each, str) for each in names):
        raise ArgumentError(name, got=shown(names), want="names in a tuple, a list or a set")
    return tuple(map(str, names))  # plain ones for numpy's


def checked_path(name: str, path: str | Path) -> str | Path:
    """Return the value if it is a valid path or name of a file."""
    if not isinstance(path, (str, os.PathLike)) or not isinstance(os.fspath(path), str):
        raise ArgumentError(name, got=shown(path), want="text or a pathlib.Path")
    try:
        possible = bool(os.fspath(path)) and b"\0" not in os.fsencode(path)
    except UnicodeEncodeError:
        possible = False
    if not possible:
        raise ArgumentError(name, got=shown(path), want="a path that a file can have")
    return path


def overlaps_itself(array: NDArray[Any]) -> bool:
    """Return whether elements may share memory; slices and transposes of ordinary arrays never do."""
    extent = array.itemsize  # bytes from the first to the end of the last element along the axes so far
    for stride, count in sorted(zip(map(abs, array.strides), array.shape, strict=True)):
        if count > 1 and stride < extent:
            return True
        extent += stride * (count - 1)
    return False


def check_out(out: NDArray[np.float32], shape: tuple[int, ...], inputs: Collection[NDArray[Any]]) -> None:
    """Raise ArgumentError unless `out` can hold an image of this shape, in memory apart from `inputs`."""
    want = f"{shape} float32 numpy array"
    if not isinstance(out, np.ndarray) or isinstance(out, np.ma.MaskedArray):
        raise ArgumentError("out", got=shown(out), want=want)
    if out.shape != shape or out.dtype != np.float32:
        raise ArgumentError("out", got=f"{out.shape} {out.dtype}", want=want)
    if not (out.flags.writeable and out.flags.aligned):
        got = "not aligned" if out.flags.writeable else "read-only"
        raise ArgumentError("out", got=got, want="a writable, aligned array")
    if overlaps_itself(out):
        raise ArgumentError("out", got="overlapping itself", want="an array of separate elements")
    if any(np.may_share_memory(out, array) and np.shares_memory(out, array) for array in inputs):
        raise ArgumentError("out", got="memory of the frame", want="memory that the step does not read")
