"""Tests of what `upscale` says while it runs: lines of JSON, progress, exit codes."""

import json
import re
from pathlib import Path

import pytest

from supersampler.cli import terminal
from supersampler.cli.results import Results
from upscale_runs import run, upscale, write_shot

COUNT = 6


@pytest.fixture(scope="module")
def shot(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_shot(tmp_path_factory.mktemp("shots") / "tiny", COUNT)


@pytest.mark.parametrize(
    ("options", "numbers"),
    [
        ((), [0, 1, 2, 3, 4, 5]),
        (("--frames", "1-3", "--preroll", "1"), [1, 2, 3]),
        (("--format", "mp4"), [0, 1, 2, 3, 4, 5]),
        (("--compare",), [0, 1, 2, 3, 4, 5]),
    ],
)
def test_stdout_is_a_line_of_json_for_each_frame(
    shot: Path, tmp_path: Path, options: tuple[str, ...], numbers: list[int]
) -> None:
    if "mp4" in options:
        pytest.importorskip("av")
    events = [json.loads(line) for line in upscale(shot, tmp_path, "--json", *options).stdout.splitlines()]
    assert [event["event"] for event in events] == ["begin", *["frame"] * len(numbers), "end"]
    assert (events[0]["shot"], events[0]["frames"], events[0]["complete"]) == ("tiny", len(numbers), 0)
    frames = events[1:-1]
    assert [frame["number"] for frame in frames] == numbers
    assert [frame["index"] for frame in frames] == [*range(len(numbers))]
    assert {frame["frames"] for frame in frames} == {len(numbers)}
    assert all(frame["seconds"] >= 0.0 for frame in frames)
    assert events[-1]["frames"] >= len(numbers)


def test_a_frame_is_written_before_its_line(
    shot: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    names = []
    event = terminal.RunProgress.event

    def look(self: terminal.RunProgress, kind: str, **values: int) -> None:
        if kind == "frame":
            names.append(f"{values['number']:04d}")
            assert all((tmp_path / f"{kind}/{names[-1]}.{kind}").exists() for kind in ("exr", "png"))
        event(self, kind, **values)

    monkeypatch.setattr(terminal.RunProgress, "event", look)
    upscale(shot, tmp_path, "--json", "--format", "exr", "--format", "png")
    assert names == [f"{number:04d}" for number in range(COUNT)]


def test_json_of_a_run_that_continues_has_the_frames_that_were_missing(shot: Path, tmp_path: Path) -> None:
    upscale(shot, tmp_path)
    for number in (3, 5):
        (tmp_path / f"{number:04d}.exr").unlink()
    events = [json.loads(line) for line in upscale(shot, tmp_path, "--json").stdout.splitlines()]
    assert events[0]["complete"] == 3
    assert [event["number"] for event in events[1:-1]] == [3, 4, 5]


def test_a_log_has_lines_of_progress(shot: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert "frames/s" not in upscale(shot, tmp_path / "quick").stderr
    monkeypatch.setattr(terminal, "LOG_SECONDS", 0.0)
    said = upscale(shot, tmp_path / "slow").stderr
    lines = re.findall(r"^upscaling (\d) of 6: \d+\.\d frames/s.*, (\d+:\d\d) left$", said, re.MULTILINE)
    assert [int(done) for done, _ in lines] == [1, 2, 3, 4, 5, 6]
    assert lines[-1][1] == "0:00"


def test_exit_codes_are_as_the_help_says(shot: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = re.sub(r"\s+", " ", run("upscale", "--help").stdout)
    assert "Exit codes: 0 done, 1 an error, 2 wrong arguments, 130 stopped." in text
    command = ("upscale", shot, "-o", tmp_path, "--method", "bilinear")
    assert run(*command).exit_code == 0
    assert run(*command).exit_code == 0  # all is there
    assert run(*command, "--scale", "3").exit_code == 1  # another run's images are there
    for wrong in ("--format=gif", "--preroll=-1", "--nothing", "--compression=zap", "--scale=x"):
        assert run(*command, wrong).exit_code == 2

    def stop(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    for name, where in (("list_files", "out"), ("begin", "other")):
        with monkeypatch.context() as patch:
            patch.setattr(Results, name, stop)
            done = run("upscale", shot, "-o", tmp_path / where, "--method", "bilinear", "--json")
        assert (done.exit_code, done.exception.__class__) == (130, SystemExit)
