"""A recording of a stranger is refused where it holds what no Upscaler writes."""

import json
import struct
import zlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from noise import noise
from supersampler import ArgumentError, Model, Upscaler
from supersampler.errors import RecordingError
from supersampler.recording import open_recording
from supersampler.recording.format import MAGIC, Record, RecordWriter, read_records
from supersampler.recording.replay import Replay

FRAME = {
    name: np.zeros((2, 2, *channels), np.float32)
    for name, channels in (("color", [3]), ("depth", []), ("motion", [2]))
}


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
    text = {"record": "setup", **next(read_records(file)).values, **changes, "arrays": []}
    content = json.dumps(text).encode()
    head = struct.pack("<QII", len(content), len(content), zlib.crc32(content))
    file.write_bytes(MAGIC + head + struct.pack("<I", zlib.crc32(head)) + content)
    with pytest.raises(RecordingError, match="a 'setup' record that no Upscaler writes"):
        open_recording(file)


@pytest.mark.parametrize(
    "record",
    [
        Record("step", {"frame": {"jitter": [0, 0], "gbuffer": True}, "outputs": []}, FRAME),
        Record("step", {"frame": {"jitter": [0, 10**400]}, "outputs": []}, FRAME),
        Record("step", {"frame": {"jitter": [0, 0]}, "outputs": "aovs", "tensors": False}, FRAME),
        Record("outcome", {"digests": {"image": 2**40}, "error": ["", ""]}),
        Record("outcome", {"digests": {}, "error": ["", "", ""]}),
        Record("outcome", {"digests": {}, "error": ["", ""]}, {"image": np.ones((2, 2), np.float32)}),
        Record("outcome", {"digests": {}, "error": ["", ""]}, {"image": np.ones((2, 2, 3), bool)}),
        Record("close", arrays={"image": np.ones((2, 2, 3), np.int32)}),
        Record(
            "load_state", {"method": "taau", "display_size": [1, 2**40], "render_size": None, "past": False}
        ),
    ],
)
def test_what_a_reader_would_stumble_over_is_refused(record: Record, taau: Model, file: Path) -> None:
    recorded(taau, file).close()
    records = list(read_records(file))
    other = file.with_name("other")
    writer = RecordWriter(other)
    for each in (*records[:2], record):
        writer.write(each)
    with pytest.raises(RecordingError, match="no Upscaler writes"):
        list(open_recording(other))


def test_a_state_in_a_recording_is_checked_as_any_state(taau: Model, file: Path) -> None:
    upscaler = recorded(taau, file)
    upscaler.load_state(upscaler.save_state())
    upscaler.close()
    other = file.with_name("other")
    writer = RecordWriter(other)
    for record in read_records(file):
        arrays = dict(record.arrays)
        if record.kind == "load_state":
            arrays["history.surface"] = arrays["history.surface"][..., 1:]
        writer.write(Record(record.kind, record.values, arrays))
    replay = Replay(open_recording(other))
    with pytest.raises(ArgumentError, match=r"state is with 'history\.surface'"):
        list(map(replay.call, replay.recording))


def test_a_record_beyond_memory_is_refused(taau: Model, file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    recorded(taau, file).close()
    recording = open_recording(file)

    def full(*_: object) -> None:
        raise MemoryError

    monkeypatch.setattr(np, "empty", full)
    with pytest.raises(RecordingError, match=r"a record at byte \d+ beyond memory"):
        list(recording)
