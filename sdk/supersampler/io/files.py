"""Write, rename and remove files, after checks of their paths.

No other module of the project writes files. A file is written under a temporary name in its folder
(`.name.HEX.partial.exr`) and then renamed, so that a killed run leaves no half-written file. Callers pass
only names that they chose, or that their own record lists and that they could have written.
"""

import os
import re
import secrets
import weakref
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager, suppress
from io import FileIO
from pathlib import Path
from typing import Final, Self

from supersampler.arguments import MAX_SIDE
from supersampler.errors import ShotError, printable

try:
    import fcntl
except ImportError:  # on Windows
    fcntl = None  # type: ignore[assignment]

IMAGE_PIXELS: Final = 1 << 27
"""Maximum width times height: 16384 x 8192."""
IMAGE_PARTS: Final = 1024
IMAGE_CHANNELS: Final = 4096
"""Maximum number of channels in all parts of an image file."""
IMAGE_ATTRIBUTES: Final = 1 << 12
"""Maximum number of header entries in a part of an EXR file; 16 times as many in all parts."""
IMAGE_BYTES: Final = 1 << 33
"""Maximum size of the pixels that are decoded at once."""
JSON_BYTES: Final = 1 << 26
"""Maximum size of a JSON file, or of the JSON header of another format."""
RATES: Final = (0.001, 1000.0)
"""Minimum and maximum frames per second, of a video and of a file's header."""
SHOT_FRAMES: Final = 1 << 20


def image_size_problem(width: int, height: int) -> str | None:
    """Return the problem with an image size that a file declares; None if there is none."""
    if not (1 <= width <= MAX_SIDE and 1 <= height <= MAX_SIDE and width * height <= IMAGE_PIXELS):
        return f"is {width}x{height}; want 1 to {MAX_SIDE} a side and at most {IMAGE_PIXELS} pixels"
    return None


NO_ROOM = "Is the disk full or write-protected?"
NOT_FOUND = "Is the path right, is the drive connected?"
_LOG_BYTES = 1 << 24
_PARTIAL = ".partial"
_PARTIAL_NAME = re.compile(rf"\.(.+)\.[0-9a-f]{{8}}{re.escape(_PARTIAL)}((?:\.[^.]+)?)")


@contextmanager
def os_errors_as_shot_error(path: Path | str, action: str = "read", hint: str = "") -> Iterator[None]:
    """Replace an OSError of the block by a ShotError: "`path`: cannot be read (reason)"."""
    try:
        yield
    except ShotError:
        raise
    except OSError as error:
        if isinstance(error, FileExistsError | NotADirectoryError):
            hint = "A file has the name of the folder."
        raise ShotError(path, f"cannot be {action} ({error})", hint) from error


def partial_name(path: Path, run: str = "") -> Path:
    """Return a temporary name beside `path`; `run` is eight hexadecimal digits, by default random."""
    return path.with_name(f".{path.stem}.{run or secrets.token_hex(4)}{_PARTIAL}{path.suffix}")


@contextmanager
def replacing(path: Path | str) -> Iterator[Path]:
    """Yield a temporary name beside `path`; rename it to `path` at the end, or remove it after an error."""
    path = Path(path)
    partial = partial_name(path)
    try:
        with os_errors_as_shot_error(path, "written", NO_ROOM):
            path.parent.mkdir(parents=True, exist_ok=True)
            yield partial
            partial.replace(path)
    finally:
        with suppress(OSError):  # the error of the block matters more
            partial.unlink(missing_ok=True)


def write_text(path: Path, text: str) -> None:
    """Write a UTF-8 text file atomically, without conversion of line ends; ShotError if the disk refuses.

    Surrogate escapes, which stand for undecodable bytes of paths, are written as these bytes.
    """
    write_bytes(path, text.encode(errors="surrogateescape"))


def write_bytes(path: Path, data: bytes) -> None:
    """Write a file atomically; ShotError if the disk refuses."""
    with replacing(path) as partial:
        partial.write_bytes(data)


def rename_partial(partial: Path, path: Path) -> None:
    """Rename a temporary file to its final name; ShotError if it is not a file, or the disk refuses."""
    if not is_regular(partial):
        raise ShotError(path, "was not written: its temporary file is missing, or a link", NO_ROOM)
    with os_errors_as_shot_error(path, "written", NO_ROOM):
        partial.replace(path)


class FolderLock:
    """Lock of a folder that a run writes to, for a block; it ends with the process.

    `is_shared` locks may be held together, by runs that write different files. Nothing is locked on Windows,
    where the file system has no such locks. A folder that does not exist is locked by `take_new`.

    Raises:
        ShotError: another run holds the folder.
    """

    def __init__(self, folder: Path, *, is_shared: bool = False) -> None:
        self._folder, self._is_shared = folder, is_shared
        self._held: int | None = None

    def __enter__(self) -> Self:
        if is_folder(self._folder):
            self._take()
        return self

    def __exit__(self, *_: object) -> None:
        if self._held is not None:
            os.close(self._held)
            self._held = None

    def take_new(self) -> bool:
        """Make and lock the folder if it did not exist when the block began; return whether it did not.

        Another run may have begun in it since: what was read of the folder has to be read again.
        """
        if self._held is not None:
            return False
        with os_errors_as_shot_error(self._folder, "written", NO_ROOM):
            self._folder.mkdir(parents=True, exist_ok=True)
        self._take()
        return self._held is not None

    def _take(self) -> None:
        if fcntl is None:
            return
        with os_errors_as_shot_error(self._folder):
            self._held = os.open(self._folder, os.O_RDONLY)
        _LOCKS.add(self)
        try:
            fcntl.flock(self._held, fcntl.LOCK_NB | (fcntl.LOCK_SH if self._is_shared else fcntl.LOCK_EX))
        except BlockingIOError:
            self.__exit__()
            hint = "Wait for it, stop it, or choose another folder."
            raise ShotError(self._folder, "another run writes to it", hint) from None
        except OSError:  # of a network drive
            return


_LOCKS: "weakref.WeakSet[FolderLock]" = weakref.WeakSet()


def _leave_to_parent() -> None:
    """Close the locks in a forked child, which may outlive its parent; the parent keeps them."""
    for lock in _LOCKS:
        lock.__exit__()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_leave_to_parent)


class LogFile:
    """Log of another program's output, replaced by each run.

    The first line is `mark`. A file that begins with another line is never replaced: ShotError.
    """

    def __init__(self, path: Path, mark: str) -> None:
        self.path, self._room = path, _LOG_BYTES
        first = f"{mark}\n".encode()
        check_ours(path, lambda found: _first_bytes(found, len(first)) == first, "a log of this command")
        remove_files([path])
        with os_errors_as_shot_error(path, "written", NO_ROOM):
            self._file = FileIO(path, "x")  # fails if anything has this name, a link included
            self._file.write(first)

    def write(self, line: str) -> None:
        """Append a line, without control characters; lines beyond 16 MiB or after `close` are dropped."""
        data = f"{printable(line)}\n".encode(errors="replace")
        self._room -= len(data)
        if self._room > 0 and not self._file.closed:
            with suppress(OSError):  # an error of the log must not end the run
                self._file.write(data)

    def close(self) -> None:
        """Close the file."""
        self._file.close()


def remove_partial_files(folder: Path, is_own: Callable[[str], object], below: Iterable[str] = ()) -> None:
    """Remove the temporary files of killed runs whose final names `is_own` accepts.

    Only regular files with names of `partial_name` are removed: in `folder`, which may be a link, and in its
    subfolders `below`, which may not.
    """
    root = Path(os.path.realpath(folder))
    for place in (root, *(root / name for name in below if name)):
        if not is_folder(place) or os.path.realpath(place) != str(place):
            continue
        for path in place.iterdir():
            found = _PARTIAL_NAME.fullmatch(path.name)
            if found and is_own(found[1] + found[2]) and is_regular(path):
                remove_files([path])


def check_ours(path: Path, is_ours: Callable[[Path], bool], what: str) -> None:
    """Raise ShotError if the path is that of a file of something else, or lies below a file.

    `is_ours` decides by the content; `what` describes the expected file: "a record of `bench ... --json`".
    """
    if folder := next(filter(is_file, path.parents), None):
        raise ShotError(path, f"cannot be written: {folder} is not a folder", "Choose another name.")
    if is_there(path) and not (is_regular(path) and is_ours(path)):
        hint = "Move it away, or choose another name."
        raise ShotError(path, f"already exists, and is not {what}", hint)


def remove_files(paths: Iterable[Path]) -> None:
    """Remove files that exist; ShotError if the disk refuses."""
    for path in paths:
        with os_errors_as_shot_error(path, "removed", "Is it in use or write-protected?"):
            path.unlink(missing_ok=True)


def utf8_path(path: Path | str) -> str:
    """Return a path for a library that expects UTF-8 in any locale; ShotError if it is not UTF-8."""
    try:
        return os.fsencode(path).decode()
    except UnicodeDecodeError:
        hint = "Rename it, and the folders above it."
        raise ShotError(path, "has a name that is not UTF-8", hint) from None


def is_file(path: Path) -> bool:
    """Return whether the path is a regular file or a link to one; unlike `Path.is_file`, never raises."""
    return os.path.isfile(path)  # noqa: PTH113


def is_folder(path: Path) -> bool:
    """Return whether a folder, or a link to one, has the name; False where `Path.is_dir` raises."""
    return os.path.isdir(path)  # noqa: PTH112


def is_regular(path: Path) -> bool:
    """Return whether the path is a regular file, not a link."""
    return is_file(path) and not path.is_symlink()


def is_own_folder(path: Path) -> bool:
    """Return whether the path is a folder, not a link."""
    return is_folder(path) and not path.is_symlink()


def check_is_file(path: Path) -> None:
    """Raise ShotError unless the path is a regular file or a link to one: reading a pipe may never end."""
    if not is_there(path):
        raise ShotError(path, "there is no such file", NOT_FOUND)
    if not is_file(path):
        raise ShotError(path, "is not a regular file")


def is_there(path: Path) -> bool:
    """Return whether anything has this name: a file, a folder, a broken link."""
    return os.path.lexists(path)


def check_apart(output: Path, source: Path) -> None:
    """Raise ShotError if `output` is `source`, contains it or lies in it, links followed."""
    hint = "Choose another folder for the output."
    holds = _lies_in(source, output)
    if _lies_in(output, source):
        raise ShotError(output, f"{'is' if holds else 'lies in'} the input, {source}", hint)
    if holds:
        raise ShotError(output, f"holds the input, {source}", hint)


def check_inside(folder: Path, paths: Iterable[Path], remedy: str = "") -> None:
    """Raise ShotError if a path leads out of `folder`, by a link or by `..`; `folder` may be a link.

    `remedy` is another one than to copy the file.
    """
    root, real_folders = os.path.realpath(folder), dict[Path, str]()
    for path in paths:
        if path.parent not in real_folders:
            real_folders[path.parent] = os.path.realpath(path.parent)
        real = os.path.realpath(path) if os.path.islink(path) else real_folders[path.parent]  # noqa: PTH114
        if not Path(real).is_relative_to(root):
            hint = "Copy the file into the folder; links and names that leave it are not followed."
            raise ShotError(path, f"leads out of {folder}", f"{hint} {remedy}".rstrip())


def _first_bytes(path: Path, count: int) -> bytes:
    with suppress(OSError), path.open("rb") as file:
        return file.read(count)
    return b""


def _lies_in(path: Path, folder: Path) -> bool:
    """Return whether `path` is `folder` or lies in it, links followed; False if `folder` does not exist."""
    real = Path(os.path.realpath(path))
    for place in (real, *real.parents):
        with suppress(OSError, ValueError):  # one of the two does not exist
            if place.samefile(folder):
                return True
    return False
