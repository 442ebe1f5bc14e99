"""Two versions are timed in turns, and a wrong other one is named."""

import json
import subprocess
import sys
from pathlib import Path
from statistics import median
from typing import Any, NamedTuple

import numpy as np
import pytest
from typer.testing import CliRunner

from supersampler.cli import app as supersampler
from supersampler.errors import ArgumentError
from supersampler.io.child_process import run
from supersampler_bench.cli import app
from supersampler_bench.timing import against
from supersampler_bench.timing.against import (
    COVERAGE,
    FIRST,
    FIRST_IMAGE,
    STEP_CORES,
    STEP_WALL,
    STEPS,
    Version,
    _in_rounds,
    interval,
)

SMALL = (32, 18)


class Measured(NamedTuple):
    """This version against itself, by the command: what it wrote, and the programs that it started."""

    record: dict[str, Any]
    output: str
    started: list[list[str]]


@pytest.fixture(scope="module")
def measured(tmp_path_factory: pytest.TempPathFactory) -> Measured:
    folder, started = tmp_path_factory.mktemp("against"), list[list[str]]()

    def noted(command: list[str], **options: Any) -> Any:
        started.append(command)
        return run(command, **options)

    options = ["--methods", "bilinear", "--display-size", "32x18", "--threads", "1", "--rounds", "6"]
    files = ["--json", str(folder / "against.json")]
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(against, "run", noted)
        result = CliRunner().invoke(app, ["against", sys.executable, *options, "--steps", "1", *files])
    assert result.exit_code == 0, result.output
    record = json.loads((folder / "against.json").read_text())
    return Measured(record, result.output, started)


@pytest.mark.long  # `measured` starts twenty processes
def test_each_time_is_a_median_of_ratios_of_rounds(measured: Measured) -> None:
    found = measured.record["compared"]
    assert [row["what"] for row in found] == [STEP_WALL, STEP_CORES, FIRST]
    for row in found:
        ratios = [this / other for this, other in row["rounds"]]
        assert len(ratios) == 6
        assert row["median"] == pytest.approx(median(ratios))
        assert min(ratios) <= row["low"] <= row["median"] <= row["high"] <= max(ratios)
    assert measured.record["sides"]["this"] == measured.record["sides"]["other"]
    assert "| 32x18 | 1 | bilinear | step, wall |" in measured.output


@pytest.mark.long  # `measured` starts twenty processes
def test_each_round_has_new_processes(measured: Measured) -> None:
    assert sum(STEPS.strip() in command for command in measured.started) == 2 * 6
    firsts = sum(FIRST_IMAGE.strip() in command for command in measured.started)
    assert firsts == 2 * (6 + 1), "one more of each version fills its kernel cache"


def test_versions_take_turns_as_to_which_is_first() -> None:
    order: list[str] = []

    def timed(who: str) -> str:
        order.append(who)
        return who

    assert _in_rounds(4, ("A", "B"), timed, lambda: None) == [("A", "B")] * 4
    assert "".join(order) == "ABBAABBA"


def test_the_interval_holds_the_median_as_often_as_it_says() -> None:
    generator = np.random.default_rng(5)
    for count in (6, 10, 25):
        intervals = [interval(list(generator.exponential(size=count))) for _ in range(2000)]
        held = np.mean([low <= np.log(2.0) <= high for low, high in intervals])
        assert held > COVERAGE - 0.015
    assert interval(range(10)) == (1, 8)  # 0.979; (2, 7) would be 0.891
    assert interval(range(6)) == (0, 5)


def test_a_program_says_how_long_its_first_image_took(tmp_path: Path) -> None:
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
def test_what_is_no_interpreter_is_one_line(python: str, message: str) -> None:
    result = CliRunner().invoke(supersampler, ["bench", "against", python])
    assert result.exit_code == 1
    assert result.output.startswith(f"error: PYTHON is {python}: {message}")
    assert result.output.count("\n") == 1


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


def test_too_few_rounds_for_an_interval_are_refused() -> None:
    few = CliRunner().invoke(supersampler, ["bench", "against", sys.executable, "--rounds", "5"])
    assert few.exit_code == 2
    assert "5 is not in the range x>=6" in few.output
