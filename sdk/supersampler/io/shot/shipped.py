"""Find the shots that ship with this package by name."""

import os
from pathlib import Path

from supersampler.arguments import checked_path
from supersampler.errors import INCOMPLETE_PACKAGE, ShotError, did_you_mean

SHIPPED = Path(__file__).parents[2] / "shots"
"""Folder of the shots that ship."""


def path_or_shipped(path: str | Path) -> Path:
    """Return a path, or the folder of a shipped shot for a bare name that is no path here.

    Raises:
        ArgumentError: it is neither text nor a path.
        ShotError: it is a bare name that neither exists nor ships; or the package's own shots are missing.
    """
    path = Path(checked_path("path", path))
    if path.name != str(path) or os.path.lexists(path):
        return path
    if not SHIPPED.is_dir():
        problem = f"there is no such file or folder, and the package's data files, {SHIPPED}, are missing"
        raise ShotError(path, problem, INCOMPLETE_PACKAGE)
    names = sorted(folder.name for folder in SHIPPED.iterdir())
    if path.name in names:
        return SHIPPED / path.name
    hint = did_you_mean(path.name, names) or f"Shots that ship: {', '.join(names)}."
    raise ShotError(path, "there is no such file or folder, and no shot of that name ships", hint)
