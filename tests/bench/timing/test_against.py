"""Two versions are timed alternately, and an invalid interpreter is named."""

import json
import subprocess
import sys
from pathlib import Path
from statistics import median
from typing import Any

import pytest

import upscale_runs
from supersampler.errors import ArgumentError
from supersampler.io.child_process import run
from supersampler_bench.timing import against
from supersampler_bench.timing.against import FIRST_IMAGE, STEPS, Version
from upscale_runs import refusal, succeeded

SMALL = (32, 18)


@pytest.mark.long  # starts eight processes
def test_each_round_has_new_processes_of_both_versions_alternately(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    started: list[str] = []

    def noted(command: list[str], *, environment: dict[str, str], **options: Any) -> Any:
        assert STEPS.strip() in command
        started.append(Path(environment["XDG_CACHE_HOME"]).name)
        return run(command, environment=environment, **options)

    monkeypatch.setattr(against, "run", noted)
    options = ["--methods", "bilinear", "--display-size", "32x18", "--threads", "1", "--rounds", "4"]
    options += ["--steps", "1", "--json", str(tmp_path / "against.json")]
    result = succeeded(upscale_runs.run("bench", "against", sys.executable, *options))
    assert started == ["other", "this", "this", "other"] * 2
    record = json.loads((tmp_path / "against.json").read_text())
    (found,) = record["compared"]
    ratios = [this / other for this, other in found["rounds"]]
    assert f"{median(ratios):.3f} | {min(ratios):.3f} to {max(ratios):.3f}" in result.output


def test_a_program_reports_the_time_to_its_first_image(tmp_path: Path) -> None:
    version = Version("other", sys.executable, tmp_path)
    assert 0.0 < version.run(FIRST_IMAGE, method="bilinear", render=SMALL, scale=2.0)["seconds"] < 60.0


@pytest.mark.parametrize(
    ("python", "message"),
    [
        ("/no/such/python", "not to be started: No such file"),
        (str(Path(__file__).parent), "not to be started: Permission denied"),
        ("true", "ended with code 0"),
        ("echo", "no Python: it prints"),
    ],
)
def test_a_wrong_interpreter_gives_one_line(python: str, message: str) -> None:
    assert refusal("bench", "against", python).startswith(f"error: PYTHON is {python}: {message}")


def test_an_interpreter_without_the_package_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", str(tmp_path)], check=True)
    monkeypatch.chdir(Path(__file__).parents[3] / "sdk")  # not to be found in the folder we are in either
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parents[3] / "sdk"))
    with pytest.raises(ArgumentError, match="No module named 'supersampler'"):
        Version("other", str(tmp_path / "bin" / "python"), tmp_path / "cache").run("import supersampler")


def test_a_method_that_the_other_version_lacks_and_a_process_that_dies_are_named(tmp_path: Path) -> None:
    other = Version("other", sys.executable, tmp_path)
    request: dict[str, Any] = {"method": "no-such", "render": SMALL, "scale": 2.0}
    with pytest.raises(ArgumentError, match=r"ended with code 1: .*no-such.*want an interpreter"):
        other.run(FIRST_IMAGE, **request)
    with pytest.raises(ArgumentError, match="ended with SIGKILL"):
        other.run("import os; os.kill(os.getpid(), 9)")
    with pytest.raises(ArgumentError, match=r"--methods is .*want methods that run in this version"):
        Version("this", sys.executable, tmp_path).run(FIRST_IMAGE, **request)
