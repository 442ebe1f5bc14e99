"""Helpers that make, replay and change recordings, with matching hashes."""

import hashlib
import json
from pathlib import Path
from typing import Any

from supersampler import Model, Upscaler
from supersampler.recording import open_recording
from supersampler.recording.replay import Replay, Replayed

DISPLAY = (64, 36)


def recorded(model: Model, file: Path, **arguments: Any) -> Upscaler:
    return Upscaler(model, **{"display_size": DISPLAY, "validate": "off", "record": file, **arguments})


def replayed(file: Path, **arguments: Any) -> list[Replayed]:
    replay = Replay(open_recording(file), **arguments)
    return [step for step in map(replay.call, replay.recording) if step is not None]


def contents(folder: Path) -> dict[str, bytes]:
    files = [path for path in folder.rglob("*") if path.is_file()]
    return {path.relative_to(folder).as_posix(): path.read_bytes() for path in files}


def with_hashes(files: dict[str, bytes]) -> dict[str, bytes]:
    """Return the files of a recording with a log whose hashes are theirs; lines that are no calls stay."""
    lines = []
    for line in files["calls.jsonl"].splitlines(keepends=True):
        try:
            call = json.loads(line)
            call["sha256"] = {
                name: hashlib.sha256(files[name]).hexdigest() if name in files else digest
                for name, digest in call["sha256"].items()
            }
            lines.append(json.dumps(call).encode() + b"\n")
        except (ValueError, LookupError, TypeError, AttributeError, RecursionError):
            lines.append(line)
    return {**files, "calls.jsonl": b"".join(lines)}


def mend_hashes(folder: Path) -> None:
    """Write the log of a recording anew, with the hashes of the files that are there."""
    (folder / "calls.jsonl").write_bytes(with_hashes(contents(folder))["calls.jsonl"])
