"""Tests that manipulated recordings are refused with RecordingError."""

import json
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from noise import noise
from recorded_files import read, rewrite
from shared_models import shared_model
from supersampler import ArgumentError, Model, Upscaler
from supersampler.errors import RecordingError
from supersampler.recording import CALL, OUTCOME, open_recording
from supersampler.recording.replay import Replay

STEP = {
    "call": "step", "name": "step", "outputs": [], "jitter": [0, 0], "reset": False, "exposure": None,
    "pre_exposure": 1,
}  # fmt: skip
STATE = {
    "call": "load_state", "method": "taau", "display_size": None, "render_size": None, "version": 4,
    "history": False, "shaded": False,
}  # fmt: skip


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


@pytest.mark.parametrize(
    ("record", "message"),
    [
        ({"call": "explode"}, "Invalid value 'explode'"),
        ({"call": 1}, r"Expected `str` - at `\$.call`"),
        ({}, "missing required field `call`"),
        ([], "Expected `object`, got `array`"),
        ({**STEP, "name": "warm_up"}, r"Invalid enum value 'warm_up' - at `\$.name`"),
        ({**STEP, "jitter": [9, 9]}, "frame.jitter"),
        ({**STEP, "jitter": [0, 10**400]}, "jitter"),
        ({**STEP, "exposure": float("nan")}, "is not JSON"),
        ({**STEP, "exposure": -1.0}, "frame.exposure"),
        ({**STEP, "surprise": 1}, "unknown field `surprise`"),
        ({**STEP, "outputs": "aovs"}, r"Expected `array`, got `str` - at `\$.outputs`"),
        ({**STEP, "outputs": [3]}, "outputs"),
        ({**STATE, "method": 1}, "method"),
        ({**STATE, "display_size": "ab"}, "display_size"),
        ({**STATE, "history": None}, "history"),
        ({**STATE, "shaded": 1}, "shaded"),
        ({**STATE, "version": "1"}, "version"),
        ({"call": "close", "image": 1}, "unknown field `image`"),
        ("x" * 100_000, "Expected `object`"),
        (None, "Expected `object`"),
    ],
)
def test_a_call_that_no_upscaler_writes_is_refused(
    record: object, message: str, taau: Model, file: Path
) -> None:
    recorded(taau, file).close()
    path = file / CALL.format(0)
    rewrite(path, json.dumps(record), read(path)[1])
    with pytest.raises(RecordingError, match=message):
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
    path = file / OUTCOME.format(0)
    rewrite(path, json.dumps(outcome), read(path)[1])
    with pytest.raises(RecordingError, match=r"000000\.safetensors: is not as expected"):
        list(open_recording(file))


@pytest.mark.parametrize("missing", ["depth", "motion"])
def test_a_frame_without_an_array_is_refused(missing: str, taau: Model, file: Path) -> None:
    recorded(taau, file).close()
    path = file / CALL.format(0)
    text, arrays = read(path)
    rewrite(path, text, {name: array for name, array in arrays.items() if name != missing})
    with pytest.raises(RecordingError, match=rf"no Upscaler writes \(frame\.{missing}"):
        list(open_recording(file))


def test_nested_json_is_refused(taau: Model, file: Path) -> None:
    recorded(taau, file).close()
    rewrite(file / CALL.format(0), '{"call":' + "[" * 100_000, {})
    with pytest.raises(RecordingError, match=r"000000\.safetensors: is not"):
        list(open_recording(file))


@pytest.mark.parametrize("name", [CALL.format(0), OUTCOME.format(0), "calls"])
def test_a_link_out_of_the_folder_is_not_followed(name: str, taau: Model, file: Path) -> None:
    recorded(taau, file).close()
    outside = file.parent / "outside"
    (file / name).rename(outside)
    (file / name).symlink_to(outside)
    with pytest.raises(RecordingError, match="leads out of"):
        list(open_recording(file))


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="Windows has no named pipes")
@pytest.mark.parametrize("name", ["recording.json", CALL.format(0), OUTCOME.format(0)])
def test_a_pipe_in_place_of_a_file_is_refused(name: str, taau: Model, file: Path) -> None:
    recorded(taau, file).close()
    (file / name).unlink()
    os.mkfifo(file / name)
    with pytest.raises(RecordingError):
        list(open_recording(file))


@pytest.mark.parametrize("name", [CALL.format(0), OUTCOME.format(0), CALL.format(1)])
def test_a_flipped_bit_in_arrays_is_found(name: str, taau: Model, file: Path) -> None:
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
    path = file / CALL.format(1)
    text, arrays = read(path)
    rewrite(path, text, {**arrays, "history.surface": arrays["history.surface"][..., 1:]})
    replay = Replay(open_recording(file))
    with pytest.raises(ArgumentError, match=r"state is with 'history\.surface'"):
        list(map(replay.call, replay.recording))


def test_pixels_of_another_size_are_beyond_tolerance(taau: Model, file: Path) -> None:
    recorded(taau, file).close()
    rewrite(
        file / OUTCOME.format(0), '{"returned": {"image": 1}}', {"image": np.zeros((2, 2, 3), np.float32)}
    )
    replay = Replay(open_recording(file))
    (step,) = filter(None, map(replay.call, replay.recording))
    assert (step.exact, step.within) == (False, False)


def test_a_frame_beyond_memory_is_refused(taau: Model, file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    recorded(taau, file).close()

    def full(*_: object, **__: object) -> None:
        raise MemoryError

    monkeypatch.setattr("supersampler.recording.open_safetensors", full)
    with pytest.raises(RecordingError, match="needs more memory than there is"):
        list(open_recording(file))
