"""A recorded render of `tests/blender/make_scene.py`, and a Blender that only repeats it."""

import json
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from commands import processes

HERE = Path(__file__).with_name("blender")
RECORDED = HERE / "recorded"
NUMBERS = (5, 8)  # of the recorded frames
SECONDS = 100.0  # for what ends soon, on a busy machine


def fake_blender(folder: Path) -> Path:
    path = folder / "blender"
    path.write_text(f'#!/bin/sh\nexec "{sys.executable}" "{HERE / "fake_blender.py"}" "$@"\n')
    path.chmod(0o755)
    return path


def scene_file(folder: Path, **plan: Any) -> Path:
    """Write a scene that the fake Blender renders; `plan` says what goes wrong ("_" for a blank)."""
    path = folder / "scene.blend"
    path.write_text("BLENDER")
    path.with_name("plan.json").write_text(json.dumps({n.replace("_", " "): v for n, v in plan.items()}))
    return path


def is_running(pid: int) -> bool:
    """Return whether a process exists and is no zombie (Linux)."""
    return any(process.pid == pid for process in processes())


def wait_until(what: Callable[[], object]) -> None:
    until = time.monotonic() + SECONDS
    while not what():
        assert time.monotonic() < until
        time.sleep(0.05)
