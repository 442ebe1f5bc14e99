"""Find the shots that ship with this package by name."""

import os
from pathlib import Path

from supersampler.arguments import checked_path
from supersampler.errors import ShotError, did_you_mean

SHIPPED = Path(__file__).parents[2] / "shots"
"""Folder of the shots that ship."""


def path_or_shipped(path: str | Path) -> Path:
    """Return a path, or the folder of a shipped shot for a bare name that is no path here.

    Raises:
        ArgumentError: it is neither text nor a path.
        ShotError: it is a bare name that neither exists nor ships.
    """
    path = Path(checked_path("path", path))
    if path.name != str(path) or os.path.lexists(path):
        return path
    names = sorted(folder.name for folder in SHIPPED.iterdir())
    if path.name in names:
        return SHIPPED / path.name
    hint = did_you_mean(path.name, names) or f"Shots that ship: {', '.join(names)}."
    raise ShotError(path, "there is no such file or folder, and no shot of that name ships", hint)
