"""Checked access to the values of a JSON file; errors name the file, the place and the wanted value."""

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

    def __getitem__(self, name: str) -> "Field":
        """A required member of an object."""
        member = self.optional(name)
        if member is None:
            raise self._error(self.path, f"{self.place} has no {name!r}")
        return member

    def optional(self, name: str) -> "Field | None":
        """An optional member of an object; None where it is missing or null."""
        if not isinstance(self.value, dict):
            self.refuse("an object {...}")
        place = name if self.place == "the file" else f"{self.place}.{name}"
        value = self.value.get(name)
        return None if value is None else Field(self.path, place, value, self._error)

    def read(self, name: str, read: "Callable[[Field], _Value]", default: _Default) -> _Value | _Default:
        """The result of `read` on a member; `default` where it is missing or null."""
        member = self.optional(name)
        return default if member is None else read(member)

    def check_names(self, known: Collection[str]) -> None:
        """Refuse members with other names: they are misspelt, or of a later version."""
        for name in self.members():
            if name not in known:
                raise self._error(self.path, f"{self.place} has the unknown key {reprlib.repr(name)}")

    def members(self, most: int | None = None) -> dict[str, "Field"]:
        """Members of an object, at most `most`; with a limit, names must be printable."""
        if not isinstance(self.value, dict) or (most is not None and len(self.value) > most):
            self.refuse("an object {...}" + ("" if most is None else f" of at most {most} members"))
        for name in self.value if most is not None else ():
            Field(self.path, f"a name in {self.place}", name, self._error).text()
        place = "" if self.place == "the file" else f"{self.place}."
        return {n: Field(self.path, f"{place}{n}", v, self._error) for n, v in self.value.items()}

    def items(self, most: int) -> Iterator["Field"]:
        """Items of a list, at most `most`."""
        if not isinstance(self.value, list) or len(self.value) > most:
            self.refuse(f"a list of at most {most} items")
        for index, item in enumerate(self.value):
            yield Field(self.path, f"{self.place}[{index}]", item, self._error)

    def of(self, kind: type[_Value]) -> _Value:
        """A value of exactly this type: True is not an int."""
        if not isinstance(self.value, kind) or type(self.value) is not kind:
            self.refuse(kind.__name__)
        return self.value

    def text(self, most: int = 4096) -> str:
        """Printable text of 1 to `most` characters."""
        text = self.value
        if not isinstance(text, str) or not 1 <= len(text) <= most or not text.isprintable():
            self.refuse(f"printable text of 1 to {most} characters")
        return text

    def whole(self, least: int, most: int) -> int:
        """An integer from `least` to `most`."""
        if type(self.value) is not int or not least <= self.value <= most:
            self.refuse(f"a whole number from {least} to {most}")
        return self.value

    def number(self, least: float = -_MAX_FLOAT, most: float = _MAX_FLOAT) -> float:
        """A number from `least` to `most`; an int stays an int."""
        if type(self.value) not in (int, float) or not least <= self.value <= most:
            self.refuse("a number" if most == _MAX_FLOAT else f"a number from {least:g} to {most:g}")
        return self.value  # type: ignore[no-any-return]

    def rate(self) -> float:
        """A frame rate: frames a second, > 0."""
        rate = float(self.number())
        if rate <= 0:
            self.refuse("frames a second, > 0")
        return rate

    def flag(self) -> bool:
        """True or false."""
        if not isinstance(self.value, bool):
            self.refuse("true or false")
        return self.value

    def one_of(self, *choices: str) -> str:
        """One of these words."""
        if self.value not in choices:
            self.refuse(f"one of {', '.join(choices)}")
        return str(self.value)

    def texts(self) -> tuple[str, ...]:
        """A list of strings."""
        if not isinstance(self.value, list) or not all(isinstance(text, str) for text in self.value):
            self.refuse("a list of texts")
        return tuple(self.value)

    def pair(self) -> tuple[float, float]:
        """Two numbers, [x, y]."""
        if not isinstance(self.value, list) or len(self.value) != 2:
            self.refuse("[x, y]")
        x, y = (float(item.number()) for item in self.items(2))
        return x, y

    def size(self) -> Size:
        """[width, height], both > 0 and within `limits`."""
        value = self.value
        if not isinstance(value, list) or len(value) != 2 or not all(type(n) is int and n > 0 for n in value):
            self.refuse("[width, height], both > 0")
        if image_size_problem(*value) is not None:
            self.refuse(f"[width, height], each at most {IMAGE_SIDE} and {IMAGE_PIXELS} pixels together")
        return value[0], value[1]


def read_json(path: Path, most: int | None = None) -> Any:  # JSON is anything
    """Return the content of a JSON file.

    Raises:
        ShotError: it is missing, cannot be read, is not JSON, or is larger than `most` bytes
            (`limits.JSON_BYTES` where None).
    """
    most = JSON_BYTES if most is None else most
    try:
        with os_errors_as_shot_error(path):
            check_is_file(path)
            with path.open("rb") as file:
                text = file.read(most + 1)
            if len(text) > most:
                raise ShotError(path, f"is larger than {most >> 20} MiB", "Is it the right file?")
        return parse_json(text)
    except (ValueError, RecursionError) as error:
        raise ShotError(path, f"is not JSON ({error})", "Mend it there, or write it again.") from error


def parse_json(text: bytes) -> Any:
    """Return the content of a JSON text.

    Raises:
        ValueError, RecursionError: it is not JSON, a number is not finite, or it is nested too deeply.
    """
    return json.loads(text, parse_constant=_finite, parse_float=_finite)


def read_fields(path: Path, most: int) -> Field:
    """Read a model.json of at most `most` bytes; ModelError where it is missing, larger or not JSON."""
    try:
        value = read_json(path, most)
        json.dumps(value, ensure_ascii=False).encode()  # refuses lone surrogates
    except (ShotError, UnicodeEncodeError, RecursionError) as error:
        problem = getattr(error, "problem", f"is not JSON ({error})")
        raise ModelError(f"{path}: {problem}. Copy the whole folder again.") from error
    return Field(path, "the file", value, _model_error)


def _model_error(path: Path, problem: str) -> ModelError:
    return ModelError(f"{path}: {problem}. Export the model again; docs/contract.md lists what it has.")


def _finite(text: str) -> float:
    number = float(text)
    if not math.isfinite(number):
        raise ValueError(f"{text[:20]} is not finite")
    return number
