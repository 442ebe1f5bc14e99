"""Take a JSON file apart key by key, with errors that name the file, the object and the key."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

from supersampler.errors import ShotError
from supersampler.frame import Size

_Value = TypeVar("_Value")


def read_json(path: Path) -> Any:  # JSON is anything
    """Return the content of a JSON file.

    Raises:
        ShotError: it is missing, cannot be read, or is not JSON.
    """
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise ShotError(path, "there is no such file", "Is the path right, is the drive connected?") from None
    except ValueError as error:  # of json and of the text's encoding
        raise ShotError(path, f"is not JSON ({error})", "Mend it there, or write it again.") from error
    except OSError as error:
        raise ShotError(path, f"cannot be read ({error})") from error


class JsonKeys:
    """The keys of one JSON object, taken one by one; null counts as missing."""

    def __init__(self, path: Path, where: str, content: object) -> None:
        self.path, self.where = path, where
        if not isinstance(content, Mapping):
            raise ShotError(path, f"{where} is {_short(content)}; want an object {{...}}")
        self._left: dict[str, Any] = {key: value for key, value in content.items() if value is not None}

    def __contains__(self, key: str) -> bool:
        return key in self._left

    def take(self, key: str, kind: type[_Value]) -> _Value:
        """Return the value of a key that must be there; an integer serves as a float."""
        if key not in self._left:
            raise ShotError(self.path, f'{self.where} has no "{key}"', "docs/shots.md lists the keys.")
        value = self._left.pop(key)
        if kind is float and type(value) is int:
            value = float(value)
        if not isinstance(value, kind) or type(value) is not kind:  # True is an int, and is not meant as one
            raise self.wrong(key, value, kind.__name__)
        return value

    def take_or(self, key: str, kind: type[_Value], default: _Value) -> _Value:
        """Return the value of a key, or `default` where it is missing."""
        return self.take(key, kind) if key in self else default

    def take_pair(self, key: str) -> tuple[float, float]:
        """Return [x, y]."""
        value = self.take(key, list)
        if len(value) != 2 or not all(type(number) in (int, float) for number in value):
            raise self.wrong(key, value, "[x, y]")
        return float(value[0]), float(value[1])

    def take_size(self, key: str) -> Size:
        """Return [width, height], both > 0."""
        value = self.take(key, list)
        if len(value) != 2 or not all(type(number) is int and number > 0 for number in value):
            raise self.wrong(key, value, "[width, height], both > 0")
        return value[0], value[1]

    def take_texts(self, key: str) -> tuple[str, ...]:
        """Return a list of strings; an empty one where the key is missing."""
        value = self.take_or(key, list, [])
        if not all(isinstance(text, str) for text in value):
            raise self.wrong(key, value, "a list of strings")
        return tuple(value)

    def wrong(self, key: str, value: object, want: str) -> ShotError:
        """Return the error for a value that will not do."""
        return ShotError(self.path, f'"{key}" of {self.where} is {_short(value)}; want {want}')

    def check_no_more(self) -> None:
        """Raise where keys are left: they are misspelled, or of a later version."""
        if self._left:
            hint = "docs/shots.md lists the keys."
            raise ShotError(self.path, f'{self.where} has the unknown key "{next(iter(self._left))}"', hint)


def _short(value: object) -> str:
    text = json.dumps(value, ensure_ascii=False)
    return text if len(text) <= 60 else f"{text[:57]}..."
