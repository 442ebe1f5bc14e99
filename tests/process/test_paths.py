"""Names of files in other encodings work, or are refused in one line that names the file."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

import supersampler

PLAZA = Path(supersampler.__file__).parent / "shots" / "plaza"
ASCII = {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
UTF8, LATIN1 = "schuß".encode(), b"schu\xdf"
COMMANDS = [
    "check {} --frames 2",
    "info {}",
    "import {} -o {}copy",
    "upscale {} -o {}out --frames 0-1 --method bilinear --compare --format png --format exr",
    *["upscale plaza -o {}named --frames 0-1 --method bilinear --name {}.####"] * 2,  # the second continues
    "upscale plaza -o {}video --frames 0-1 --method bilinear --format mp4",
    "upscale plaza -o recorded --frames 0-1 --method bilinear --record {}recording",
    "replay {}recording",
    "upscale plaza -o view --frames 0-1 --method bilinear --format png --ocio {}.ocio",
    "demo --web --write {}page",
    "export taau -o {}shaders --target wgsl",
    "blender {}.blend -o {}render",
]
RUN = """
import json, os, sys, traceback
from typer.testing import CliRunner
from supersampler.cli import app
for words in json.loads(sys.argv[1]):
    words = [word.replace("{}", sys.argv[2]) for word in words.split()]
    done = CliRunner().invoke(app, words)
    bug = done.exception is not None and not isinstance(done.exception, SystemExit)
    said = "".join(traceback.format_exception(done.exception)) if bug else done.stderr.strip()
    os.write(1, json.dumps([words[0], done.exit_code, bug, said]).encode() + b"\\n")
"""


def results(folder: Path, name: bytes, variables: dict[str, str]) -> list[tuple[str, int, bool, str]]:
    place = os.fsencode(folder)
    os.symlink(PLAZA, place + b"/" + name)  # noqa: PTH211  # the path is bytes
    for end in (b".ocio", b".blend"):
        with open(place + b"/" + name + end, "wb") as file:  # noqa: PTH123  # the path is bytes
            file.write(b"x")
    done = subprocess.run(
        [sys.executable, "-c", RUN, json.dumps(COMMANDS), name],
        cwd=folder,
        env={**os.environ, **variables},
        capture_output=True,
    )
    assert done.returncode == 0, done.stderr.decode(errors="replace")
    return [tuple(json.loads(line)) for line in done.stdout.splitlines()]


@pytest.mark.parametrize("variables", [{}, ASCII])
def test_utf8_names_work_in_any_locale(tmp_path: Path, variables: dict[str, str]) -> None:
    found = results(tmp_path, UTF8, variables)
    assert [said for *_, bug, said in found if bug] == []
    failed = {command for command, code, *_ in found if code}
    assert failed <= {"upscale", "blender"}  # the scene is none, and the view is none
    assert [said for command, code, _, said in found if code and ".ocio" not in said] == [
        said for command, *_, said in found if command == "blender"
    ]
    for name in (f"{UTF8.decode()}out", f"{UTF8.decode()}video", f"{UTF8.decode()}copy"):
        assert any((tmp_path / name).iterdir())


@pytest.mark.parametrize("variables", [{}, ASCII])
def test_names_that_are_not_utf8_are_refused_in_one_line(tmp_path: Path, variables: dict[str, str]) -> None:
    found = results(tmp_path, LATIN1, variables)
    assert [said for *_, bug, said in found if bug] == []
    for command, code, _, said in found:
        last = said.splitlines()[-1] if said else ""
        assert code == 0 or last.startswith("error: "), (command, said)
        assert all(character.isprintable() for character in last)
    refused = [said for *_, said in found if "has a name that is not UTF-8. Rename it" in said]
    assert len(refused) >= 4
