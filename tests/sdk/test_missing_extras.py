"""Tests of what is printed where an extra is missing or the reader of a pipe has gone: a line, or nothing."""

import subprocess
import sys
import tomllib
from pathlib import Path

import pytest
from typer.testing import CliRunner

from supersampler.cli import app
from supersampler.cli.app import EXTRAS

ROOT = Path(__file__).parents[2]
IMPORTED_AS = {"flip-evaluator": "flip_evaluator"}
NOT_COMMANDS = {"docs", "dev"}
CLOSED = """
import os, sys
out, pipe = os.pipe()
os.close(out)
os.dup2(pipe, 1)
from supersampler.cli import main
main()
"""


def test_every_package_of_an_extra_is_known_to_the_error_message() -> None:
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    for extra, packages in extras.items():
        for package in packages if extra not in NOT_COMMANDS else ():
            name = package.partition(">")[0].partition("=")[0]
            found = EXTRAS[IMPORTED_AS.get(name, name)]
            assert any(each.startswith(name) for each in extras[found])


@pytest.mark.parametrize(
    ("missing", "words", "extra"),
    [
        ("matplotlib", ["bench", "quality", "plaza", "--methods", "bilinear", "-o", "x"], "bench"),
        ("onnx", ["bench", "cost"], "train"),
        ("torch", ["bench", "parity"], "train"),
        ("moderngl", ["bench", "parity", "--methods", "bilinear", "--frames", "10"], "render"),
        ("torch", ["train", "classifier", "-o", "x"], "train"),
        ("torch", ["export", "taau", "-o", "x"], "train"),
        ("av", ["upscale", "plaza", "-o", "x", "--format", "mp4", "--method", "bilinear"], "video"),
    ],
)
def test_a_missing_extra_is_one_line_that_names_it(
    missing: str, words: list[str], extra: str, tmp_path: Path
) -> None:
    code = f"import sys; sys.modules.update({missing}=None); from supersampler.cli import main; main()"
    command = [sys.executable, "-c", code, *words]
    done = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 1
    last = done.stderr.strip().splitlines()[-1]
    assert f"needs {missing}" in last
    assert last.endswith(f'pip install "supersampler[{extra}]"')
    assert "Traceback" not in done.stderr


@pytest.mark.parametrize(
    "words",
    [["--help"], ["bench", "--help"], ["bench", "latency", "--help"], ["train", "--help"], ["info", "plaza"]],
)
def test_output_that_nobody_reads_ends_without_a_word(words: list[str]) -> None:
    done = subprocess.run([sys.executable, "-c", CLOSED, *words], capture_output=True, text=True)
    assert done.stderr == ""


@pytest.mark.parametrize("words", [["bench"], ["bench", "cost"], ["render"], ["train"], ["export"]])
def test_help_of_all_tools_is_in_one_style(words: list[str]) -> None:
    said = CliRunner().invoke(app, [*words, "--help"], prog_name="supersampler").output
    assert "--install-completion" not in said
    assert said.startswith("Usage: supersampler")
    assert "╭" not in said
