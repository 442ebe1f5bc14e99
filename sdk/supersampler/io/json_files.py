"""Read JSON files from users: their size is limited, and msgspec checks them against a type."""

import codecs
import re
import reprlib
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Any, TypeAlias, TypeVar

import msgspec

from supersampler.arguments import MAX_SIDE
from supersampler.errors import ShotError
from supersampler.io.files import JSON_BYTES, check_is_file, image_size_problem, os_errors_as_shot_error

_Value = TypeVar("_Value")
Text: TypeAlias = Annotated[str, msgspec.Meta(min_length=1, max_length=4096)]
"""Text to display."""
Rate: TypeAlias = Annotated[float, msgspec.Meta(gt=0.0)]
"""Frames per second."""
_Side = Annotated[int, msgspec.Meta(ge=1, le=MAX_SIDE)]
FileSize: TypeAlias = tuple[_Side, _Side]
"""[width, height]; a Struct with such a field calls `check_sizes`."""
_HINT = "Correct it there, or write it again."


def check_sizes(*sizes: FileSize | None) -> None:
    """Raise ValueError, which msgspec turns into a ValidationError, if an image has too many pixels."""
    for size in filter(None, sizes):
        if (problem := image_size_problem(*size)) is not None:
            raise ValueError(f"a size {problem}")


def read_json(path: Path, limit: int = JSON_BYTES) -> Any:  # JSON is anything
    """Return the content of a JSON file; see `read_typed` for errors."""
    return read_typed(path, Any, limit=limit)


def read_typed(path: Path, kind: type[_Value], hint: str = _HINT, limit: int = JSON_BYTES) -> _Value:
    """Return the content of a JSON file, converted to a type that msgspec knows.

    Raises:
        ShotError: it is missing, cannot be read, is larger than `limit` bytes, is not JSON, or is of another
            type. The message has the place, the value, the expected type, and the hint.
    """
    with os_errors_as_shot_error(path):
        check_is_file(path)
        with path.open("rb") as file:
            text = file.read(limit + 1)
    if len(text) > limit:
        raise ShotError(path, f"is larger than {limit >> 20} MiB", "Is it the right file?")
    return decoded(path, text.removeprefix(codecs.BOM_UTF8), kind, hint)  # of Windows' editors


def check_version(path: Path, known: int, hint: str, key: str = "version") -> None:
    """Raise ShotError unless a JSON file has the version, under `key`, that this package reads."""
    found = getattr(read_typed(path, msgspec.defstruct("Version", [(key, int)]), hint), key)
    if found != known:
        raise ShotError(path, f"is of {key} {found}; this package reads {known}", hint)


def decoded(path: Path, text: bytes | str, kind: type[_Value], hint: str = _HINT) -> _Value:
    """Return JSON text converted to a type; ShotError, which names the file, if it is of another type."""
    try:
        return msgspec.json.decode(text, type=kind)
    except msgspec.ValidationError as error:
        raise ShotError(path, f"is not as expected: {error}{_given(text, str(error))}", hint) from error
    except (msgspec.DecodeError, UnicodeError, RecursionError) as error:
        raise ShotError(path, f"is not JSON ({error})", hint) from error


def _given(text: bytes | str, message: str) -> str:
    """Return ", is VALUE" for the place in a message of msgspec; "" if there is none."""
    place = re.search(r"at `\$([^`]*)`$", message)
    with suppress(LookupError, TypeError, msgspec.DecodeError, RecursionError):
        if place and "[...]" not in place[1]:
            value = msgspec.json.decode(text)
            for key, index in re.findall(r"\.(\w+)|\[(\d+)\]", place[1]):
                value = value[key or int(index)]
            return f", is {reprlib.repr(value)}"
    return ""
