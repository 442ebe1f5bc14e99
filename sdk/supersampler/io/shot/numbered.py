"""Find the numbered files of a frame sequence by a pattern, and read its jitter."""

import os
import re
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path, PurePath, PurePosixPath, PureWindowsPath
from typing import TypeAlias

from supersampler.arguments import as_index, checked_path, is_row
from supersampler.errors import ArgumentError, MissingFramesError, ShotError, shown
from supersampler.io.files import NOT_FOUND, SHOT_FRAMES, check_inside, is_folder
from supersampler.io.json_files import read_typed
from supersampler.io.shot.format import FORBIDDEN, LARGEST_NUMBER, is_frame_range

JITTER_FILE_NAME = "jitter.json"
FRAME_SUFFIXES = (".exr", ".png", ".tif", ".tiff")
"""Suffixes of the image files that are read."""
FOLLOW_LINKS = "--follow-links (follow_links=True in Python) reads them, if you trust who made the links."
"""Remedy for numbered files that are links."""
Jitter: TypeAlias = Sequence[tuple[float, float]] | Path | str
"""(x, y) of each frame, or a JSON file that holds [[x, y], ...]; a shorter list repeats."""
Range: TypeAlias = tuple[int, int]
"""First and last frame number, both included."""

_Span: TypeAlias = tuple[int, int]

_FIELD = re.compile(r"#+|%0?(\d{0,2})d")
_LAST_NUMBER = re.compile(r"(.*?)(-?\d+)(\D*)", re.DOTALL)
_NUMBER = re.compile(r"(?:(?:^|(?<=[._]))-)?\d+")
_SIGN_FOLLOWS = ("", ".", "_")
"""Characters after which a hyphen is always a sign; "" is the start of the name."""


def is_pattern(path: Path) -> bool:
    """Return whether a path does not exist and has ####, %04d, * or ? in its last part."""
    return not os.path.lexists(path) and bool(_FIELD.search(path.name) or _has_wildcard(path.name))


def numbered_files(folder: Path, pattern: str, *, follow_links: bool = False) -> dict[int, Path]:
    """Return the files of a pattern by frame number, in order.

    A hyphen after a dot, after an underscore or at the start is the number's sign: `beauty.-0012.exr` is
    frame -12. After other characters it is a separator: `beauty-0012.exr` is frame 12. If a file has the same
    name without the hyphen, it is ambiguous: an error.

    Args:
        folder: the pattern is relative to it.
        pattern: pattern with one field for the number. `beauty.####.exr` and `beauty.%04d.exr` match 4 digits
            or more, and negative numbers with any number of digits; `beauty.%d.exr` any. Or with `*` or `?`,
            such as `beauty_*.exr`: then the last number in the name counts. Folders have no wildcards. The
            extension may be in any case.
        follow_links: whether files and folders may be links that lead out of the folder.

    Raises:
        ShotError: no file matches, a name has no number, two have the same, names differ in more than the
            number, a hyphen is ambiguous, the pattern leaves out earlier frames because their numbers have
            fewer digits, or a link leads out of the folder.
    """
    if not is_folder(folder):
        raise ShotError(folder, "there is no such folder", NOT_FOUND)
    parts = PurePosixPath(checked_path("pattern", pattern)).parts
    if not parts or PurePath(pattern).is_absolute() or ".." in parts:
        hint = "Copy the files into the folder; names that leave it are not followed."
        raise ShotError(folder, f"the pattern {pattern!r} matches no files in it", hint)
    place = folder.joinpath(*parts[:-1])
    spans = _number_spans(place, parts[-1])
    files: dict[int, Path] = {}
    rests = {name: (name[:start], name[stop:].lower()) for name, (start, stop) in spans.items()}

    def choose() -> str:
        return f"Choose one sequence by a pattern: {_listed(sequences(place / name for name in spans))}."

    for name, span in spans.items():
        path, number = place / name, int(name[slice(*span)])
        if not is_frame_range(number, number):
            fewer = "Choose digits of it by a pattern, such as beauty.2026######.exr."
            raise ShotError(path, f"has the frame number {number}; want at most {LARGEST_NUMBER}", fewer)
        if number in files:
            other = files[number].name
            hint = "Move one of the two away." if rests[name] == rests[other] else choose()
            raise ShotError(path, f"has the same frame number as {other}", hint)
        files[number] = path
    if not files:
        below = "/".join(parts[:-1])
        hint = suggestion(place, below) if is_folder(place) else f"The pattern is relative to {folder}."
        if "\\" in pattern:
            hint = f"Patterns have forward slashes: {PureWindowsPath(pattern).as_posix()}."
        raise ShotError(folder, f"has no file {pattern}", hint)
    if len({*rests.values()}) > 1:
        raise ShotError(folder, f"has files of several sequences {pattern}", choose())
    if (earlier := _with_fewer_digits(place, parts[-1], min(files))) is not None:
        problem = f"has {earlier.name}, too, whose number has fewer digits than {parts[-1]} asks for"
        hint = f"Take any number of digits: {_FIELD.sub('#', parts[-1])}; or move that file away."
        raise ShotError(folder, problem, hint)
    if len(files) > SHOT_FRAMES:
        raise ShotError(folder, f"has {len(files)} files {pattern}; want at most {SHOT_FRAMES}")
    if not follow_links:
        check_inside(folder, files.values(), FOLLOW_LINKS)
    return dict(sorted(files.items()))


def sequences(paths: Iterable[Path]) -> list[str]:
    """Return the patterns of numbered files with their numbers, such as `beauty.####.exr (10-49)`.

    The number of a name is the one that differs in most other names; of several, the last.
    """
    spans = {path.name: [found.span() for found in _NUMBER.finditer(path.stem)] for path in paths}
    counts = Counter(_without(name, span) for name, each in spans.items() for span in each)
    groups: dict[tuple[str, str], list[str]] = {}
    for name, each in spans.items():
        rests = [(_without(name, span), name[slice(*span)]) for span in reversed(each)]
        for rest, number in sorted(rests, key=lambda found: -counts[found[0]])[:1]:
            groups.setdefault(rest, []).append(number)
    result = []
    for (begin, end), texts in groups.items():
        numbers = sorted(map(int, texts))
        digits = min(len(text.lstrip("-")) for text in texts)
        result.append(f"{begin}{'#' * digits}{end} ({numbers[0]}-{numbers[-1]})")
    return result


def of_range(folder: Path, files: Mapping[int, Path], frames: Range | None) -> dict[int, Path]:
    """Return the files of a range of numbers; None is all.

    Raises:
        ShotError: no file lies in the range.
        MissingFramesError: a frame between two files of the range is missing.
    """
    if frames is not None:
        ends = [as_index(number) for number in frames] if is_row(frames) else []
        if len(ends) != 2 or None in ends:
            raise ArgumentError("frames", got=shown(frames), want="(first, last), two frame numbers, or None")
    low, high = (min(files), max(files)) if frames is None else frames
    chosen = {number: path for number, path in files.items() if low <= number <= high}
    if not chosen:
        problem = f"has no frame from {low} to {high}"
        raise ShotError(folder, problem, f"Its frames are {min(files)} to {max(files)}.")
    gaps: dict[tuple[int, int], str] = {}
    for before, after in pairwise(files):
        if after - before > 1:
            gaps[before + 1, after - 1] = f"between {files[before].name} and {files[after].name} is missing"
    for (first, last), place in gaps.items():
        if first <= high and low <= last:
            problem = f"{frames_text(max(first, low), min(last, high))} {place}"
            hint = "Render it; motion leads from each frame to the one before it."
            raise MissingFramesError(folder, problem, hint, gaps=gaps, present=(min(files), max(files)))
    return chosen


def frames_text(first: int, last: int) -> str:
    """Return the numbers of frames as text: "frame 7", "frame 7 to 9"."""
    return f"frame {first}" + (f" to {last}" if last > first else "")


def file_names(path: Path, pattern: str) -> str:
    """Return the stem of a file of a pattern with #### for its number: `beauty.####` for beauty.0010.exr."""
    start, stop = _number_spans(path.parent, PurePosixPath(pattern).name).get(path.name, (0, 0))
    begin, end = (re.sub(f"[{FORBIDDEN}#]", "_", text) for text in (path.stem[:start], path.stem[stop:]))
    return f"{begin}{'#' * max(4, len(path.name[start:stop].lstrip('-')))}{end}"


def read_jitter(folder: Path, jitter: Jitter | None, indices: Iterable[int]) -> list[tuple[float, float]]:
    """Return the jitter of frames: as given, or from `jitter.json` in the folder, or zero.

    `indices` count from the first frame of the sequence. A shorter list repeats.

    Raises:
        ShotError: the file is missing, or does not hold [x, y] pairs.
        ArgumentError: the given sequence does not hold (x, y) pairs.
    """
    if jitter is None:
        if not (folder / JITTER_FILE_NAME).exists():
            return [(0.0, 0.0) for _ in indices]
        jitter = folder / JITTER_FILE_NAME
    want = "pairs [x, y], one for each frame; a shorter list repeats"
    if isinstance(jitter, Path | str):
        pairs = read_typed(Path(jitter), list[tuple[float, float]], f"It holds {want}.")
        if not pairs:
            raise ShotError(jitter, f"is empty; want {want}")
        return [pairs[index % len(pairs)] for index in indices]
    try:
        pairs = [(float(x), float(y)) for x, y in jitter]
    except (TypeError, ValueError, OverflowError, RuntimeError):  # of a user's class
        pairs = []
    if not pairs:
        raise ArgumentError("jitter", got=shown(jitter), want=want)
    return [pairs[index % len(pairs)] for index in indices]


def _number_spans(place: Path, pattern: str) -> dict[str, _Span]:
    """Return the span of the number, with its sign, in the name of each file of a pattern.

    Raises:
        ShotError: the folder cannot be read, a name has no number, or a hyphen is ambiguous.
    """
    number_in = _number_finder(place / pattern)
    try:
        names = sorted(path.name for path in place.iterdir()) if place.is_dir() else []
    except (ValueError, OSError) as error:
        raise ShotError(place, f"has no files {pattern!r} ({error})") from error
    names = [name for name in names if not name.startswith(".")]  # hidden files are incomplete
    found = {name: span for name in names if (span := number_in(name, signed=True)) is not None}
    plain = {_without(name, span) for name, span in found.items() if name[span[0]] != "-"}
    for name, (start, stop) in list(found.items()):
        if name[start] != "-" or name[:start][-1:] in _SIGN_FOLLOWS:
            continue
        if _without(name, (start, stop)) in plain:
            begin, number, end = name[:start], name[start:stop], name[stop:]
            problem = f"has an ambiguous hyphen, a sign or a separator: {begin}{number[1:]}{end} exists, too"
            hint = f"Name negative frames {begin}.{number}{end}; move other sequences away."
            raise ShotError(place / name, problem, hint)
        del found[name]
        if (span := number_in(name, signed=False)) is not None:
            found[name] = span
    return found


def _with_fewer_digits(place: Path, pattern: str, first: int) -> Path | None:
    """Return the file of the frame before the first, if `####` leaves it out: 999 where the first is 1000."""
    field = _FIELD.search(pattern)
    if field is None or first <= 0:
        return None
    begin, end = _without(pattern, field.span())
    is_before = re.compile(f"{_expression(begin)}{first - 1}{_ending(end)}", re.DOTALL)
    fewer = (path for path in place.iterdir() if is_before.fullmatch(path.name))
    return next(fewer, None) if len(str(first - 1)) < len(str(first)) else None


def _without(name: str, number: _Span) -> tuple[str, str]:
    return name[: number[0]], name[number[1] :]


def _number_finder(path: Path) -> Callable[..., _Span | None]:
    """Return a function that finds the number in a name: None if the name does not match the pattern.

    Raises:
        ShotError: the pattern has several fields, or neither a field nor a wildcard.
    """
    fields = list(_FIELD.finditer(path.name))
    if len(fields) > 1:
        problem = f"has {len(fields)} fields for the frame number"
        raise ShotError(path, problem, "Keep one, and write the other numbers as digits.")
    if not fields and not _has_wildcard(path.name):
        hint = f"Name its files: {path.name}/*.exr." if is_folder(path) else suggestion(path.parent)
        raise ShotError(path, "has no field for the frame number", hint)
    if fields:
        field, (begin, end) = fields[0], _without(path.name, fields[0].span())
        count = len(field[0]) if field[0][0] == "#" else int(field[1] or 1)
        digits = rf"\d{{{count},}}", rf"-\d+|\d{{{count},}}"
        in_field = [re.compile(f"{_expression(begin)}({each}){_ending(end)}", re.DOTALL) for each in digits]
    else:
        whole = re.compile(_ending(path.name), re.DOTALL)

    def number_in(name: str, *, signed: bool) -> _Span | None:
        if fields:
            found = in_field[signed].fullmatch(name)
            return None if found is None else found.span(1)
        if whole.fullmatch(name) is None:
            return None
        last = _LAST_NUMBER.fullmatch(Path(name).stem)
        if last is None:
            raise ShotError(
                path.parent / name, "has no frame number in its name", "Name frames like beauty_0001.exr."
            )
        start, stop = last.span(2)
        return (start if signed else start + (last[2][0] == "-")), stop

    return number_in


def _expression(text: str) -> str:
    """Return the regular expression of a text with the wildcards * and ?; brackets are text.

    Only the last * may match again in another way, so that no pattern takes long.
    """
    first, *others = (re.escape(part).replace(r"\?", ".") for part in text.split("*"))
    return first + "".join(f"(?>.*?{part})" for part in others[:-1]) + "".join(f".*?{p}" for p in others[-1:])


def _ending(text: str) -> str:
    """Return the regular expression for the end of a name; the extension may be in any case."""
    before, dot, extension = text.rpartition(".")
    return f"{_expression(before + dot)}(?i:{_expression(extension)})"


def _has_wildcard(name: str) -> bool:
    return "*" in name or "?" in name


def suggestion(folder: Path, below: str = "") -> str:
    """Return a hint that names the sequences in a folder, as patterns that begin with the folder `below`."""
    if not folder.is_dir():
        return "Is this the folder of the frames?"
    images = sorted(path for path in folder.iterdir() if path.suffix.lower() in FRAME_SUFFIXES)
    there = sequences(path for path in images if not path.name.startswith("."))
    there = [str(PurePosixPath(below, name)) for name in there]
    return f"Did you mean {_listed(there)}?" if there else "Is this the folder of the frames?"


def _listed(names: Sequence[str]) -> str:
    return " or ".join(names[:4]) + (f" or one of {len(names) - 4} more" if len(names) > 4 else "")


@dataclass(frozen=True, slots=True)
class FrameRange:
    """Frame numbers from `first` to `last`, both included."""

    first: int
    last: int

    @classmethod
    def parse(cls, text: str, name: str, lowest: int = -LARGEST_NUMBER) -> "FrameRange":
        """Return the numbers of "10-50", "60" or "-12--3"; ArgumentError, with `name`, for anything else."""
        found = re.fullmatch(r"\s*(-?\d{1,10})\s*(?:-\s*(-?\d{1,10})\s*)?", text)
        first, last = (int(found[1]), int(found[2] or found[1])) if found else (1, 0)
        if not is_frame_range(first, last) or first < lowest:
            least = "" if lowest < 0 else f", not below {lowest}"
            want = f"FIRST-LAST, such as 10-50, or one frame number{least}"
            raise ArgumentError(name, got=repr(text), want=want)
        return cls(first, last)

    @property
    def label(self) -> str:
        """The numbers as a part of file names: 0010-0050."""
        return f"{self.first:04d}" if len(self) == 1 else f"{self.first:04d}-{self.last:04d}"

    def __str__(self) -> str:
        return str(self.first) if len(self) == 1 else f"{self.first}-{self.last}"

    def __len__(self) -> int:
        return self.last + 1 - self.first

    def __contains__(self, number: int) -> bool:
        return self.first <= number <= self.last

    def overlaps(self, other: "FrameRange") -> bool:
        """Return whether a number is in both."""
        return self.first <= other.last and other.first <= self.last
