"""Tests of the extension's `Run` without Blender: progress, errors, cancelling; and of its commands."""

import importlib.util
import sys
import time
from pathlib import Path
from typing import Any

import pytest
from typer.testing import CliRunner

import supersampler
from blender_files import fake_blender, scene_file
from supersampler.cli import app

EXTENSION = Path(supersampler.__file__).parent / "integrations" / "blender" / "extension"
WORKS = """
import json, os, pathlib, sys, threading, time
def end():
    sys.stdin.read()
    os._exit(130)
threading.Thread(target=end, daemon=True).start()
out = pathlib.Path(sys.argv[1])
print("motion blur is off", file=sys.stderr, flush=True)
for count in (1, 2, 3):
    part = out / "part"
    part.write_text(json.dumps({"files": {"exr/####.exr": count, "png/####.png": count, "compare.html": 1}}))
    part.replace(out / "upscale.json")
    while not (out / f"go{count}").exists():
        time.sleep(0.01)
sys.exit(int(sys.argv[2]))
"""


@pytest.fixture(scope="module")
def extension() -> Any:
    """The module run.py, whose package imports bpy."""
    spec = importlib.util.spec_from_file_location("extension_run", EXTENSION / "run.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def run(extension: Any, folder: Path, code: int = 0) -> Any:
    return extension.Run([sys.executable, "-c", WORKS, str(folder), str(code)], folder, 3)


def wait_until(run: Any, done: int) -> None:
    until = time.monotonic() + 30
    while run.done < done:
        assert run.pump()
        assert time.monotonic() < until
        time.sleep(0.01)


def test_progress_is_the_number_of_listed_frames_and_the_end_is_reported(
    extension: Any, tmp_path: Path
) -> None:
    running = run(extension, tmp_path)
    for count in (1, 2, 3):
        wait_until(running, count)
        (tmp_path / f"go{count}").touch()
    while running.wait(1.0):
        pass
    assert (running.done, running.error, running.notes) == (3, "", ["motion blur is off"])


def test_the_last_line_of_a_command_that_fails_is_the_error(extension: Any, tmp_path: Path) -> None:
    code = "import sys; print('error: no camera', file=sys.stderr); sys.exit(1)"
    running = extension.Run([sys.executable, "-c", code], tmp_path, 3)
    while running.wait(1.0):
        pass
    assert (running.done, running.error) == (0, "no camera")
    silent = extension.Run([sys.executable, "-c", "raise SystemExit(7)"], tmp_path, 3)
    while silent.wait(1.0):
        pass
    assert silent.error == "the command ended with 7"
    with pytest.raises(OSError, match="nowhere"):
        extension.Run([str(tmp_path / "nowhere")], tmp_path, 3)


def test_a_cancelled_command_ends_and_is_no_error(extension: Any, tmp_path: Path) -> None:
    running = run(extension, tmp_path)
    wait_until(running, 1)
    running.cancel()
    while running.wait(1.0):
        pass
    assert (running.done, running.error) == (1, "")


def test_its_commands_are_understood(extension: Any, tmp_path: Path) -> None:
    rendered = extension.render_command(
        "supersampler",
        str(scene_file(tmp_path)),
        tmp_path / "out",
        blender=str(fake_blender(tmp_path)),
        frames=(5, 6),
        scene="Scene",
        scale=2.0,
        samples=4,
        overwrite=True,
    )
    done = CliRunner().invoke(app, [*rendered[1:], "--method", "bilinear"])
    assert done.exit_code == 0, done.output
    upscaled = extension.upscale_command(
        "supersampler", tmp_path / "out" / "render", tmp_path / "again", scale=1.5, image_format="png"
    )
    done = CliRunner().invoke(app, [*upscaled[1:], "--method", "bilinear"])
    assert done.exit_code == 0, done.output
    assert sorted(path.name for path in (tmp_path / "again").glob("*.png")) == ["0005.png", "0006.png"]
