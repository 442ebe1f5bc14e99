"""Tests of what `upscale` says while it runs: lines of JSON, progress, exit codes."""

import json
import re
from collections.abc import Sequence
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
        ((), range(COUNT)), (("--frames", "1-3", "--preroll", "1"), [1, 2, 3]),
        (("--format", "mp4"), range(COUNT)), (("--compare",), range(COUNT)),
    ],
)  # fmt: skip
def test_stdout_is_a_line_of_json_for_each_frame(
    shot: Path, tmp_path: Path, options: tuple[str, ...], numbers: Sequence[int]
) -> None:
    if "mp4" in options:
        pytest.importorskip("av")
    first, *frames, last = map(json.loads, upscale(shot, tmp_path, "--json", *options).stdout.splitlines())
    count = len(numbers)
    wanted = {"event": "begin", "shot": "tiny", "frames": count, "complete": 0}
    assert first | wanted == first
    for index, (frame, number) in enumerate(zip(frames, numbers, strict=True)):
        wanted = {"event": "frame", "number": number, "index": index, "frames": count}
        assert frame | wanted == frame
        assert frame["seconds"] >= 0.0
    assert (last["event"], last["frames"] >= count) == ("end", True)


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
    assert "upscaling" not in upscale(shot, tmp_path / "quick").stderr
    monkeypatch.setattr(terminal, "LOG_SECONDS", 0.0)
    said = upscale(shot, tmp_path / "slow").stderr
    lines = re.findall(r"^upscaling (\d) of 6: \d+\.\d \S+, (\d+:\d\d) left$", said, re.MULTILINE)
    assert [int(done) for done, _ in lines] == [1, 2, 3, 4, 5, 6]
    assert lines[-1][1] == "0:00"


def test_slow_frames_are_stated_in_seconds_each() -> None:
    assert terminal.rate_text(3, 2.0) == "1.5 frames/s"
    assert terminal.rate_text(2, 99.9) == "50.0 s/frame"
    assert terminal.rate_text(0, 1.0) == "0.0 frames/s"


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
