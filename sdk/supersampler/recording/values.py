"""JSON values of a stranger's record, each of the type and range that writers write."""

import reprlib
from collections.abc import Collection, Mapping
from typing import Any


def text(value: Any, known: Collection[str] = ()) -> str:
    """Return a string, one of those that are known where there are any.

    Raises:
        ValueError: it is none.
    """
    if not isinstance(value, str) or (known and value not in known):
        raise _wrong(value, f"one of {', '.join(known)}" if known else "text")
    return value


def texts(value: Any, most: int) -> tuple[str, ...]:
    """Return a list of strings, at most so many.

    Raises:
        ValueError: it is none.
    """
    if not isinstance(value, list) or len(value) > most:
        raise _wrong(value, f"a list of at most {most} texts")
    return tuple(map(text, value))


def whole(value: Any, least: int, most: int) -> int:
    """Return a whole number of a range.

    Raises:
        ValueError: it is none.
    """
    if type(value) is not int or not least <= value <= most:
        raise _wrong(value, f"a whole number from {least} to {most}")
    return value


def number(value: Any, least: float, most: float) -> float:
    """Return a number of a range.

    Raises:
        ValueError: it is none.
    """
    if type(value) not in (int, float) or not least <= value <= most:
        raise _wrong(value, f"a number from {least:g} to {most:g}")
    return float(value)


def flag(value: Any) -> bool:
    """Return True or False.

    Raises:
        ValueError: it is neither.
    """
    if not isinstance(value, bool):
        raise _wrong(value, "true or false")
    return value


def members(value: Any) -> Mapping[str, Any]:
    """Return an object's members.

    Raises:
        ValueError: it is no object.
    """
    if not isinstance(value, dict):
        raise _wrong(value, "an object {...}")
    return value


def _wrong(value: Any, want: str) -> ValueError:
    return ValueError(f"{reprlib.repr(value)}; want {want}")
