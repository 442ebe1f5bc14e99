"""Records: the values of a measurement with machine, versions, date and command, as a JSON file."""

import json
import math
import platform
import sys
from collections.abc import Mapping
from datetime import UTC, datetime
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, TypeAlias

from supersampler.errors import ArgumentError
from supersampler.io.files import replacing
from supersampler.io.machine import machine

Record: TypeAlias = Mapping[str, Any]
"""The values of a measurement, ready for JSON or read back from it."""

SHIPPED_PARETO = Path(__file__).parent / "pareto.json"
"""Times and scores of the shipped methods; presets are chosen from it."""
_PACKAGES = ("supersampler", "numpy", "onnxruntime", "flip-evaluator")


def setting() -> dict[str, Any]:
    """Return the setting of a measurement: versions, machine, command and date."""
    return {
        "versions": {"python": platform.python_version(), **{name: _version(name) for name in _PACKAGES}},
        "machine": machine(),
        "command": ["supersampler", *sys.argv[1:]],
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
    }


def machine_name(record: Record) -> str:
    """Return the processor and the number of cores that a record was measured on."""
    return f"{record['machine']['cpu']}, {record['machine']['cores']} cores"


def read_record(path: Path) -> dict[str, Any]:
    """Return a record that a bench command wrote with `--json`.

    Raises:
        ArgumentError: the file is no such record.
    """
    reason = ""
    try:
        record = json.loads(path.read_text(encoding="utf-8"))
        if isinstance(record["bench"], str):
            return dict(record)
    except (OSError, ValueError, KeyError, TypeError, RecursionError) as error:
        reason = f" ({error})"
    raise ArgumentError("record", got=f"{path}{reason}", want="a file of `bench ... --json`")


def is_record(path: Path) -> bool:
    """Return whether a file is a record that a bench command wrote."""
    try:
        read_record(path)
    except ArgumentError:
        return False
    return True


def write_json(record: Record, path: Path) -> None:
    """Write a record, whole or not at all; NaN becomes null, because JSON has no NaN.

    Raises:
        ShotError: the file cannot be written.
    """
    text = json.dumps(_without_nan(record), indent=1, allow_nan=False) + "\n"
    with replacing(path) as partial:
        partial.write_text(text, encoding="utf-8", newline="\n")


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None  # such as onnxruntime, which has several distributions


def _without_nan(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _without_nan(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_without_nan(item) for item in value]
    return None if isinstance(value, float) and math.isnan(value) else value
