"""Tests of recordings after a crash, on a full disk and with damaged files."""

import json
import shutil
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from noise import noise
from recorded_files import DISPLAY, contents, recorded, replayed
from supersampler import Model, Upscaler
from supersampler.errors import RecordingError
from supersampler.io.shot import Shot
from supersampler.methods.model_file import CONTRACT
from supersampler.recording import CloseCall, StepCall, open_recording
from supersampler.recording.recorder import Recorder


@pytest.fixture(scope="module")
def models() -> dict[str, Model]:
    return {"taau": Model.load("taau", threads=1)}


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "new folder" / "a.recording"


def test_a_frame_in_which_the_process_ends_is_in_the_recording(
    models: dict[str, Model], file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    left = file.with_name("left.recording")
    run = Model.run_checked

    def crash(*arguments: Any, **options: Any) -> Any:
        shutil.copytree(file, left)  # what is on the disk at this moment
        return run(*arguments, **options)

    with recorded(models["taau"], file) as upscaler:
        upscaler.step(noise(0))
        with monkeypatch.context() as patch:
            patch.setattr(Model, "run_checked", crash)
            upscaler.step(noise(1))
    first, last = replayed(left)
    assert (first.exact, last.exact, last.within) == (True, None, True)
    assert last.result is not None


def test_an_upscaler_that_is_dropped_leaves_all_its_frames(models: dict[str, Model], file: Path) -> None:
    upscaler = recorded(models["taau"], file)
    upscaler.step(noise(0))
    upscaler.step(noise(1))
    del upscaler
    assert [step.exact for step in replayed(file)] == [True, True]
    assert not any(isinstance(call, CloseCall) for call in open_recording(file))


def test_wherever_the_log_is_cut_the_calls_before_are_there(models: dict[str, Model], file: Path) -> None:
    with recorded(models["taau"], file) as upscaler:
        for seed in range(2):
            upscaler.step(noise(seed, (16, 9), reset=False))
    log = file / "calls.jsonl"
    whole = log.read_bytes()
    for size in range(len(whole)):
        log.write_bytes(whole[:size])
        calls = [call for call in open_recording(file) if isinstance(call, StepCall)]
        lines = whole[:size].count(b"\n")
        assert len(calls) == min((lines + 1) // 2, 2)
        assert len([call for call in calls if call.outcome is not None]) == min(lines // 2, 2)


def test_a_process_killed_in_a_step_leaves_a_recording_and_a_shot_of_the_steps_before(file: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-c", _KILLED_IN_THE_THIRD_STEP, str(file)],
        cwd=Path(__file__).parents[1],
        check=False,
    )
    assert done.returncode == -9
    assert [step.exact for step in replayed(file)] == [True, True, None]
    shot = Shot.open(file)
    assert len(shot) == 2
    np.testing.assert_array_equal(shot.read(1).frame.color, noise(1).color)


_KILLED_IN_THE_THIRD_STEP = """
import os, sys
from noise import noise
from supersampler import Model, Upscaler
upscaler = Upscaler("taau", threads=1, display_size=(64, 36), record=sys.argv[1])
upscaler.step(noise(0))
upscaler.step(noise(1))
Model.run_checked = lambda *_, **__: os.kill(os.getpid(), 9)
upscaler.step(noise(2))
"""


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("0001.exr", r"a\.recording.0001\.exr: is not as it was recorded"),
        ("sampled/0001.exr", r"sampled.0001\.exr: is not as it was recorded"),
        ("calls.jsonl", r"calls\.jsonl: line 3 is not JSON"),
    ],
)
def test_damage_is_an_error_after_the_frames_before(
    models: dict[str, Model], file: Path, name: str, message: str
) -> None:
    with recorded(models["taau"], file) as upscaler:
        upscaler.step(noise(0))
        upscaler.step(noise(1))
    content = (file / name).read_bytes()
    lines = content.splitlines(keepends=True)
    (file / name).write_bytes(b"".join([*lines[:2], b"x\n"]) if name == "calls.jsonl" else b"x")
    calls = iter(open_recording(file))
    assert isinstance(next(calls), StepCall)
    with pytest.raises(RecordingError, match=f"{message}.*The recording is damaged"):
        list(calls)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ({"format": 99}, "is of format 99; this package reads 5"),
        ({"format": 5, "contract": 99}, "is of contract 99; this package reads"),
        ({"format": 5, "contract": CONTRACT}, "has no 'folder'"),
        ([], "want an object"),
    ],
)
def test_a_recording_of_another_version_is_refused(content: object, message: str, file: Path) -> None:
    file.mkdir(parents=True)
    (file / "recording.json").write_text(json.dumps(content))
    with pytest.raises(RecordingError, match=message):
        open_recording(file)


def test_what_is_no_recording_is_refused(file: Path) -> None:
    with pytest.raises(RecordingError, match="there is no such folder"):
        open_recording(file)
    file.mkdir(parents=True)
    with pytest.raises(RecordingError, match="is not a recording"):
        open_recording(file)
    (file / "shot.json").write_text("{}")
    with pytest.raises(RecordingError, match="is not a recording"):
        open_recording(file / "shot.json")


def test_a_recording_that_is_there_is_not_written_over(models: dict[str, Model], file: Path) -> None:
    recorded(models["taau"], file).close()
    before = contents(file)
    with pytest.raises(RecordingError, match=r"is there already\. Choose another name"):
        recorded(models["taau"], file)
    assert contents(file) == before


@contextmanager
def disk_full_for(path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Writing this file fails."""
    with monkeypatch.context() as patch:
        if path.name == "calls.jsonl":
            patch.setattr(Recorder, "_append", _refuse)
        else:
            replace_file = Path.replace
            refuses = lambda part, to: _refuse() if to == path else replace_file(part, to)  # noqa: E731
            patch.setattr(Path, "replace", refuses)
        yield


def _refuse(*_: object) -> None:
    raise OSError(28, "No space left on device")


@contextmanager
def full_disk(size: int) -> Iterator[None]:
    """Files end there: writes first come short, then fail."""
    resource = pytest.importorskip("resource", reason="Windows limits no file's size")
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, limits[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)


@pytest.mark.parametrize("full", ["0001.exr", "sampled/0001.exr", "calls.jsonl", "shot.json"])
def test_a_full_disk_ends_the_recording_with_the_last_complete_step_and_the_history_stays(
    full: str, models: dict[str, Model], file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Before the step it is refused; after it, the next one is."""
    upscaler, plain = recorded(models["taau"], file), Upscaler(models["taau"], display_size=DISPLAY)
    upscaler.step(noise(0))
    plain.step(noise(0))
    before, seed = contents(file), 1
    with disk_full_for(file / full, monkeypatch):
        if full in ("sampled/0001.exr", "shot.json"):
            np.testing.assert_array_equal(upscaler.step(noise(seed)), plain.step(noise(seed)))
            seed += 1
        with pytest.raises(RecordingError, match=r"a\.recording: cannot be written .* Is the disk full"):
            upscaler.step(noise(seed))
    assert contents(file) == before
    np.testing.assert_array_equal(upscaler.step(noise(seed)), plain.step(noise(seed)))
    upscaler.close()
    assert [step.exact for step in replayed(file)] == [True]


def test_a_log_that_takes_a_part_of_a_line_ends_before_it(models: dict[str, Model], file: Path) -> None:
    upscaler = recorded(models["taau"], file)
    for _ in range(100):  # until the log is the largest file
        upscaler.reset()
    before = contents(file)
    with full_disk(len(before["calls.jsonl"]) + 5), pytest.raises(RecordingError, match="Is the disk full"):
        upscaler.reset()
    assert contents(file) == before
    upscaler.reset()  # is no longer recorded
    assert len(list(open_recording(file))) == 100
