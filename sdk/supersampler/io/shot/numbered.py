"""Find the numbered files of a frame sequence by a pattern, and read its jitter."""

import os
import re
from collections.abc import Iterable, Mapping, Sequence
from fnmatch import fnmatchcase
from itertools import pairwise
from pathlib import Path, PurePath, PurePosixPath
from typing import TypeAlias

from supersampler.errors import ArgumentError, ShotError
from supersampler.io.files import NOT_FOUND, check_inside
from supersampler.io.json_fields import read_json
from supersampler.io.limits import SHOT_FRAMES

JITTER_FILE_NAME = "jitter.json"
FRAME_SUFFIXES = (".exr", ".png", ".tif", ".tiff")
"""Of the image files that are read."""
Jitter: TypeAlias = Sequence[tuple[float, float]] | Path | str
"""(x, y) of each frame, or a JSON file that holds [[x, y], ...]; a shorter list repeats."""
Range: TypeAlias = tuple[int, int]
"""First and last frame number, both included."""

_FIELD = re.compile(r"#+|%0?(\d{0,2})d")
_GLOB = re.compile(r"[*?\[]")
_LAST_NUMBER = re.compile(r"(.*?)(\d+)(\D*)", re.DOTALL)


def is_pattern(path: Path) -> bool:
    """Return whether a path that does not exist has ####, %04d or a glob in its last part."""
    return not os.path.lexists(path) and bool(_FIELD.search(path.name) or _GLOB.search(path.name))


def numbered_files(folder: Path, pattern: str) -> dict[int, Path]:
    """Return frame number to file, in order, for the files of a pattern.

    Args:
        folder: the pattern is relative to it.
        pattern: with one field for the number: `beauty.####.exr` takes 4 digits or more, `beauty.%04d.exr`
            the same, `beauty.%d.exr` any; or a glob such as `beauty_*.exr`, where the number is the last in
            the name.

    Raises:
        ShotError: none matches, a name has no number, two have the same, or one lies outside of the folder.
    """
    if not os.path.isdir(folder):  # noqa: PTH112  # Path.is_dir raises for names that are too long
        raise ShotError(folder, "there is no such folder", NOT_FOUND)
    parts = PurePosixPath(pattern).parts
    if not parts or PurePath(pattern).is_absolute() or ".." in parts:
        hint = "Copy the files into the folder; names that leave it are not followed."
        raise ShotError(folder, f"the pattern {pattern!r} matches no files in it", hint)
    name = parts[-1]
    field = _checked_field(folder / pattern)
    anywhere = name if field is None else f"{name[: field.start()]}*{name[field.end() :]}"
    files: dict[int, Path] = {}
    try:
        paths = sorted(folder.glob(str(PurePosixPath(*parts[:-1], anywhere))))
    except (ValueError, NotImplementedError, OSError) as error:
        raise ShotError(folder, f"has no files {pattern!r} ({error})") from error
    for path in paths:
        if path.name.startswith("."):  # being written
            continue
        span = _number(path, field)
        if span is None:
            continue
        number = int(path.name[slice(*span)])
        if number in files:
            hint = f"Choose one sequence by a pattern: {_listed(sequences(paths))}."
            raise ShotError(path, f"has the same frame number as {files[number].name}", hint)
        files[number] = path
    if not files:
        raise ShotError(folder, f"has no file {pattern}", suggestion((folder / pattern).parent))
    if len(files) > SHOT_FRAMES:
        raise ShotError(folder, f"has {len(files)} files {pattern}; want at most {SHOT_FRAMES}")
    check_inside(folder, files.values())
    return dict(sorted(files.items()))


def sequences(paths: Iterable[Path]) -> list[str]:
    """Return the patterns of numbered files with their numbers, such as `beauty.####.exr (10-49)`."""
    groups: dict[tuple[str, str], list[str]] = {}
    for path in paths:
        if (found := _LAST_NUMBER.fullmatch(path.stem)) is not None:
            groups.setdefault((found[1], found[3] + path.suffix), []).append(found[2])
    result = []
    for (begin, end), digits in groups.items():
        numbers = sorted(map(int, digits))
        result.append(f"{begin}{'#' * min(map(len, digits))}{end} ({numbers[0]}-{numbers[-1]})")
    return result


def of_range(folder: Path, files: Mapping[int, Path], frames: Range | None) -> dict[int, Path]:
    """Return the files of a range of numbers; of all where `frames` is None.

    Raises:
        ShotError: no file lies in the range; or a number between two files, inside the range, has none:
            motion leads from each frame to the previous one.
    """
    low, high = (min(files), max(files)) if frames is None else frames
    chosen = {number: path for number, path in files.items() if low <= number <= high}
    if not chosen:
        problem = f"has no frame from {low} to {high}"
        raise ShotError(folder, problem, f"Its frames are {min(files)} to {max(files)}.")
    for before, after in pairwise(files):
        first, last = max(before + 1, low), min(after - 1, high)
        if first <= last:
            missing = f"frame {first}" + (f" to {last}" if last > first else "")
            problem = f"{missing} between {files[before].name} and {files[after].name} is missing"
            raise ShotError(folder, problem, "Render it; motion leads from each frame to the one before it.")
    return chosen


def file_names(path: Path, pattern: str) -> str:
    """Return the stem of a file of a pattern with #### for its number: `beauty.####` for beauty.0010.exr."""
    start, stop = _number(path, _checked_field(Path(pattern))) or (0, 0)
    begin, end = (re.sub(r"[^\w .+-]", "_", text) for text in (path.stem[:start], path.stem[stop:]))
    return f"{begin}{'#' * max(4, stop - start)}{end}"


def read_jitter(folder: Path, jitter: Jitter | None, indices: Iterable[int]) -> list[tuple[float, float]]:
    """Return the jitter of frames: as given, or from `jitter.json` in the folder, or zero.

    A list of another length repeats from its start, as the jitter of renderers does.

    Args:
        folder: of the frames.
        jitter: of the sequence, from its first frame.
        indices: of the frames, counted from the first of the sequence.

    Raises:
        ShotError: the file is missing, or does not hold [x, y] pairs.
        ArgumentError: the given sequence does not hold (x, y) pairs.
    """
    if jitter is None:
        if not (folder / JITTER_FILE_NAME).exists():
            return [(0.0, 0.0) for _ in indices]
        jitter = folder / JITTER_FILE_NAME
    values = read_json(Path(jitter)) if isinstance(jitter, Path | str) else jitter
    want = "[x, y] of each frame, or of the first ones where it repeats"
    try:
        pairs = [(float(x), float(y)) for x, y in values]
    except (TypeError, ValueError, OverflowError):
        pairs = []
    if not pairs:
        if isinstance(jitter, Path | str):
            raise ShotError(jitter, f"holds something else; want {want}")
        raise ArgumentError("jitter", got="something else", want=want)
    return [pairs[index % len(pairs)] for index in indices]


def _checked_field(path: Path) -> re.Match[str] | None:
    """Return the field for the number in the name of a pattern; None for a glob without one.

    Raises:
        ShotError: the pattern has several fields, or neither a field nor a glob.
    """
    fields = list(_FIELD.finditer(path.name))
    if len(fields) > 1:
        problem = f"has {len(fields)} fields for the frame number"
        raise ShotError(path, problem, "Keep one, and write the other digits out.")
    if not fields and _GLOB.search(path.name) is None:
        raise ShotError(path, "has no field for the frame number", suggestion(path.parent))
    return fields[0] if fields else None


def _number(path: Path, field: re.Match[str] | None) -> tuple[int, int] | None:
    """Return where a name has its number: (start, stop); None where the name does not match the pattern."""
    if field is None:
        last = _LAST_NUMBER.fullmatch(path.stem)
        if last is None:
            raise ShotError(path, "has no frame number in its name", "Name frames like beauty_0001.exr.")
        return last.span(2)
    least = len(field[0]) if field[0][0] == "#" else int(field[1] or 1)
    begin, end = field.string[: field.start()], field.string[field.end() :]
    for found in re.finditer(rf"(?=(\d{{{least},}}))", path.name):  # ahead, as matches may overlap
        start, stop = found.span(1)
        if fnmatchcase(path.name[:start], begin) and fnmatchcase(path.name[stop:], end):
            return start, stop
    return None


def suggestion(folder: Path) -> str:
    """Return which sequences a folder has."""
    if not folder.is_dir():
        return "Is this the folder of the frames?"
    images = sorted(path for path in folder.iterdir() if path.suffix.lower() in FRAME_SUFFIXES)
    there = sequences(path for path in images if not path.name.startswith("."))
    return f"Did you mean {_listed(there)}?" if there else "Is this the folder of the frames?"


def _listed(names: Sequence[str]) -> str:
    return " or ".join(names[:4]) + (f" or one of {len(names) - 4} more" if len(names) > 4 else "")
