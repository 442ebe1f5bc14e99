"""Records: the values of a measurement with machine, versions, models, date and command, as a JSON file."""

import hashlib
import json
import math
import platform
import sys
import time
from collections.abc import Iterator, Mapping
from datetime import UTC, datetime
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from subprocess import TimeoutExpired
from typing import Any, TypeAlias

from supersampler.errors import ArgumentError
from supersampler.io.child_process import run
from supersampler.io.files import replacing
from supersampler.io.machine import machine
from supersampler.methods.model_file import extrapolation_names, model_names, shipped_model

Record: TypeAlias = Mapping[str, Any]
"""The values of a measurement, ready for JSON or read back from it."""

SHIPPED_PARETO = Path(__file__).parent / "pareto.json"
"""Times and scores of the shipped methods; presets are chosen from it."""
_BEGAN = time.monotonic()  # of a command, nearly
_IMAGE_FILES = ("step.onnx", "network.npz")
"""Files of a model whose hashes, in model.json, tell whether its images are the same."""
_PACKAGES = ("supersampler", "numpy", "onnxruntime", "flip-evaluator")


def setting() -> dict[str, Any]:
    """Return the setting of a measurement: versions, commit, models, machine, command and date."""
    return {
        "commit": _commit(),
        "model_digests": dict(model_digests()),
        "versions": {"python": platform.python_version(), **{name: _version(name) for name in _PACKAGES}},
        "machine": machine(),
        "command": ["supersampler", *sys.argv[1:]],
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "seconds": round(time.monotonic() - _BEGAN, 1),
    }


@cache
def model_digests() -> Mapping[str, str]:
    """Return a digest of each shipped model: of the files that its images are computed from."""
    return {name: _model_digest(shipped_model(name)) for name in (*model_names(), *extrapolation_names())}


def _model_digest(folder: Path) -> str:
    files = json.loads((folder / "model.json").read_text(encoding="utf-8"))["files"]
    text = "".join(f"{name} {files[name]}\n" for name in _IMAGE_FILES if name in files)
    return hashlib.sha256(text.encode()).hexdigest()[:16]


def age_of(record: Record) -> str:
    """Return a sentence that says which models of a record have changed since; "" where none has."""
    now = model_digests()
    named = {
        text.split(":")[0] for text in _texts({**record, "model_digests": None, "command": None})
    } & now.keys()
    then = record.get("model_digests")
    when = f"Measured on {str(record.get('date'))[:10]}"
    if then is None:
        return f"{when}, before records named the models' versions." if named else ""
    changed = sorted(name for name in named if then.get(name) != now[name])
    at = f" at commit {record['commit'][:8]}" if record.get("commit") else ""
    return f"{when}{at} with another version of {', '.join(changed)}." if changed else ""


def _texts(values: object) -> Iterator[str]:
    if isinstance(values, str):
        yield values
    elif isinstance(values, Mapping):
        yield from (text for key, value in values.items() for text in (key, *_texts(value)))
    elif isinstance(values, list):
        yield from (text for value in values for text in _texts(value))


def _commit() -> str | None:
    """Return the commit of the repository that this package is in; None outside of one."""
    command = ["git", "rev-parse", "HEAD"]
    try:
        found = run(command, seconds=10.0, folder=Path(__file__).parent)
    except (OSError, TimeoutExpired):
        return None
    return found.stdout.decode().strip() if found.returncode == 0 else None


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
