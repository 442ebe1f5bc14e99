"""upscale.json: the settings of the run that a folder is of, and which files in it are that run's.

`"files"` lists them: `{"exr/####.exr": 12, "compare.html": 1}` are exr/0000.exr to exr/0011.exr and a page. A
file is listed before it is written, so that at any moment all that is there of the run is listed. Nothing
else is ever counted as a result, replaced or removed. The list comes from a file itself: only names that a
run can write are taken from it.
"""

import json
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from supersampler.errors import ShotError
from supersampler.io.atomic import is_own_folder, is_regular, is_there, replacing
from supersampler.io.json_fields import read_json

FILE_NAME = "upscale.json"
PAGE = "compare.html"
RECORDED = "recorded"
"""Folder of the last image as `supersampler replay` finds it in a recording."""
FORMATS = ("exr", "png")
_FRAMES = frozenset(
    f"{folder}{place}####.{format_}"
    for folder in ("", f"{RECORDED}/")
    for format_ in FORMATS
    for place in ("", f"{format_}/")
)
_RECORDS_TO = "records to"
_MOST = 10**9  # frames that a list may claim
_START_OVER = f"Remove the files of that run and {FILE_NAME} yourself, or choose another folder."


@dataclass(frozen=True)
class RunRecord:
    """What upscale.json says.

    Attributes:
        settings: all that the images follow from; JSON values.
        files: numbered files as `exr/####.exr`, to how many there are from 0000 on; PAGE to 1.
        recording: the folder that the run records to, or None.
    """

    settings: Mapping[str, Any]
    files: Mapping[str, int] = field(default_factory=dict)
    recording: str | None = None

    def write(self, folder: Path) -> None:
        """Write it to upscale.json in the folder, which is made where it is missing."""
        content = {**self.settings, _RECORDS_TO: self.recording, "files": dict(self.files)}
        with replacing(folder / FILE_NAME) as partial:
            partial.write_text(json.dumps(content, indent=2) + "\n", encoding="utf-8", newline="\n")

    def own_files(self, folder: Path) -> list[Path]:
        """Return the files in the folder that it lists, as far as they are there.

        Raises:
            ShotError: something else has the name of one: a link, a folder.
        """
        found = [path for pattern, count in self.files.items() for path in _listed(folder, pattern, count)]
        for path in found:
            if not is_regular(path):
                raise foreign(path, "is no regular file")
        return found


def read_run_record(folder: Path) -> RunRecord | None:
    """Read the upscale.json of a folder; None where there is none.

    Raises:
        ShotError: something else has its name, or it does not list the files of its run.
    """
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
        if not _can_be_written(pattern, count):
            raise ShotError(path, f"lists {pattern!r}: {count!r}, which no run writes", _START_OVER)
    recording = content.pop(_RECORDS_TO, None)
    return RunRecord(content, files, recording if isinstance(recording, str) else None)


def frame_path(folder: Path, pattern: str, index: int) -> Path:
    """Return the file of a frame: `exr/####.exr` and 7 are exr/0007.exr."""
    return folder / pattern.replace("####", f"{index:04d}")


def foreign(path: Path, problem: str = "is there already") -> ShotError:
    """Return the error for a file in the way that this command did not write."""
    hint = "Move it away, or choose another folder."
    return ShotError(path, f"{problem}, and {FILE_NAME} does not list it as written by this command", hint)


def numbered(folder: Path, pattern: str) -> Iterator[tuple[int, Path]]:
    """Yield index and path of all that is there by a name of this pattern, listed or not.

    Raises:
        ShotError: the folder that they lie in is a link.
    """
    place = folder / Path(pattern).parent
    if not is_there(place) or (place == folder and not place.is_dir()):
        return
    if place != folder and not all(is_own_folder(part) for part in _below(folder, place)):
        raise foreign(place, "is no folder, or a link to one")
    suffix = re.escape(Path(pattern).suffix)
    for path in place.iterdir():
        found = re.fullmatch(rf"(\d{{4,10}}){suffix}", path.name)
        if found and f"{int(found[1]):04d}" == found[1]:
            yield int(found[1]), path


def _listed(folder: Path, pattern: str, count: int) -> list[Path]:
    if pattern == PAGE:
        return [folder / PAGE] if count and is_there(folder / PAGE) else []
    return sorted(path for index, path in numbered(folder, pattern) if index < count)


def _below(folder: Path, place: Path) -> list[Path]:
    """Return the folders from `folder`, which is not among them, to `place`."""
    return [part for part in (place, *place.parents) if part != folder and part.is_relative_to(folder)]


def _can_be_written(pattern: str, count: object) -> bool:
    most = 1 if pattern == PAGE else _MOST if pattern in _FRAMES else -1
    return type(count) is int and 0 <= count <= most
