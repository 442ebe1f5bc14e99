"""upscale.json: the settings of a run, and the list of the files that it wrote into the folder.

`"files": {"exr/####.exr": 12, "compare.html": 1}` are exr/0000.exr to exr/0011.exr and a page; with
`"first frame": 7` they are exr/0007.exr to exr/0018.exr. A run of some frames keeps them in a file of its
own, so that several can write into one folder at once: upscale.0010-0050.json, with `"frames": "10-50"`. A
file is listed before it is written. Files that are not listed are never counted, replaced or removed. Only
names that a run can write are accepted from the list.
"""

import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from supersampler.errors import ArgumentError, ShotError
from supersampler.io.files import is_own_folder, is_regular, is_there, write_text
from supersampler.io.json_fields import read_json
from supersampler.io.shot.format import LARGEST_NUMBER, is_frame_range
from supersampler.io.shot.numbered import FrameNumbers

FILE_NAME = "upscale.json"
PAGE, VIDEO = "compare.html", "video.mp4"
FIRST = "first frame"
"""Setting: the number of the first frame in the names of files; 0 where it is missing."""
FRAMES = "frames"
"""Setting: the numbers of the frames of the run; missing where it has all from FIRST on."""
RECORDED = "recorded"
"""Subfolder of the last image of a recording, written by `supersampler replay`."""
SOURCE = "source"
"""Setting: the options by which the shot was opened."""
DEMO: Mapping[str, str] = {"command": "demo"}
"""SOURCE of a run of `supersampler demo`, whose files another one replaces."""
FORMATS = ("exr", "png", "tif")
NAME = re.compile(r"(?!\.)[^/\\:*?\"<>|#\x00-\x1f]*#+[^/\\:*?\"<>|#\x00-\x1f]*")
"""Names of images without their extension: one run of # is the number, with as many digits at least."""
_FRAME_FILES = re.compile(
    rf"(?:{RECORDED}/)?(?:(?P<below>{'|'.join(FORMATS)})/)?{NAME.pattern}\.(?P<format>{'|'.join(FORMATS)})"
)
_RECORDS = re.compile(r"upscale(\.-?\d[\d_-]*(?:_[0-9a-f]{8})?)?\.json")
_RECORDS_TO = "records to"
_MAX_FILES = 10**9  # maximum number of listed frames
_START_OVER = f"Remove the files of that run and {FILE_NAME} yourself, or choose another folder."


@dataclass(frozen=True)
class RunRecord:
    """Content of upscale.json.

    Attributes:
        settings: all that the images depend on; JSON values.
        files: number of files, from the first frame on, by pattern such as `exr/####.exr`; 1 for the page,
            the number of frames for the video.
        recording: the folder that the run records to, or None.
    """

    settings: Mapping[str, Any]
    files: Mapping[str, int] = field(default_factory=dict)
    recording: str | None = None

    @property
    def numbers(self) -> FrameNumbers:
        """Numbers of the frames in the names of files, without an end where the run has all."""
        if FRAMES in self.settings:
            return FrameNumbers.parse(self.settings[FRAMES], FRAMES)
        return FrameNumbers(((int(self.settings.get(FIRST, 0)), LARGEST_NUMBER),))

    @property
    def single(self) -> tuple[str, str]:
        """Names of the page and the video."""
        return self._labelled(PAGE), self._labelled(VIDEO)

    @property
    def file_name(self) -> str:
        """Name of the file that holds this record."""
        return self._labelled(FILE_NAME)

    def lists(self, pattern: str, number: int) -> bool:
        """Return whether the frame of this number is listed."""
        numbers = self.numbers
        return number in numbers and numbers.position(number) < self.files.get(pattern, 0)

    def write(self, folder: Path) -> None:
        """Write the record into the folder, which is created where it is missing."""
        content = {**self.settings, _RECORDS_TO: self.recording, "files": dict(self.files)}
        write_text(folder / self.file_name, json.dumps(content, indent=2) + "\n")

    def own_files(self, folder: Path) -> list[Path]:
        """Return the listed files that exist; ShotError where a link or folder has the name of one."""
        found = [folder / name for name in self.single if self.files.get(name) and is_there(folder / name)]
        for pattern in self.files:
            if pattern not in self.single:
                found += sorted(path for n, path in numbered(folder, pattern) if self.lists(pattern, n))
        for path in found:
            if not is_regular(path):
                raise foreign(path, "is no regular file")
        return found

    def _labelled(self, name: str) -> str:
        stem, dot, extension = name.partition(".")
        label = f".{self.numbers.label}" if FRAMES in self.settings else ""
        return f"{stem}{label}{dot}{extension}"


def read_run_record(folder: Path, name: str = FILE_NAME) -> RunRecord | None:
    """Read the record of this name in a folder, or return None; ShotError where it is damaged or foreign."""
    path = folder / name
    if not is_there(path):
        return None
    if not is_regular(path):
        raise foreign(path, "is no regular file")
    content = read_json(path)
    files = content.pop("files", None) if isinstance(content, dict) else None
    if not isinstance(files, dict):
        problem = "does not list the files of its run: it is of an earlier version, or of something else"
        raise ShotError(path, problem, _START_OVER)
    recording = content.pop(_RECORDS_TO, None)
    record = RunRecord(content, files, recording if isinstance(recording, str) else None)
    _check_numbers(path, record)
    for pattern, count in files.items():
        page, video = record.single
        most = 1 if pattern == page else _MAX_FILES if pattern == video or _is_written(pattern) else -1
        if type(count) is not int or not 0 <= count <= most:
            raise ShotError(path, f"lists {pattern!r}: {count!r}, which no run writes", _START_OVER)
    return record


def other_records(folder: Path, name: str) -> list[RunRecord]:
    """Return the records in a folder but the one of this name, of runs of other frames."""
    if not folder.is_dir():
        return []
    names = sorted(path.name for path in folder.iterdir() if _RECORDS.fullmatch(path.name))
    return [record for other in names if other != name and (record := read_run_record(folder, other))]


def frame_path(folder: Path, pattern: str, number: int) -> Path:
    """Return a frame's file: exr/0007.exr for `exr/####.exr` and 7."""
    sign = "-" if number < 0 else ""
    return folder / re.sub("#+", lambda digits: f"{sign}{abs(number):0{len(digits[0])}d}", pattern)


def frame_number(pattern: str, name: str) -> int | None:
    """Return the number of the frame whose file `frame_path` gives this name; None where there is none."""
    if "#" not in pattern:
        return None
    before, _, after = re.split("(#+)", pattern)
    found = re.fullmatch(rf"{re.escape(before)}(-?\d{{1,10}}){re.escape(after)}", name)
    if found is None or frame_path(Path(), pattern, int(found[1])).name != name:
        return None
    return int(found[1])


def foreign(path: Path, problem: str = "is there already") -> ShotError:
    """Return the error for a file that this command did not write."""
    hint = "Move it away, or choose another folder."
    return ShotError(path, f"{problem}, and {FILE_NAME} does not list it as written by this command", hint)


def numbered(folder: Path, pattern: str) -> Iterator[tuple[int, Path]]:
    """Yield number and path of all files with names of this pattern; ShotError where a folder is a link."""
    place = folder / Path(pattern).parent
    if not is_there(place) or (place == folder and not place.is_dir()):
        return
    below = [part for part in (place, *place.parents) if part != folder and part.is_relative_to(folder)]
    if not all(map(is_own_folder, below)):
        raise foreign(place, "is no folder, or a link to one")
    for path in place.iterdir():
        number = frame_number(Path(pattern).name, path.name)
        if number is not None:
            yield number, path


def _is_written(pattern: str) -> bool:
    found = _FRAME_FILES.fullmatch(pattern)
    return found is not None and found["below"] in (None, found["format"])


def _check_numbers(path: Path, record: RunRecord) -> None:
    """Raise ShotError unless the numbers of a record are those of the run that its name says."""
    first, frames = record.settings.get(FIRST, 0), record.settings.get(FRAMES, "0")
    problem = ShotError(path, f"says {FIRST!r}: {first!r}, which no run writes", _START_OVER)
    if type(first) is not int or not is_frame_range(first, LARGEST_NUMBER):
        raise problem
    try:
        FrameNumbers.parse(frames if isinstance(frames, str) else "", FRAMES)
    except ArgumentError as error:
        raise ShotError(path, f"says {error}", _START_OVER) from error
    if record.file_name != path.name:
        raise ShotError(path, f"is the record of other frames, {record.file_name}", _START_OVER)
