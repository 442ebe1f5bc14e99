"""Errors of `supersampler_model.data`.

DataError              base of all below, itself a SupersamplerError
  SceneError           a scene is invalid or exceeds a limit; names the field
  GraphicsError        no usable OpenGL; the message names what to install
  DatasetError         a training set on disk is damaged, or of another description; names the file
"""

from pathlib import Path

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
