"""Atomic writes: a file appears under its name only when it is complete.

It is written beside it under a temporary name (`.name.partial.exr`), then renamed, so that a run killed at
any point leaves no half-written file.
"""

import secrets
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from supersampler.errors import ShotError

NO_ROOM = "Is the disk full or write-protected?"
_PARTIAL = ".partial"


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


def remove_partial_files(folder: Path) -> None:
    """Remove what killed runs left under temporary names in `folder` and below."""
    for path in folder.rglob(f".*{_PARTIAL}.*"):
        path.unlink(missing_ok=True)
