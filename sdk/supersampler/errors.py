"""Every error this package raises on purpose. Each says what came, what was wanted and what to do.

SupersamplerError
  FrameError         one input of one frame breaks the contract
  ArgumentError      an argument of a call that is not a frame's input (sizes, conventions, options)
  ShotError          a file of a shot cannot be read or written; names the file and the channel
  RecordingError     a recording of an Upscaler cannot be read, written or replayed; names the file
  ModelError         a model folder that this runtime cannot drive
  ProviderError      an ONNX Runtime execution provider was asked for and cannot be had
  KernelError        the CPU backend's kernels cannot be compiled here

Warnings: FrameWarning, from the checks that read pixels (`validate="warn"`); BackendWarning, where a slower
backend runs than could.
"""

import difflib
from collections.abc import Collection
from pathlib import Path

_LONGEST = 120
"""Characters of a value that a message shows."""


class SupersamplerError(Exception):
    """Base of all errors below."""


class FrameError(SupersamplerError, ValueError):
    """One input of one frame breaks the contract; `name` says which.

    >>> str(FrameError("depth", got="(80, 45) float32", want="(45, 80) float32"))
    'frame.depth is (80, 45) float32; want (45, 80) float32.'
    """

    def __init__(self, name: str, *, got: object, want: object, hint: str = "") -> None:
        self.name, self.got, self.want, self.hint = name, got, want, hint
        super().__init__(f"frame.{name} is {got}; want {want}. {hint}".rstrip())


class ArgumentError(SupersamplerError, ValueError):
    """An argument is out of its range or contradicts another; `name` says which."""

    def __init__(self, name: str, *, got: object, want: object, hint: str = "") -> None:
        self.name, self.got, self.want, self.hint = name, got, want, hint
        super().__init__(f"{name} is {got}; want {want}. {hint}".rstrip())


class _FileError(SupersamplerError, OSError):
    def __init__(self, path: Path | str, problem: str, hint: str = "") -> None:
        self.path, self.problem, self.hint = Path(path), problem, hint
        super().__init__(f"{path}: {problem}. {hint}".rstrip())


class ShotError(_FileError):
    """A file of a shot cannot be used; names the file, what is wrong with it and what to do."""


class RecordingError(_FileError):
    """A recording cannot be used; names the file, what is wrong with it and what to do."""


class ModelError(SupersamplerError, ValueError):
    """A model folder is missing, damaged, or of a contract that this runtime does not drive."""


class ProviderError(SupersamplerError, RuntimeError):
    """An execution provider was asked for and cannot be had; the message lists those that can."""


class KernelError(SupersamplerError, RuntimeError):
    """Kernels of the CPU backend cannot be compiled or loaded; the message says why."""


class BackendWarning(UserWarning):
    """A model runs on a slower backend than it could; says why and what to install."""


def did_you_mean(word: object, choices: Collection[str]) -> str:
    """Return "Did you mean 'x'?" for a misspelt word; "" where no choice is like it."""
    if not isinstance(word, str) or len(word) > _LONGEST:
        return ""
    by_lower = {choice.lower(): choice for choice in choices}
    close = difflib.get_close_matches(word.lower(), by_lower, 1)
    return f"Did you mean {by_lower[close[0]]!r}?" if close else ""


def shown(value: object) -> str:
    """Return any value as a few words for a message, whatever its own `repr` does."""
    try:
        if getattr(value, "ndim", 0):
            return f"{type(value).__name__} {tuple(value.shape)} {value.dtype}"  # type: ignore[attr-defined]
        text = " ".join(repr(value).split())
    except Exception:  # of somebody's class; of Python, where an int has more than 4300 digits
        return f"of type {type(value).__name__}"
    return text if len(text) <= _LONGEST else f"{text[:_LONGEST]}..."


class FrameWarning(UserWarning):
    """A check that read pixels found a likely mistake in a frame and guesses which."""
