"""Every error the data side raises on purpose.

DataError              base of all below, itself a SupersamplerError
  SceneError           what is to be drawn contradicts itself or exceeds a limit; names the field
  GraphicsError        there is no OpenGL that could draw it; says how to get one
  DatasetError         a training set on disk is damaged, or of another description; names the file
"""

from pathlib import Path

from supersampler.errors import ArgumentError, SupersamplerError


class DataError(SupersamplerError):
    """Base of all errors below."""


class SceneError(DataError, ArgumentError):
    """A part of a scene cannot be drawn; `name` says which.

    >>> str(SceneError("mesh.indices", got="(0, 3)", want="at least one triangle"))
    'mesh.indices is (0, 3); want at least one triangle.'
    """


class GraphicsError(DataError, RuntimeError):
    """OpenGL is missing, too old, or refuses; the message is one line and says what to install."""


class DatasetError(DataError, OSError):
    """A file of a training set cannot be used; names it, what is wrong and what to do."""

    def __init__(self, path: Path, problem: str, hint: str = "") -> None:
        self.path, self.problem, self.hint = path, problem, hint
        super().__init__(f"{path}: {problem}. {hint}".rstrip())
