"""upscale.json: the settings of a run, and the list of the files that it wrote into the folder.

`"files": {"exr/####.exr": 12, "compare.html": 1}` are exr/0000.exr to exr/0011.exr and a page; with
`"first frame": 7` they are exr/0007.exr to exr/0018.exr. A file is listed before it is written. Files that
are not listed are never counted, replaced or removed. Only names that a run can write are accepted from the
list.
"""

import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from supersampler.errors import ShotError
from supersampler.io.atomic import is_own_folder, is_regular, is_there, write_text
from supersampler.io.json_fields import read_json
from supersampler.io.shot.format import LARGEST_NUMBER

FILE_NAME = "upscale.json"
PAGE, VIDEO = "compare.html", "video.mp4"
SINGLE = (PAGE, VIDEO)
FIRST = "first frame"
"""Setting: the number of the first frame in the names of files; 0 where it is missing."""
RECORDED = "recorded"
"""Subfolder of the last image of a recording, written by `supersampler replay`."""
FORMATS = ("exr", "png")
_FRAMES = frozenset(
    f"{folder}{place}####.{format_}"
    for folder in ("", f"{RECORDED}/")
    for format_ in FORMATS
    for place in ("", f"{format_}/")
)
_RECORDS_TO = "records to"
_MAX_FILES = 10**9  # maximum number of listed frames
_START_OVER = f"Remove the files of that run and {FILE_NAME} yourself, or choose another folder."


@dataclass(frozen=True)
class RunRecord:
    """Content of upscale.json.

    Attributes:
        settings: all that the images depend on; JSON values.
        files: number of files, from the first frame on, by pattern such as `exr/####.exr`; 1 for those of
            SINGLE.
        recording: the folder that the run records to, or None.
    """

    settings: Mapping[str, Any]
    files: Mapping[str, int] = field(default_factory=dict)
    recording: str | None = None

    @property
    def first(self) -> int:
        """Number of the first frame in the names of files."""
        return int(self.settings.get(FIRST, 0))

    def lists(self, pattern: str, number: int) -> bool:
        """Return whether the frame of this number is listed."""
        return 0 <= number - self.first < self.files.get(pattern, 0)

    def write(self, folder: Path) -> None:
        """Write upscale.json into the folder, which is created where it is missing."""
        content = {**self.settings, _RECORDS_TO: self.recording, "files": dict(self.files)}
        write_text(folder / FILE_NAME, json.dumps(content, indent=2) + "\n")

    def own_files(self, folder: Path) -> list[Path]:
        """Return the listed files that exist; ShotError where a link or folder has the name of one."""
        found = [folder / name for name in SINGLE if self.files.get(name) and is_there(folder / name)]
        for pattern in self.files:
            if pattern not in SINGLE:
                found += sorted(path for n, path in numbered(folder, pattern) if self.lists(pattern, n))
        for path in found:
            if not is_regular(path):
                raise foreign(path, "is no regular file")
        return found


def read_run_record(folder: Path) -> RunRecord | None:
    """Read the upscale.json of a folder, or return None; ShotError where it is damaged or foreign."""
    path = folder / FILE_NAME
    if not is_there(path):
        return None
    if not is_regular(path):
        raise foreign(path, "is no regular file")
    content = read_json(path)
    files = content.pop("files", None) if isinstance(content, dict) else None
    if not isinstance(files, dict):
        problem = "does not list the files of its run: it is of an earlier version, or of something else"
        raise ShotError(path, problem, _START_OVER)
    for pattern, count in files.items():
        most = 1 if pattern in SINGLE else _MAX_FILES if pattern in _FRAMES else -1
        if type(count) is not int or not 0 <= count <= most:
            raise ShotError(path, f"lists {pattern!r}: {count!r}, which no run writes", _START_OVER)
    first = content.get(FIRST, 0)
    if type(first) is not int or not 0 <= first <= LARGEST_NUMBER:
        raise ShotError(path, f"says {FIRST!r}: {first!r}, which no run writes", _START_OVER)
    recording = content.pop(_RECORDS_TO, None)
    return RunRecord(content, files, recording if isinstance(recording, str) else None)


def frame_path(folder: Path, pattern: str, number: int) -> Path:
    """Return a frame's file: exr/0007.exr for `exr/####.exr` and 7."""
    return folder / pattern.replace("####", f"{number:04d}")


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
    suffix = re.escape(Path(pattern).suffix)
    for path in place.iterdir():
        found = re.fullmatch(rf"(\d{{4,10}}){suffix}", path.name)
        if found and f"{int(found[1]):04d}" == found[1]:
            yield int(found[1]), path
