"""Checked access to the values of a JSON file; errors name the file, the place and the expected value."""

import json
import math
import reprlib
from collections.abc import Callable, Collection, Iterator
from functools import partial
from pathlib import Path
from typing import Any, NoReturn, TypeVar

from supersampler.errors import ModelError, ShotError
from supersampler.frame import Size
from supersampler.io.files import (
    IMAGE_PIXELS,
    IMAGE_SIDE,
    JSON_BYTES,
    check_is_file,
    image_size_problem,
    os_errors_as_shot_error,
)

_Value = TypeVar("_Value")
_Default = TypeVar("_Default")
_MAX_FLOAT = 1e308


class Field:
    """A value in a JSON file, with its place for messages, such as `history[2].shape`.

    Args:
        path: the file.
        place: place of the value; "the file" for its whole content.
        value: the parsed value.
        error: makes the error to raise from the file and the problem; a ShotError where None.
    """

    def __init__(
        self, path: Path, place: str, value: Any, error: Callable[[Path, str], Exception] | None = None
    ) -> None:
        self.path, self.place, self.value = path, place, value
        self._error = error or partial(ShotError, hint="docs/shots.md lists the keys.")

    def refuse(self, want: str) -> NoReturn:
        """Raise the error that the value is not `want`."""
        raise self._error(self.path, f"{self.place} is {reprlib.repr(self.value)}; want {want}")

    def _check(self, valid: bool, want: str) -> None:
        if not valid:
            self.refuse(want)

    def _inner(self, place: str, value: Any) -> "Field":
        return Field(self.path, place, value, self._error)

    def __getitem__(self, name: str) -> "Field":
        """Return a required member of an object."""
        member = self.optional(name)
        if member is None:
            raise self._error(self.path, f"{self.place} has no {name!r}")
        return member

    def optional(self, name: str) -> "Field | None":
        """Return a member of an object; None where it is missing or null."""
        self._check(isinstance(self.value, dict), "an object {...}")
        value = self.value.get(name)
        return None if value is None else self._inner(self._place_of(name), value)

    def _place_of(self, name: str) -> str:
        return name if self.place == "the file" else f"{self.place}.{name}"

    def read(self, name: str, read: "Callable[[Field], _Value]", default: _Default) -> _Value | _Default:
        """Return the result of `read` on a member; `default` where it is missing or null."""
        member = self.optional(name)
        return default if member is None else read(member)

    def check_names(self, known: Collection[str]) -> None:
        """Refuse members with other names: they are misspelt, or of a later version."""
        for name in self.members():
            if name not in known:
                raise self._error(self.path, f"{self.place} has the unknown key {reprlib.repr(name)}")

    def members(self, limit: int | None = None) -> dict[str, "Field"]:
        """Return the members of an object, at most `limit`; with a limit, names must be printable."""
        self._check(isinstance(self.value, dict), "an object {...}")
        if limit is not None:
            self._check(len(self.value) <= limit, f"an object {{...}} of at most {limit} members")
            for name in self.value:
                self._inner(f"a name in {self.place}", name).text()
        return {name: self._inner(self._place_of(name), value) for name, value in self.value.items()}

    def items(self, limit: int) -> Iterator["Field"]:
        """Yield the items of a list of at most `limit`."""
        self._check(
            isinstance(self.value, list) and len(self.value) <= limit, f"a list of at most {limit} items"
        )
        for index, item in enumerate(self.value):
            yield self._inner(f"{self.place}[{index}]", item)

    def of(self, kind: type[_Value]) -> _Value:
        """Return a value of exactly this type: True is not an int."""
        if not isinstance(self.value, kind) or type(self.value) is not kind:
            self.refuse(kind.__name__)
        return self.value

    def text(self, limit: int = 4096) -> str:
        """Return printable text of 1 to `limit` characters."""
        text = self.value
        valid = isinstance(text, str) and 1 <= len(text) <= limit and text.isprintable()
        self._check(valid, f"printable text of 1 to {limit} characters")
        return str(text)

    def whole(self, low: int, high: int) -> int:
        """Return an integer from `low` to `high`."""
        self._check(
            type(self.value) is int and low <= self.value <= high, f"a whole number from {low} to {high}"
        )
        return int(self.value)

    def number(self, low: float = -_MAX_FLOAT, high: float = _MAX_FLOAT) -> float:
        """Return a number from `low` to `high`; an int stays an int."""
        value: float = self.value
        want = "a number" if high == _MAX_FLOAT else f"a number from {low:g} to {high:g}"
        self._check(type(value) in (int, float) and low <= value <= high, want)
        return value

    def rate(self) -> float:
        """Return a frame rate: frames a second, > 0."""
        rate = float(self.number())
        self._check(rate > 0, "frames a second, > 0")
        return rate

    def flag(self) -> bool:
        """Return true or false."""
        self._check(isinstance(self.value, bool), "true or false")
        return bool(self.value)

    def one_of(self, *choices: str) -> str:
        """Return one of these words."""
        self._check(self.value in choices, f"one of {', '.join(choices)}")
        return str(self.value)

    def texts(self) -> tuple[str, ...]:
        """Return a list of strings."""
        valid = isinstance(self.value, list) and all(isinstance(text, str) for text in self.value)
        self._check(valid, "a list of texts")
        return tuple(self.value)

    def pair(self) -> tuple[float, float]:
        """Return two numbers, [x, y]."""
        self._check(isinstance(self.value, list) and len(self.value) == 2, "[x, y]")
        x, y = (float(item.number()) for item in self.items(2))
        return x, y

    def size(self) -> Size:
        """Return [width, height], both > 0 and within the limits of images."""
        size = self.value
        valid = isinstance(size, list) and len(size) == 2 and all(type(n) is int and n > 0 for n in size)
        self._check(valid, "[width, height], both > 0")
        want = f"[width, height], each at most {IMAGE_SIDE} and {IMAGE_PIXELS} pixels together"
        self._check(image_size_problem(*size) is None, want)
        return size[0], size[1]


def read_json(path: Path, limit: int | None = None) -> Any:  # JSON is anything
    """Return the content of a JSON file.

    Raises:
        ShotError: it is missing, cannot be read, is not JSON, or is larger than `limit` (JSON_BYTES) bytes.
    """
    limit = JSON_BYTES if limit is None else limit
    try:
        with os_errors_as_shot_error(path):
            check_is_file(path)
            with path.open("rb") as file:
                text = file.read(limit + 1)
            if len(text) > limit:
                raise ShotError(path, f"is larger than {limit >> 20} MiB", "Is it the right file?")
        return parse_json(text)
    except (ValueError, RecursionError) as error:
        raise ShotError(path, f"is not JSON ({error})", "Correct it there, or write it again.") from error


def parse_json(text: bytes) -> Any:
    """Return the content of a JSON text.

    Raises:
        ValueError, RecursionError: it is not JSON, a number is not finite, or it is nested too deeply.
    """

    def finite(number: str) -> float:
        if not math.isfinite(float(number)):
            raise ValueError(f"{number[:20]} is not finite")
        return float(number)

    return json.loads(text, parse_constant=finite, parse_float=finite)


def read_fields(path: Path, limit: int) -> Field:
    """Read a model.json of at most `limit` bytes; ModelError where it is missing, larger or not JSON."""
    try:
        value = read_json(path, limit)
        json.dumps(value, ensure_ascii=False).encode()  # refuses lone surrogates
    except (ShotError, UnicodeEncodeError, RecursionError) as error:
        problem = getattr(error, "problem", f"is not JSON ({error})")
        raise ModelError(f"{path}: {problem}. Copy the whole folder again.") from error
    hint = "Export the model again; docs/contract.md lists the keys."
    return Field(path, "the file", value, lambda file, problem: ModelError(f"{file}: {problem}. {hint}"))
