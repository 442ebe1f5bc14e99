"""Tests that manipulated recordings are refused with RecordingError."""

import json
import os
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from noise import noise
from recorded_files import mend_hashes
from shared_models import shared_model
from supersampler import ArgumentError, Model, Upscaler
from supersampler.errors import RecordingError
from supersampler.io.images import write_exr
from supersampler.io.shot.safetensors import open_safetensors, write_safetensors
from supersampler.recording import MAX_LINE, open_recording
from supersampler.recording.replay import Replay

FRAME = {"file": "0000.exr", "jitter": [0, 0], "render_size": [32, 18]}
STEP = {"call": "step", "outputs": [], "sha256": dict.fromkeys(("0000.exr", "0009.exr", "shot.json"), "")}
STATE = {"method": "taau", "history": False, "shaded": False, "version": 1}


@pytest.fixture(scope="module")
def taau() -> Model:
    return shared_model("taau")


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
        {"display_size": [2**40, 2**40]},
        {"display_size": "ab"},
        {"scale": 0.5},
        {"scale": 1e300},
        {"skip": 2.0},
        {"skip": "exact"},
        {"at_rest": "never"},
        {"at_rest": True},
        {"executor": "tpu"},
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
        ({"call": "explode"}, "line 4.call is 'explode'"),
        ({"call": 1}, "line 4.call is 1"),
        ({}, "line 4 has no 'call'"),
        ([], "line 4 is "),
        (STEP, "no 'frame'"),
        ({**STEP, "frame": 1}, "line 4.frame is 1"),
        ({**STEP, "frame": {**FRAME, "file": "../0000.exr"}}, "file is "),
        ({**STEP, "frame": {**FRAME, "file": "/etc/passwd"}}, "file is "),
        ({**STEP, "frame": {**FRAME, "file": "0009.exr"}}, "there is no such file"),
        ({**STEP, "frame": {**FRAME, "file": "0001.exr"}}, "sha256 has no '0001.exr'"),
        ({**STEP, "frame": {**FRAME, "file": "shot.json"}}, "is not an EXR image"),
        ({**STEP, "frame": {**FRAME, "jitter": [9, 9]}}, "frame.jitter"),
        ({**STEP, "frame": {**FRAME, "jitter": [0, 10**400]}}, "jitter"),
        ({**STEP, "frame": {**FRAME, "exposure": float("nan")}}, "NaN is not finite"),
        ({**STEP, "frame": {**FRAME, "exposure": -1.0}}, "frame.exposure"),
        ({**STEP, "frame": {**FRAME, "render_size": [18, 32]}}, "32x18"),
        ({**STEP, "frame": {**FRAME, "render_size": None}}, "render_size"),
        ({**STEP, "frame": {**FRAME, "surprise": 1}}, "surprise"),
        ({**STEP, "frame": FRAME, "outputs": "aovs"}, "outputs is 'aovs'"),
        ({**STEP, "frame": {**FRAME, "file": "0009.exr"}, "sha256": {"0009.exr": 7}}, "is 7; want str"),
        ({**STEP, "frame": FRAME, "sha256": []}, r"sha256 is \[\]"),
        ({"call": "load_state", **STATE, "sha256": {"states/0000.safetensors": ""}}, "there is no such file"),
        ({"call": "load_state", **STATE}, "no 'sha256'"),
        ({"call": "close", "sha256": {}}, "sha256 has no 'last.exr'"),
        ({"call": "close", "sha256": 7}, "sha256 is 7"),
    ],
)
def test_a_line_that_no_upscaler_writes_is_refused(
    line: object, message: str, taau: Model, file: Path
) -> None:
    recorded(taau, file).close()
    append(file, line)
    mend_hashes(file)
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
    append(file, {**STEP, "frame": FRAME}, outcome)
    mend_hashes(file)
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


@pytest.mark.parametrize("name", ["0000.exr", "sampled/0000.exr", "states/0000.safetensors", "last.exr"])
def test_a_flipped_bit_in_pixels_or_arrays_is_found(name: str, taau: Model, file: Path) -> None:
    upscaler = recorded(taau, file)
    upscaler.load_state(upscaler.save_state())
    upscaler.close()
    assert len(list(open_recording(file))) == 3
    data = bytearray((file / name).read_bytes())
    data[-7] ^= 1
    (file / name).write_bytes(data)
    with pytest.raises(RecordingError, match=f"{name}: is not as it was recorded"):
        list(open_recording(file))


def test_a_state_in_a_recording_is_checked_as_any_state(taau: Model, file: Path) -> None:
    upscaler = recorded(taau, file)
    upscaler.load_state(upscaler.save_state())
    upscaler.close()
    path = file / "states" / "0000.safetensors"
    arrays = {name: np.array(array) for name, array in open_safetensors(path)[0].items()}
    write_safetensors(path, {**arrays, "history.surface": arrays["history.surface"][..., 1:]})
    mend_hashes(file)
    replay = Replay(open_recording(file))
    with pytest.raises(ArgumentError, match=r"state is with 'history\.surface'"):
        list(map(replay.call, replay.recording))


def test_pixels_of_another_size_are_beyond_tolerance(taau: Model, file: Path) -> None:
    recorded(taau, file).close()
    write_exr(file / "sampled" / "0000.exr", np.zeros((2, 2, 3), np.float16))
    log = (file / "calls.jsonl").read_text()
    (file / "calls.jsonl").write_text(re.sub(r'"image": \d+', '"image": 1', log))
    mend_hashes(file)
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
