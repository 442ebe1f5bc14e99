"""Find the numbered files of a frame sequence, and read its jitter."""

import os
import re
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path, PurePath, PurePosixPath
from typing import TypeAlias

from supersampler.errors import ArgumentError, ShotError
from supersampler.io.atomic import NOT_FOUND, check_inside
from supersampler.io.json_fields import read_json
from supersampler.io.limits import SHOT_FRAMES

JITTER_FILE_NAME = "jitter.json"
Jitter: TypeAlias = Sequence[tuple[float, float]] | Path | str
"""(x, y) of each frame, or a JSON file that holds [[x, y], ...]."""


def numbered_files(folder: Path, pattern: str) -> dict[int, Path]:
    """Return frame number to file, in order, for the files that match a glob pattern.

    Raises:
        ShotError: none matches, a name has no number, two have the same, or one lies outside of the folder.
    """
    if not os.path.isdir(folder):  # noqa: PTH112  # Path.is_dir raises for names that are too long
        raise ShotError(folder, "there is no such folder", NOT_FOUND)
    files: dict[int, Path] = {}
    parts = PurePosixPath(pattern).parts
    if not parts or PurePath(pattern).is_absolute() or ".." in parts:
        hint = "Copy the files into the folder; names that leave it are not followed."
        raise ShotError(folder, f"the pattern {pattern!r} matches no files in it", hint)
    try:
        paths = sorted(folder.glob(pattern))
    except (ValueError, NotImplementedError, OSError) as error:
        raise ShotError(folder, f"has no files {pattern!r} ({error})") from error
    for path in paths:
        if path.name.startswith("."):  # being written
            continue
        digits = re.findall(r"\d+", path.stem)
        if not digits:
            raise ShotError(path, "has no frame number in its name", "Name frames like beauty_0001.exr.")
        number = int(digits[-1])
        if number in files:
            hint = f"Choose one sequence by a pattern such as {path.stem.rstrip('0123456789')}*.exr."
            raise ShotError(path, f"has the same frame number as {files[number].name}", hint)
        files[number] = path
    if not files:
        raise ShotError(folder, f"has no file {pattern}", "Is this the folder of the frames?")
    if len(files) > SHOT_FRAMES:
        raise ShotError(folder, f"has {len(files)} files {pattern}; want at most {SHOT_FRAMES}")
    check_inside(folder, files.values())
    return dict(sorted(files.items()))


def check_no_gap(folder: Path, files: dict[int, Path]) -> None:
    """Raise ShotError where a frame number is missing: motion leads from each frame to the previous one."""
    numbers = list(files)
    for before, after in pairwise(numbers):
        if after != before + 1:
            missing = f"frame {before + 1}" + (f" to {after - 1}" if after > before + 2 else "")
            problem = f"{missing} between {files[before].name} and {files[after].name} is missing"
            raise ShotError(folder, problem, "Render it; motion leads from each frame to the one before it.")


def read_jitter(folder: Path, jitter: Jitter | None, count: int) -> list[tuple[float, float]]:
    """Return the jitter of `count` frames: as given, or from `jitter.json` in the folder, or zero.

    Raises:
        ShotError: the file is missing, or does not hold [x, y] for each frame.
        ArgumentError: the given sequence does not hold (x, y) for each frame.
    """
    if jitter is None:
        if not (folder / JITTER_FILE_NAME).exists():
            return [(0.0, 0.0)] * count
        jitter = folder / JITTER_FILE_NAME
    values = read_json(Path(jitter)) if isinstance(jitter, Path | str) else jitter
    want = f"[x, y] for each of {count} frames"
    try:
        pairs = [(float(x), float(y)) for x, y in values]
    except (TypeError, ValueError, OverflowError):
        pairs = []
    if len(pairs) != count:
        got = f"{len(pairs)} pairs" if pairs else "something else"
        if isinstance(jitter, Path | str):
            raise ShotError(jitter, f"holds {got}; want {want}")
        raise ArgumentError("jitter", got=got, want=want)
    return pairs
