"""Tests that damaged or strange input files give one line of error, never a traceback."""

import json
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from noise import noise
from supersampler.cli import app
from supersampler.io.images import write_exr
from supersampler.io.shot import ShotWriter

DEEP = "[" * 100_000
CHANNELS = {"color": ["R", "G", "B"], "depth": "Z", "motion": ["U", "V"]}


def file(name: str, content: bytes = b"") -> Callable[[Path], str]:
    def made(folder: Path) -> str:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_bytes(content)
        return str(folder / name)

    return made


def pipe(folder: Path) -> str:
    (folder / "shot").mkdir()
    os.mkfifo(folder / "shot" / "shot.json")
    return str(folder / "shot")


def inside(name: str, content: bytes) -> Callable[[Path], str]:
    """A folder that holds one file."""
    return lambda folder: os.path.dirname(file(f"in/{name}", content)(folder))  # noqa: PTH120


PATHS: dict[str, Callable[[Path], str]] = {
    "nothing": lambda folder: str(folder / "none"),
    "a long name": lambda folder: str(folder / ("a" * 300)),
    "a long path": lambda folder: str(folder / ("a/" * 3000)),
    "a name alone": lambda _: "b" * 5000,
    "below a file": lambda folder: file("plain")(folder) + "/shot.json",
    "a folder of nothing": lambda folder: str(folder),
    "a folder called as a file": lambda folder: os.path.dirname(file("a.json/x")(folder)),  # noqa: PTH120
    "an empty file": file("a.safetensors"),
    "no text": file("a.json", b"\xff\xfe\0"),
    "deep JSON": file("a.json", DEEP.encode()),
    "other JSON": file("a.json", b"[1, 2]"),
    "a pipe": pipe,
    "a broken EXR": inside("0000.exr", b"v/1\x01\2\0\0\0"),
    "another image as an EXR": inside("0000.exr", b"\x89PNG\r\n\x1a\n"),
    "a broken channels.json": inside("channels.json", b"{"),
    "no frames": inside("shot.json", b'{"version": 1}'),
    "a training set": inside("dataset.json", DEEP.encode()),
    "a training set of words": inside("dataset.json", b'{"version": 1, "sequences": "x"}'),
}


@pytest.mark.parametrize("command", ["info", "check", "upscale", "import", "replay"])
@pytest.mark.parametrize("path", PATHS)
def test_a_path_of_any_kind_is_one_line_of_error(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, command: str, path: str
) -> None:
    (tmp_path / "here").mkdir()
    monkeypatch.chdir(tmp_path / "here")
    given = PATHS[path](tmp_path / "here")
    output = ("-o", str(tmp_path / "out")) if command in ("upscale", "import", "replay") else ()
    done = CliRunner().invoke(app, [command, given, *output])
    assert isinstance(done.exception, SystemExit), repr(done.exception)
    assert (done.exit_code, done.stderr.count("\n")) == (1, 1)
    assert done.stderr.startswith("error: ")
    assert not (tmp_path / "out").exists()


@pytest.fixture
def shot(tmp_path: Path) -> Path:
    with ShotWriter(tmp_path / "shot", name="tiny", display_size=(64, 36), frame_rate=30) as writer:
        writer.write(noise(0))
    return tmp_path / "shot"


@pytest.mark.parametrize("output", ["plain", "plain/out", "a" * 300, "x/" * 3000, "/proc/none"])
@pytest.mark.parametrize("command", ["upscale", "import", "demo"])
def test_an_output_that_cannot_be_made_is_one_line_of_error(
    shot: Path, tmp_path: Path, command: str, output: str
) -> None:
    (tmp_path / "plain").write_text("kept")
    source = () if command == "demo" else (str(shot),)
    options = ("--method", "bilinear") if command != "import" else ()
    done = CliRunner().invoke(app, [command, *source, "-o", str(tmp_path / output), *options])
    assert isinstance(done.exception, SystemExit), repr(done.exception)
    assert (done.exit_code, done.stderr.splitlines()[-1][:7]) == (1, "error: ")
    assert (tmp_path / "plain").read_text() == "kept"


@pytest.mark.parametrize("option", ["--jitter", "--channels", "--conventions"])
@pytest.mark.parametrize("content", [b"\xff\xfe", b"", DEEP.encode(), b"[1]", b'{"a": 1e999}', b"3"])
def test_any_file_of_an_option_is_one_line_of_error(tmp_path: Path, option: str, content: bytes) -> None:
    grey = np.full((6, 8), 0.5, np.float32)
    write_exr(tmp_path / "in" / "0000.exr", dict.fromkeys(("R", "G", "B", "Z", "U", "V"), grey))
    (tmp_path / "map.json").write_text(json.dumps(CHANNELS))
    (tmp_path / "given").write_bytes(content)
    options = {"--channels": tmp_path / "map.json", "--conventions": "unreal", option: tmp_path / "given"}
    listed = [str(part) for pair in options.items() for part in pair]
    done = CliRunner().invoke(app, ["import", str(tmp_path / "in"), "-o", str(tmp_path / "out"), *listed])
    assert isinstance(done.exception, SystemExit), repr(done.exception)
    assert (done.exit_code, done.stderr.count("\n")) == (1, 1)
    assert not (tmp_path / "out").exists()


def test_names_in_a_file_have_no_say_over_the_terminal(shot: Path) -> None:
    content = (shot / "shot.json").read_text().replace('"tiny"', '"\\u001b[2J\\nwhat"')
    (shot / "shot.json").write_text(content)
    done = CliRunner().invoke(app, ["info", str(shot)])
    assert (done.exit_code, "?[2J" in done.stdout) == (0, True)
    (shot / "0000.exr").write_bytes(b"")
    done = CliRunner().invoke(app, ["info", str(shot)])
    assert (done.exit_code, done.stderr.count("\n")) == (1, 1)
