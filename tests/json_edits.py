"""Edits of JSON, for tests of files that were tampered with."""

import json
from collections.abc import Sequence
from typing import Any

GONE = object()
"""In place of a value: there is none."""


def edited(content: Any, path: Sequence[str | int], value: Any) -> bytes:
    """Return JSON with another value at a place; a text says which item of a list by its name."""
    copy = json.loads(json.dumps(content))
    inner, keys = copy, list(path)
    for index, key in enumerate(keys):
        if isinstance(inner, list) and isinstance(key, str):
            keys[index] = [item["name"] for item in inner].index(key)
        if index < len(keys) - 1:
            inner = inner[keys[index]]
    if value is GONE:
        del inner[keys[-1]]
    else:
        inner[keys[-1]] = value
    return json.dumps(copy).encode()
