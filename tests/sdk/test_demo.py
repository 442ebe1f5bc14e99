"""Tests of `supersampler demo` in a folder that is not empty."""

from pathlib import Path

import pytest

from supersampler.cli.results import DEMO, SOURCE, read_run_record
from supersampler.io.shot import Shot
from upscale_runs import run


@pytest.fixture(autouse=True)
def short(monkeypatch: pytest.MonkeyPatch) -> None:
    """Demos of two frames."""
    whole = Shot.open
    monkeypatch.setattr(Shot, "open", lambda path: whole(path).cropped(0, 1))


def images(folder: Path) -> dict[str, bytes]:
    return {str(path.relative_to(folder)): path.read_bytes() for path in sorted(folder.rglob("*.png"))}


def test_a_demo_of_another_method_replaces_the_earlier_one_and_leaves_other_files(tmp_path: Path) -> None:
    assert run("demo", "-o", tmp_path, "--method", "bilinear").exit_code == 0
    first = images(tmp_path)
    (tmp_path / "exr" / "mine.exr").write_bytes(b"mine")
    assert run("demo", "-o", tmp_path, "--method", "taa").exit_code == 0
    second = images(tmp_path)
    assert first.keys() == second.keys()
    assert first["png/0001.png"] != second["png/0001.png"]
    assert (tmp_path / "exr" / "mine.exr").read_bytes() == b"mine"


def test_the_same_demo_again_keeps_its_images(tmp_path: Path) -> None:
    run("demo", "-o", tmp_path, "--method", "bilinear")
    again = run("demo", "-o", tmp_path, "--method", "bilinear")
    assert again.exit_code == 0
    assert "are there already" in again.stderr


def test_a_demo_replaces_the_results_of_another_command_only_when_told(tmp_path: Path) -> None:
    run("upscale", "plaza", "-o", tmp_path, "--method", "bilinear", "--format", "exr", "--format", "png")
    upscaled = images(tmp_path)
    refused = run("demo", "-o", tmp_path, "--method", "taa")
    assert refused.exit_code == 1
    assert "or --overwrite to start over" in refused.stderr
    assert images(tmp_path) == upscaled
    assert run("demo", "-o", tmp_path, "--method", "taa", "--overwrite").exit_code == 0
    record = read_run_record(tmp_path)
    assert record is not None
    assert record.settings[SOURCE] == DEMO
