"""Whose files are whose: writes that appear whole, and checks before anything is replaced or removed.

A file is written beside its place under a temporary name (`.name.partial.exr`), then renamed, so that a run
killed at any point leaves no half-written file.
"""

import os
import re
import secrets
import stat
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from supersampler.errors import ShotError

NO_ROOM = "Is the disk full or write-protected?"
_PARTIAL = ".partial"
_PARTIAL_NAME = re.compile(rf"\.(.+)\.[0-9a-f]{{8}}{re.escape(_PARTIAL)}((?:\.[^.]+)?)")


@contextmanager
def replacing(path: Path | str) -> Iterator[Path]:
    """Give a temporary name beside `path`; rename it to `path` at the end, or remove it where that fails."""
    path = Path(path)
    partial = path.with_name(f".{path.stem}.{secrets.token_hex(4)}{_PARTIAL}{path.suffix}")
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        yield partial
        partial.replace(path)
    except OSError as error:
        if isinstance(error, ShotError):
            raise
        raise ShotError(path, f"cannot be written ({error})", NO_ROOM) from error
    finally:
        with suppress(OSError):  # whatever went wrong has been raised above
            partial.unlink(missing_ok=True)


def remove_partial_files(folder: Path, names: re.Pattern[str], below: Iterable[str] = ()) -> None:
    """Remove what killed runs left of files whose names match `names` as a whole.

    Only regular files that are called as `replacing` calls them are removed.

    Args:
        folder: where to look; it may be a link.
        names: of the files that were being written.
        below: folders in it where to look too; those that are links are left out.
    """
    root = Path(os.path.realpath(folder))
    for place in (root, *(root / name for name in below if name)):
        if not place.is_dir() or os.path.realpath(place) != str(place):
            continue
        for path in place.iterdir():
            found = _PARTIAL_NAME.fullmatch(path.name)
            if found and names.fullmatch(found[1] + found[2]) and is_regular(path):
                remove_files([path])


def check_ours(path: Path, is_ours: Callable[[Path], bool], what: str) -> None:
    """Raise where something is at `path` that this package did not write.

    Args:
        path: a file that is to be replaced, there or not.
        is_ours: tells it by its content.
        what: it should be, "a record of `bench ... --json`" say.

    Raises:
        ShotError: names the file.
    """
    if is_there(path) and not (is_regular(path) and is_ours(path)):
        hint = "Move it away, or choose another name."
        raise ShotError(path, f"is there already, and is not {what}", hint)


def remove_files(paths: Iterable[Path]) -> None:
    """Remove files, those that are gone left out.

    Raises:
        ShotError: the disk refused.
    """
    for path in paths:
        try:
            path.unlink(missing_ok=True)
        except OSError as error:
            raise ShotError(
                path, f"cannot be removed ({error})", "Is it in use or write-protected?"
            ) from error


def is_regular(path: Path) -> bool:
    """Tell whether a regular file is there; False for a link, whatever it leads to."""
    try:
        return stat.S_ISREG(path.lstat().st_mode)
    except (OSError, ValueError):
        return False


def is_own_folder(path: Path) -> bool:
    """Tell whether a folder is there that is not a link."""
    try:
        return stat.S_ISDIR(path.lstat().st_mode)
    except (OSError, ValueError):
        return False


def is_there(path: Path) -> bool:
    """Tell whether anything has this name: a file, a folder, a link that leads nowhere."""
    return os.path.lexists(path)


def check_apart(output: Path, source: Path) -> None:
    """Raise where what is to be written and what is read are not apart.

    Args:
        output: a file or folder to write, there or not.
        source: the file or folder that is read.

    Raises:
        ShotError: `output` is `source`, holds it or lies in it, links followed.
    """
    above_output, above_source = _identities(output), _identities(source)
    hint = "Choose another place for what is written."
    if _identity(source) in above_output:
        relation = "is" if _identity(output) == _identity(source) else "lies in"
        raise ShotError(output, f"{relation} the input, {source}", hint)
    if _identity(output) in above_source:
        raise ShotError(output, f"holds the input, {source}", hint)


def check_inside(folder: Path, paths: Iterable[Path]) -> None:
    """Raise where a path leads out of `folder`, by a link or by `..`; `folder` itself may be a link.

    Raises:
        ShotError: names the path.
    """
    root, real_folders = os.path.realpath(folder), dict[Path, str]()
    for path in paths:
        if path.parent not in real_folders:
            real_folders[path.parent] = os.path.realpath(path.parent)
        real = os.path.realpath(path) if path.is_symlink() else real_folders[path.parent]
        if not Path(real).is_relative_to(root):
            hint = "Copy the file into the folder; links and names that leave it are not followed."
            raise ShotError(path, f"leads out of {folder}", hint)


def _identity(path: Path) -> tuple[int, int] | None:
    """Identity of a file or folder, whatever its name; None where it does not exist."""
    try:
        found = path.stat()
    except (OSError, ValueError):
        return None
    return found.st_dev, found.st_ino


def _identities(path: Path) -> set[tuple[int, int]]:
    """Return those of a path and of all folders above it, as far as they are there."""
    real = Path(os.path.realpath(path))
    return {found for place in (real, *real.parents) if (found := _identity(place)) is not None}
