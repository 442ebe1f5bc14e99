"""Take a JSON file apart key by key, with errors that name the file, the object and the key."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

from supersampler.errors import ShotError
from supersampler.frame import Size
from supersampler.io.limits import IMAGE_PIXELS, IMAGE_SIDE, JSON_BYTES, image_size_problem

_Value = TypeVar("_Value")


def read_json(path: Path) -> Any:  # JSON is anything
    """Return the content of a JSON file.

    Raises:
        ShotError: it is missing, cannot be read, is not JSON, or is larger than `limits.JSON_BYTES`.
    """
    try:
        if path.exists() and not path.is_file():  # a pipe, say, which never ends
            raise ShotError(path, "is no regular file")
        with path.open("rb") as file:
            text = file.read(JSON_BYTES + 1)
        if len(text) > JSON_BYTES:
            raise ShotError(path, f"is larger than {JSON_BYTES >> 20} MiB", "Is it the right file?")
        return json.loads(text)
    except ShotError:
        raise
    except FileNotFoundError:
        raise ShotError(path, "there is no such file", "Is the path right, is the drive connected?") from None
    except (ValueError, RecursionError) as error:  # of json, of the text's encoding, and of nested lists
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
            value = self._float(key, value)
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
        return self._float(key, value[0]), self._float(key, value[1])

    def take_size(self, key: str) -> Size:
        """Return [width, height], both > 0 and within `limits`."""
        value = self.take(key, list)
        if len(value) != 2 or not all(type(number) is int and number > 0 for number in value):
            raise self.wrong(key, value, "[width, height], both > 0")
        if image_size_problem(*value) is not None:
            want = f"[width, height], each at most {IMAGE_SIDE} and {IMAGE_PIXELS} pixels together"
            raise self.wrong(key, value, want)
        return value[0], value[1]

    def take_texts(self, key: str) -> tuple[str, ...]:
        """Return a list of strings; an empty one where the key is missing."""
        value = self.take_or(key, list, [])
        if not all(isinstance(text, str) for text in value):
            raise self.wrong(key, value, "a list of strings")
        return tuple(value)

    def _float(self, key: str, value: int | float) -> float:
        try:
            return float(value)
        except OverflowError:
            raise self.wrong(key, value, "a number that a float can hold") from None

    def wrong(self, key: str, value: object, want: str) -> ShotError:
        """Return the error for a value that will not do."""
        return ShotError(self.path, f'"{key}" of {self.where} is {_short(value)}; want {want}')

    def check_no_more(self) -> None:
        """Raise where keys are left: they are misspelled, or of a later version."""
        if self._left:
            hint = "docs/shots.md lists the keys."
            raise ShotError(self.path, f'{self.where} has the unknown key "{next(iter(self._left))}"', hint)


def _short(value: object) -> str:
    try:
        text = json.dumps(value)  # ASCII: a stranger's text has no say over the terminal
    except RecursionError:
        return "nested too deeply"
    return text if len(text) <= 60 else f"{text[:57]}..."
