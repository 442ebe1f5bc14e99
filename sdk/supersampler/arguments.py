"""Checks of arguments: each returns what a value stands for, or raises with what was wanted.

`as_...` return None for a value that is none of their kind, for callers with errors of their own;
`checked_...` raise ArgumentError.
"""

import operator
import os
from collections.abc import Collection, Sequence
from pathlib import Path
from typing import Any, Literal, TypeVar, get_args

import numpy as np
from numpy.typing import NDArray

from supersampler.errors import ArgumentError, did_you_mean, shown

MAX_SIDE = 32768
"""Pixels of an image's width or height: what single precision places to a 512th of a pixel."""
MAX_PIXELS = 2**26
"""Pixels of an image, 8192 x 8192 say: kernels and graphs count elements, of up to 32 a pixel, in 32 bits."""

MAX_THREADS = 256
"""Threads that a model may be asked to run on."""

_Choice = TypeVar("_Choice")


def as_number(value: object) -> float | None:
    """Return a real number as a float, NaN and Inf too; None for a bool, text, an array, a complex number."""
    if type(value) is float:
        return value
    if isinstance(value, (bool, str, bytes, bytearray, np.ma.MaskedArray)):
        return None
    kind = getattr(getattr(value, "dtype", None), "kind", "f")  # of numpy's; others have none
    if kind not in "iuf" or getattr(value, "ndim", 0) != 0:
        return None
    try:
        return float(value)  # type: ignore[arg-type]  # it says so itself
    except (TypeError, ValueError, OverflowError, RuntimeError):  # the last of a torch tensor
        return None


def as_index(value: object) -> int | None:
    """Return a whole number as an int; None for a float, a bool, text, an array."""
    if isinstance(value, (bool, np.bool_)):
        return None
    try:
        return operator.index(value)  # type: ignore[arg-type]  # it says so itself
    except (TypeError, ValueError, OverflowError, RuntimeError):
        return None


def as_flag(value: object) -> bool | None:
    """Return True, False, 1 or 0, also of numpy, as a bool; None for anything else."""
    if isinstance(value, np.ndarray) and value.ndim == 0:  # of an .npz file
        value = value.item()
    if isinstance(value, (bool, np.bool_)):
        return bool(value)
    index = as_index(value)
    return bool(index) if index in (0, 1) else None


def checked_choice(name: str, value: _Choice, choices: Collection[_Choice], hint: str = "") -> _Choice:
    """Return one of a few words.

    Args:
        name: of the argument.
        value: what came.
        choices: the words; `typing.get_args` of the Literal that they are the type of.
        hint: what else there is to say where it is none of them.

    Raises:
        ArgumentError: it is none of them; lists them, and says which one it is like.
    """
    if isinstance(value, str) and value in choices:
        return value
    *others, last = map(repr, choices)
    want = f"{', '.join(others)} or {last}" if others else last
    hint = f"{did_you_mean(value, [c for c in choices if isinstance(c, str)])} {hint}".strip()
    raise ArgumentError(name, got=shown(value), want=want, hint=hint)


def checked_flag(name: str, value: object) -> bool:
    """Return a bool.

    Raises:
        ArgumentError: it is neither True nor False.
    """
    flag = as_flag(value)
    if flag is None:
        raise ArgumentError(name, got=shown(value), want="True or False")
    return flag


def checked_threads(threads: int) -> int:
    """Return how many threads to take on the CPU, 0 for every core.

    Raises:
        ArgumentError: it is not a whole number from 0 to MAX_THREADS.
    """
    count = as_index(threads)
    if count is None or not 0 <= count <= MAX_THREADS:
        want = f"a whole number from 1 to {MAX_THREADS}, or 0 for every core"
        raise ArgumentError("threads", got=shown(threads), want=want)
    return count


def checked_scale(scale: float) -> float:
    """Return display over render size.

    Raises:
        ArgumentError: it is not a number in [1, MAX_SIDE].
    """
    number = as_number(scale)
    if number is None or not 1.0 <= number <= MAX_SIDE:
        want = f"a number >= 1, at most {MAX_SIDE}: display size over render size"
        raise ArgumentError("scale", got=shown(scale), want=want)
    return number


def checked_size(name: str, size: Sequence[int] | None) -> tuple[int, int]:
    """Return (width, height).

    Raises:
        ArgumentError: it is not two whole numbers, or an image of that size is empty or too large.
    """
    extents = [] if size is None or not is_row(size) else [as_index(extent) for extent in size]
    if len(extents) != 2 or extents[0] is None or extents[1] is None:
        raise ArgumentError(name, got=shown(size), want="(width, height), two whole numbers of pixels")
    width, height = extents[0], extents[1]
    if not is_image_size(width, height):
        raise ArgumentError(name, got=shown((width, height)), want=f"(width, height), {IMAGE_SIZES}")
    return width, height


def is_row(values: object) -> bool:
    """Whether these are values in order, not text: a list, a tuple, an array of one axis."""
    if isinstance(values, np.ndarray):
        return values.ndim == 1
    return isinstance(values, Sequence) and not isinstance(values, (str, bytes, bytearray))


IMAGE_SIZES = f"each at least 1 and at most {MAX_SIDE}, at most {MAX_PIXELS} pixels together"
"""What `is_image_size` asks for, in words."""


def is_image_size(width: int, height: int) -> bool:
    """Whether an image of this size is neither empty nor too large."""
    return 1 <= width <= MAX_SIDE and 1 <= height <= MAX_SIDE and width * height <= MAX_PIXELS


def checked_names(name: str, names: Collection[str]) -> tuple[str, ...]:
    """Return a collection of names as a tuple; the caller checks that each exists.

    Raises:
        ArgumentError: they are not text, or not several: one name alone, None, a generator.
    """
    if type(names) is tuple and not names:
        return names
    several = isinstance(names, Collection) and not isinstance(names, (str, bytes, np.ndarray))
    if not several or not all(isinstance(each, str) for each in names):
        raise ArgumentError(name, got=shown(names), want="names in a tuple, a list or a set")
    return tuple(names)


def check_out(out: NDArray[np.float32], shape: tuple[int, ...], inputs: Collection[NDArray[Any]]) -> None:
    """Raise ArgumentError unless an image of this shape can be written to an array while others are read."""
    want = f"{shape} float32 numpy array"
    if not isinstance(out, np.ndarray) or isinstance(out, np.ma.MaskedArray):
        raise ArgumentError("out", got=shown(out), want=want)
    if out.shape != shape or out.dtype != np.float32:
        raise ArgumentError("out", got=f"{out.shape} {out.dtype}", want=want)
    if not (out.flags.writeable and out.flags.aligned):
        got = "not aligned" if out.flags.writeable else "read-only"
        raise ArgumentError("out", got=got, want="a writable, aligned array")
    if any(np.may_share_memory(out, array) and np.shares_memory(out, array) for array in inputs):
        raise ArgumentError("out", got="memory of the frame", want="memory that the step does not read")


def checked_path(name: str, path: str | Path) -> str | Path:
    """Return a path, or a name that is looked up like one.

    Raises:
        ArgumentError: it is neither text nor a path, or none that a file can have.
    """
    if not isinstance(path, (str, os.PathLike)) or not isinstance(os.fspath(path), str):
        raise ArgumentError(name, got=shown(path), want="text or a pathlib.Path")
    try:
        possible = bool(os.fspath(path)) and b"\0" not in os.fsencode(path)
    except UnicodeEncodeError:
        possible = False
    if not possible:
        raise ArgumentError(name, got=shown(path), want="a path that a file can have")
    return path


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
        raise ArgumentError("skip", got=shown(skip), want=want, hint=did_you_mean(skip, words))
    return number


def tolerance_of(skip: Skip, outputs: Collection[str]) -> float | None:
    """Return the tolerance of static-tile reuse; None where every pixel is to be computed."""
    if skip == "exact" or "aovs" in outputs:  # AOVs may change where no other input does
        return None
    return TOLERANCE if skip == "auto" else float(skip)
