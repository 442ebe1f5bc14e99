"""File names in a recording's folder, and its safe removal."""

import os
import re
from pathlib import Path

from supersampler.errors import RecordingError
from supersampler.io.files import is_own_folder, is_regular, is_there, remove_empty_folders, remove_files

SETUP = "recording.json"
CALLS = "calls.jsonl"
LAST_IMAGE = "last.exr"
FRAME = "{:04d}.exr"
DISPLAY = "display/{:04d}.exr"
SAMPLED = "sampled/{:04d}.exr"
STATE = "states/{:04d}.safetensors"
"""Files of a step, by its index, and of a load_state call."""

_FOLDERS = ("display", "sampled", "states")
_FILES = re.compile(
    r"((display|sampled)/)?\d{4,}\.exr|states/\d{4,}\.safetensors|last\.exr|(recording|shot)\.json|calls\.jsonl"
    r"|((display|sampled|states)/)?\.\w+\.[0-9a-f]{8}\.partial\.\w+"  # of a killed process; see `io.files`
)


def is_recording(path: Path) -> bool:
    """Return whether a folder holds a recording, perhaps beside other files."""
    return is_regular(path / SETUP)


def holds_only_a_recording(path: Path) -> bool:
    """Return whether a folder, which is not a link, holds a recording and no other file."""
    if not (is_own_folder(path) and is_recording(path)):
        return False
    log = (path / CALLS).read_bytes() if is_regular(path / CALLS) else b""
    counts = {".exr": log.count(b'"frame": {'), ".safetensors": log.count(b'"call": "load_state"')}
    for place, folders, files in os.walk(path):  # follows no links
        below = Path(place).relative_to(path)
        for name in (*folders, *files):
            relative = (below / name).as_posix()
            is_folder = relative in _FOLDERS and is_own_folder(path / relative)
            if not is_folder and not (is_regular(path / relative) and _FILES.fullmatch(relative)):
                return False
            stem, suffix = Path(name).stem, Path(name).suffix
            if stem.isdigit() and int(stem) > counts[suffix]:  # a killed process may leave one more
                return False
    return True


def remove_recording(path: Path) -> None:
    """Remove a recording's folder where it exists.

    Raises:
        RecordingError: it is no recording, or holds other files; nothing is removed.
        ShotError: the disk refused.
    """
    if not is_there(path):
        return
    if not holds_only_a_recording(path):
        raise RecordingError(path, "is no recording, or holds other files, too", "Move it away.")
    for place in (*(path / name for name in _FOLDERS if is_own_folder(path / name)), path):
        remove_files(file for file in place.iterdir() if file.is_file())
        remove_empty_folders([place])
