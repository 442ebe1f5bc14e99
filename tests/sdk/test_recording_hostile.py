"""A recording of a stranger is refused where it holds what no Upscaler writes."""

import json
import os
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from noise import noise
from supersampler import ArgumentError, Model, Upscaler
from supersampler.errors import RecordingError
from supersampler.io.images import write_exr
from supersampler.io.shot.safetensors import open_safetensors, write_safetensors
from supersampler.recording import open_recording
from supersampler.recording.recording import MAX_LINE
from supersampler.recording.replay import Replay

FRAME = {"file": "0000.exr", "jitter": [0, 0], "render_size": [32, 18]}
STATE = {"method": "taau", "history": False, "shaded": False, "version": 1}


@pytest.fixture(scope="module")
def taau() -> Model:
    return Model.load("taau", threads=1)


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "a.recording"


def recorded(model: Model, file: Path) -> Upscaler:
    upscaler = Upscaler(model, display_size=(64, 36), validate="off", record=file)
    upscaler.step(noise(0))
    return upscaler


@pytest.mark.parametrize(
    "changes",
    [
        {"threads": -1},
        {"threads": 10**6},
        {"threads": 1.5},
        {"threads": float("inf")},
        {"display_size": [2**40, 2**40]},
        {"display_size": "ab"},
        {"scale": float("nan")},
        {"scale": 1e300},
        {"skip": float("nan")},
        {"skip": "never"},
        {"executor": "gpu"},
        {"precision": []},
        {"validate": None},
        {"providers": "cpu"},
        {"providers": [1]},
        {"files": {"step.onnx": 1}},
        {"versions": []},
        {"extrapolation": {"folder": "x"}},
    ],
)
def test_a_setup_that_no_upscaler_has_is_refused(changes: dict[str, Any], taau: Model, file: Path) -> None:
    recorded(taau, file).close()
    setup = json.loads((file / "recording.json").read_text())
    (file / "recording.json").write_text(json.dumps({**setup, **changes}))
    with pytest.raises(RecordingError, match=next(iter(changes))):
        open_recording(file)


def append(file: Path, *lines: object) -> None:
    with (file / "calls.jsonl").open("a") as log:
        log.writelines(json.dumps(line) + "\n" for line in lines)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ({"call": "explode"}, '"call" of line 4 is "explode"'),
        ({"call": 1}, '"call" of line 4 is 1'),
        ({}, 'line 4 has no "call"'),
        ([], "line 4 is "),
        ({"call": "step"}, 'no "frame"'),
        ({"call": "step", "frame": 1}, '"frame" of line 4 is 1'),
        ({"call": "step", "frame": {**FRAME, "file": "../0000.exr"}}, '"file"'),
        ({"call": "step", "frame": {**FRAME, "file": "/etc/passwd"}}, '"file"'),
        ({"call": "step", "frame": {**FRAME, "file": "0009.exr"}}, "no such file"),
        ({"call": "step", "frame": {**FRAME, "file": "shot.json"}}, "is not an EXR image"),
        ({"call": "step", "frame": {**FRAME, "jitter": [9, 9]}}, "frame.jitter"),
        ({"call": "step", "frame": {**FRAME, "jitter": [0, 10**400]}}, '"jitter"'),
        ({"call": "step", "frame": {**FRAME, "exposure": float("nan")}}, "frame.exposure"),
        ({"call": "step", "frame": {**FRAME, "render_size": [18, 32]}}, "32x18"),
        ({"call": "step", "frame": {**FRAME, "render_size": None}}, "render_size"),
        ({"call": "step", "frame": {**FRAME, "surprise": 1}}, "surprise"),
        ({"call": "step", "frame": FRAME, "outputs": "aovs"}, '"outputs"'),
        ({"call": "load_state", **STATE}, "no such file"),
        ({"call": "close"}, '"image"'),
        ({"call": "close", "image": 7}, '"image"'),
    ],
)
def test_a_line_that_no_upscaler_writes_is_refused(
    line: object, message: str, taau: Model, file: Path
) -> None:
    recorded(taau, file).close()
    append(file, line)
    with pytest.raises(RecordingError, match=message):
        list(open_recording(file))


@pytest.mark.parametrize(
    "changes",
    [
        {"method": 1},
        {"display_size": [1, 2**40]},
        {"display_size": "ab"},
        {"history": None},
        {"shaded": 1},
        {"version": "1"},
    ],
)
def test_a_state_that_no_upscaler_has_is_refused(changes: dict[str, Any], taau: Model, file: Path) -> None:
    upscaler = recorded(taau, file)
    upscaler.load_state(upscaler.save_state())
    log = (file / "calls.jsonl").read_text().splitlines()
    changed = json.dumps({**json.loads(log[-1]), **changes})
    (file / "calls.jsonl").write_text("\n".join([*log[:-1], changed, ""]))
    with pytest.raises(RecordingError, match=next(iter(changes))):
        list(open_recording(file))


@pytest.mark.parametrize(
    "outcome",
    [
        {"returned": {"image": 2**40}},
        {"returned": {"image": -1}},
        {"returned": ["image"]},
        {"raised": ["", "", ""]},
        {"raised": [1, 2]},
        {"raised": "FrameError"},
    ],
)
def test_an_outcome_that_no_step_has_is_refused(outcome: object, taau: Model, file: Path) -> None:
    recorded(taau, file).close()
    append(file, {"call": "step", "frame": FRAME}, outcome)
    with pytest.raises(RecordingError, match="line 5"):
        list(open_recording(file))


def test_a_line_without_end_is_refused_before_it_is_read_whole(taau: Model, file: Path) -> None:
    recorded(taau, file).close()
    with (file / "calls.jsonl").open("a") as log:
        log.write('"' + "a" * MAX_LINE)
    with pytest.raises(RecordingError, match="line 4 is longer than 4 MiB"):
        list(open_recording(file))
    (file / "calls.jsonl").write_bytes(b"[" * 100_000 + b"\n")
    with pytest.raises(RecordingError, match="line 1 is not JSON"):
        list(open_recording(file))


@pytest.mark.parametrize("name", ["calls.jsonl", "0000.exr", "sampled/0000.exr", "last.exr"])
def test_a_link_out_of_the_folder_is_not_followed(name: str, taau: Model, file: Path) -> None:
    recorded(taau, file).close()
    outside = file.parent / "outside"
    (file / name).rename(outside)
    (file / name).symlink_to(outside)
    with pytest.raises(RecordingError, match="leads out of"):
        list(open_recording(file))


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="Windows has no named pipes")
@pytest.mark.parametrize("name", ["recording.json", "calls.jsonl", "0000.exr"])
def test_a_pipe_in_place_of_a_file_is_refused(name: str, taau: Model, file: Path) -> None:
    recorded(taau, file).close()
    (file / name).unlink()
    os.mkfifo(file / name)
    with pytest.raises(RecordingError):
        list(open_recording(file))


def test_a_state_in_a_recording_is_checked_as_any_state(taau: Model, file: Path) -> None:
    upscaler = recorded(taau, file)
    upscaler.load_state(upscaler.save_state())
    upscaler.close()
    path = file / "states" / "0000.safetensors"
    arrays = {name: np.array(array) for name, array in open_safetensors(path)[0].items()}
    write_safetensors(path, {**arrays, "history.surface": arrays["history.surface"][..., 1:]})
    replay = Replay(open_recording(file))
    with pytest.raises(ArgumentError, match=r"state is with 'history\.surface'"):
        list(map(replay.call, replay.recording))


def test_pixels_of_another_size_are_beyond_tolerance(taau: Model, file: Path) -> None:
    recorded(taau, file).close()
    write_exr(file / "sampled" / "0000.exr", np.zeros((2, 2, 3), np.float16))
    log = (file / "calls.jsonl").read_text()
    (file / "calls.jsonl").write_text(re.sub(r'"image": \d+', '"image": 1', log))
    replay = Replay(open_recording(file))
    (step,) = filter(None, map(replay.call, replay.recording))
    assert (step.exact, step.within) == (False, False)


def test_a_frame_beyond_memory_is_refused(taau: Model, file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    recorded(taau, file).close()

    def full(*_: object, **__: object) -> None:
        raise MemoryError

    monkeypatch.setattr(np, "stack", full)
    with pytest.raises(RecordingError, match="needs more memory than there is"):
        list(open_recording(file))
