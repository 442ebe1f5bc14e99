"""A JSON file of a stranger, taken apart value by value: errors name file, place, value and expectation."""

import json
import math
import reprlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NoReturn

from supersampler.errors import ModelError


class Field:
    """A value of a JSON file, and where it is: `history[2].shape`."""

    def __init__(self, path: Path, place: str, value: Any) -> None:
        self.path, self.place, self.value = path, place, value

    def refuse(self, want: str) -> NoReturn:
        """Raise ModelError: it is not what is wanted."""
        got = reprlib.repr(self.value)
        raise ModelError(f"{self.path}: {self.place} is {got}; want {want}. Export the model again.")

    def __getitem__(self, name: str) -> "Field":
        """A member that must be there."""
        member = self.optional(name)
        if member is None:
            raise ModelError(
                f"{self.path}: {self.place} has no {name!r}; docs/contract.md lists what it has. "
                "Export the model again."
            )
        return member

    def optional(self, name: str) -> "Field | None":
        """A member; None where there is none."""
        if not isinstance(self.value, dict):
            self.refuse("an object {...}")
        place = name if self.place == "the file" else f"{self.place}.{name}"
        return Field(self.path, place, self.value[name]) if name in self.value else None

    def members(self, most: int) -> dict[str, "Field"]:
        """Members of an object that is a mapping, at most so many, by names in plain letters."""
        if not isinstance(self.value, dict) or len(self.value) > most:
            self.refuse(f"an object {{...}} of at most {most} members")
        for name in self.value:
            Field(self.path, f"a name in {self.place}", name).text()
        return {name: self[name] for name in self.value}

    def items(self, most: int) -> Iterator["Field"]:
        """Items of a list, at most so many."""
        if not isinstance(self.value, list) or len(self.value) > most:
            self.refuse(f"a list of at most {most} items")
        for index, item in enumerate(self.value):
            yield Field(self.path, f"{self.place}[{index}]", item)

    def text(self, most: int = 4096) -> str:
        """Printable text; at least a character."""
        if (
            not isinstance(self.value, str)
            or not 1 <= len(self.value) <= most
            or not self.value.isprintable()
        ):
            self.refuse(f"printable text of 1 to {most} characters")
        return self.value

    def whole(self, least: int, most: int) -> int:
        """A whole number."""
        if type(self.value) is not int or not least <= self.value <= most:
            self.refuse(f"a whole number from {least} to {most}")
        return self.value

    def number(self, least: float, most: float) -> float:
        """A number."""
        if type(self.value) not in (int, float) or not least <= self.value <= most:
            self.refuse(f"a number from {least:g} to {most:g}")
        return self.value  # type: ignore[no-any-return]  # as it was written

    def flag(self) -> bool:
        """True or false."""
        if not isinstance(self.value, bool):
            self.refuse("true or false")
        return self.value


def read_fields(path: Path, most: int) -> Field:
    """Read a JSON file of at most so many bytes.

    Raises:
        ModelError: it is missing or larger, or not JSON.
    """
    try:
        if not path.is_file():  # what else there is may have no end
            raise ModelError(f"{path}: there is no such file. Copy the whole folder again.")
        with path.open("rb") as file:
            content = file.read(most + 1)
        if len(content) > most:
            raise ModelError(f"{path}: is larger than {most} bytes; no model description is. Copy it again.")
        value = json.loads(content.decode(), parse_constant=_finite, parse_float=_finite)
        json.dumps(value, ensure_ascii=False).encode()  # halves of characters, which no text can be made of
        return Field(path, "the file", value)
    except (OSError, ValueError, RecursionError) as error:
        if isinstance(error, ModelError):
            raise
        raise ModelError(f"{path}: not a model description ({type(error).__name__}: {error})") from error


def _finite(text: str) -> float:
    number = float(text)
    if not math.isfinite(number):
        raise ValueError(f"{text[:20]} is not finite")
    return number
