"""All errors and warnings of this package. Messages state the value found, the value wanted, and a remedy.

SupersamplerError
  FrameError         an input of a frame breaks the contract
  ArgumentError      an argument that is not a frame's input is invalid (sizes, conventions, options)
  ShotError          a file of a shot cannot be read or written; names the file and the channel
    MissingFramesError   frames are missing between others
  RecordingError     a recording of an Upscaler cannot be read, written or replayed; names the file
  ModelError         this runtime cannot run a model folder
  ProviderError      an ONNX Runtime execution provider was requested and is not available
  LibraryError       the CPU library is missing or cannot be loaded
  DeviceError        the GPU backend found no device, or the device failed

Warnings: FrameWarning, from checks of pixels (`validate="warn"`); BackendWarning, if a slower backend runs
because a faster one cannot.
"""

import difflib
import inspect
import os
import warnings
from collections.abc import Collection, Mapping
from pathlib import Path
from typing import Any

import numpy as np

INCOMPLETE_PACKAGE = (
    "Build a frozen app with pyinstaller --collect-all supersampler; otherwise install the package again."
)
"""Remedy if a data file of this package is missing."""
_MAX_SHOWN = 120  # characters of a value in a message
_INSIDE = tuple(f"{Path(file).parent}{os.sep}" for file in (__file__, np.__file__))
"""Folders of this package, and of numpy, which wraps its public functions (`ieee_arithmetic`)."""


class SupersamplerError(Exception):
    """Base of all errors below. All of them can be pickled and copied, as process pools do."""

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle message and attributes; `Exception` would call `__init__` with the message alone."""
        return _restored, (type(self), self.args, self.__dict__)


class _ValueError(SupersamplerError, ValueError):
    _prefix = ""
    view: int | None = None

    def __init__(self, name: str, *, got: object, want: object, hint: str = "") -> None:
        self.name, self.got, self.want, self.hint = name, got, want, hint
        super().__init__(f"{self._prefix}{name} is {got}; want {want}. {hint}".rstrip())

    def name_view(self, view: int) -> None:
        """Put the number of a view of `Upscaler.step_many` in front of the message."""
        self.view, self.args = view, (f"view {view}: {self}",)


class FrameError(_ValueError):
    """An input of a frame breaks the contract; `name` says which, and `view` in a call of `step_many`.

    >>> str(FrameError("depth", got="(80, 45) float32", want="(45, 80) float32"))
    'frame.depth is (80, 45) float32; want (45, 80) float32.'
    """

    _prefix = "frame."


class ArgumentError(_ValueError):
    """An argument is out of range or contradicts another one; `name` says which, and `view` as above."""


class _FileError(SupersamplerError, OSError):
    def __init__(self, path: Path | str, problem: str, hint: str = "") -> None:
        self.path, self.problem, self.hint = Path(path), problem, hint
        stop = "" if problem.endswith((".", "?")) else "."  # of another message
        super().__init__(f"{path}: {problem}{stop} {hint}".rstrip())


class ShotError(_FileError):
    """A file of a shot cannot be read or written; the message names the file and a remedy."""


class MissingFramesError(ShotError):
    """Frames are missing between others.

    Attributes:
        gaps: numbers of the first and last missing frame of each gap of the sequence, with the rest of a
            sentence: "between a.0012.exr and a.0020.exr is missing".
        present: numbers of the first and the last present frame.
    """

    def __init__(
        self,
        path: Path,
        problem: str,
        hint: str,
        *,
        gaps: Mapping[tuple[int, int], str],
        present: tuple[int, int],
    ) -> None:
        super().__init__(path, problem, hint)
        self.gaps, self.present = gaps, present


class RecordingError(_FileError):
    """A recording cannot be read, written or replayed; the message names the file and a remedy."""


class ModelError(SupersamplerError, ValueError):
    """A model folder is missing, damaged, or has a contract version that this runtime does not support."""


class ProviderError(SupersamplerError, RuntimeError):
    """An execution provider was requested and is not available; the message lists the available ones."""


class LibraryError(SupersamplerError, RuntimeError):
    """The CPU library is missing or cannot be loaded; the message says why, and what builds it."""


class DeviceError(SupersamplerError, RuntimeError):
    """The GPU backend found no device, or the device failed; the message names the adapter and a remedy."""


class FrameWarning(UserWarning):
    """A check of pixels found a likely mistake in a frame; `kind` says which, such as "color clipped"."""

    kind: str = ""


class BackendWarning(UserWarning):
    """A model runs on a slower backend; the message says why and what to install."""


def warn(warning: Warning) -> None:
    """Emit a warning at the line of the program that called this package."""
    level, frame = 1, inspect.currentframe()
    while frame is not None and frame.f_code.co_filename.startswith(_INSIDE):
        level, frame = level + 1, frame.f_back
    warnings.warn(warning, stacklevel=level)


def _restored(
    kind: type[SupersamplerError], args: tuple[Any, ...], attributes: dict[str, Any]
) -> SupersamplerError:
    error = kind.__new__(kind, *args)
    error.args = args
    error.__dict__.update(attributes)
    return error


def did_you_mean(word: object, choices: Collection[str]) -> str:
    """Return "Did you mean 'x'?" for a misspelt word; "" if no choice is similar."""
    if not isinstance(word, str) or len(word) > _MAX_SHOWN:
        return ""
    by_lower = {choice.lower(): choice for choice in choices}
    close = difflib.get_close_matches(word.lower(), by_lower, 1)
    return f"Did you mean {by_lower[close[0]]!r}?" if close else ""


def shown(value: object) -> str:
    """Return a short text for any value, for messages, even if its `repr` fails.

    Arrays are shown by shape, containers of arrays by type.
    """
    try:
        if getattr(value, "ndim", 0):
            return f"{type(value).__name__} {tuple(value.shape)} {value.dtype}"  # type: ignore[attr-defined]
        text = " ".join(repr(value).split())
        if "array(" in text or "tensor(" in text:  # many numbers
            return f"of type {type(value).__name__}"
    except Exception:  # by a user's class, or by an int of more than 4300 digits
        return f"of type {type(value).__name__}"
    return text if len(text) <= _MAX_SHOWN else f"{text[:_MAX_SHOWN]}..."


def printable(text: str) -> str:
    """Replace unprintable characters, so that names in files cannot send control codes to a terminal."""
    return "".join(character if character.isprintable() else "?" for character in text)
