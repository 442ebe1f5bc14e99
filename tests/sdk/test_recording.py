"""Tests of recordings: all calls and their results, bit for bit, also after crashes and on full disks."""

import json
import os
import shutil
import subprocess
import sys
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from noise import full_noise, noise
from recorded_files import DISPLAY, read, recorded, replayed, rewrite
from shared_models import shared_model
from supersampler import ArgumentError, Frame, FrameError, Model, Upscaler
from supersampler.backends.onnx.session import planes_of
from supersampler.errors import RecordingError
from supersampler.frame import Float32
from supersampler.io.files import IMAGE_BYTES
from supersampler.methods.model_file import CONTRACT
from supersampler.recording import (
    CALL,
    OUTCOME,
    CloseCall,
    LoadStateCall,
    ResetCall,
    StepCall,
    open_recording,
)
from supersampler.recording.replay import Replay
from upscale_runs import files


@pytest.fixture
def file(tmp_path: Path) -> Path:
    return tmp_path / "new folder" / "a.recording"


def interrupt(*_: object, **__: object) -> None:
    raise KeyboardInterrupt  # no signal: what runs in the background of a shell ignores those


def is_exact(file: Path, **options: Any) -> list[bool | None]:
    return [step.exact for step in replayed(file, **options)]


@pytest.mark.parametrize("name", ["taau", "classifier"])
def test_a_replay_is_bit_for_bit_what_was_recorded(name: str, file: Path) -> None:
    made: list[Float32 | None] = []
    with recorded(file, shared_model(name), skip=False) as upscaler:
        maps = ("aovs", "ids", *shared_model(name).info.maps)
        for seed, size in enumerate([(32, 18), (32, 18), (43, 24)]):
            result: Any = upscaler.step(full_noise(seed, size), outputs=maps)
            made.append(result.image)
        state = upscaler.save_state()
        made += [upscaler.step(noise(seed)) for seed in (3, 4)]
        upscaler.load_state(state)
        made.append(upscaler.step(noise(5)))
        with pytest.raises(FrameError, match="size"):
            upscaler.step(noise(6, (128, 72)))
        made += [None, upscaler.step(noise(7))]
        upscaler.reset()
        made += [upscaler.step(noise(8)), upscaler.step(noise(0, reset=True))]
    steps = replayed(file)
    assert [step.exact for step in steps] == [True] * len(made)
    np.testing.assert_equal([step.result and step.result.image for step in steps], made)


def test_recorded_calls_are_read_unchanged(file: Path) -> None:
    frame = full_noise(1)
    with recorded(file, scale=2.0, display_size=None, at_rest="off") as upscaler:
        upscaler.step(frame, outputs=["aovs"])
        state = upscaler.save_state()
        upscaler.load_state(state)
        upscaler.reset()
    recording = open_recording(file)
    calls: list[Any] = list(recording)
    assert [type(call) for call in calls] == [StepCall, LoadStateCall, ResetCall, CloseCall]
    step, loaded = calls[:2]
    read = replace(frame, gbuffer=None, gbuffer_display=None)  # which the method does not look at
    for field in fields(Frame):
        np.testing.assert_equal(getattr(step.frame, field.name), getattr(read, field.name))
    assert step.frame.color.dtype == np.float16
    assert (step.index, step.outputs) == (0, ("aovs",))
    assert (loaded.state.method, loaded.state.render_size) == (state.method, state.render_size)
    np.testing.assert_equal(loaded.state.history, state.history)
    setup = recording.setup
    assert (setup.method, setup.display_size, setup.scale, setup.at_rest) == ("taau", None, 2.0, "off")
    assert setup.versions["supersampler"]
    assert setup.machine["cores"]
    for item in file.rglob("*.*"):
        assert str(file.parent).encode() not in item.read_bytes()  # no path of the user's


def test_texts_of_numpy_are_recorded(file: Path) -> None:
    text: Any = np.str_
    with recorded(file, at_rest=text("off"), validate=text("off")) as upscaler:
        upscaler.step(noise(1), outputs=[text("weight")])
    assert is_exact(file) == [True]


def test_recorded_tensors_are_replayed_as_tensors(file: Path) -> None:
    with recorded(file, shared_model("taau", "onnx"), validate="strict") as upscaler:
        for seed in range(3):
            frame = noise(seed)
            images = {name: planes_of(getattr(frame, name)) for name in ("color", "depth", "motion")}
            images["color"][0, :, 3, 5] = np.nan  # which `step` would refuse
            images["reactive"] = np.full((1, 1, *frame.depth.shape), 0.25, np.float32)
            given: Any = {"jitter": frame.jitter, "reset": frame.reset}
            upscaler.step_tensors(images, exposure=0.5, pre_exposure=3.0, **given)
        for broken in ({**images, "depth": np.zeros((1, 1, 4, 4), np.float32)}, {"color": images["color"]}):
            with pytest.raises(FrameError, match="depth"):
                upscaler.step_tensors(broken, jitter=(0.0, 0.0))
    *steps, _ = open_recording(file)
    assert {isinstance(call, StepCall) and call.name for call in steps} == {"step_tensors"}
    assert is_exact(file) == [True] * 3
    assert not replayed(file, executor="cpu")[0].exact


def test_wrong_calls_and_ctrl_c_are_not_recorded(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with recorded(file) as upscaler:
        upscaler.step(noise(0))
        with pytest.raises(ArgumentError, match="out"):
            upscaler.step(noise(1), out=np.empty((1, 1, 3), np.float32))
        with pytest.raises(ArgumentError, match="outputs"):
            upscaler.step(noise(1), outputs=(3,))  # type: ignore[arg-type]
        with monkeypatch.context() as patch:
            patch.setattr(Model, "run_checked", interrupt)
            with pytest.raises(KeyboardInterrupt):
                upscaler.step(noise(1))
        upscaler.step(noise(2))
    assert is_exact(file) == [True, True]


@pytest.mark.parametrize("moment", ["recorder.returned", "OutcomeRecord"])
def test_ctrl_c_leaves_the_step_without_an_outcome(
    file: Path, monkeypatch: pytest.MonkeyPatch, moment: str
) -> None:
    with recorded(file) as upscaler:
        upscaler.step(noise(0))
        with monkeypatch.context() as patch:
            patch.setattr(f"supersampler.recording.{moment}", interrupt)
            with pytest.raises(KeyboardInterrupt):
                upscaler.step(noise(1))
        upscaler.step(noise(2))
    assert is_exact(file) == [True, None, True]


def test_a_replay_reports_an_error_of_one_side_only(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object, **__: object) -> None:
        raise ZeroDivisionError("by zero")

    with recorded(file) as upscaler:
        upscaler.step(noise(0))
        with monkeypatch.context() as patch:
            patch.setattr(Model, "run_checked", fail)
            with pytest.raises(ZeroDivisionError):
                upscaler.step(noise(1))
    second = replayed(file)[1]
    assert (second.exact, second.within) == (False, False)
    assert second.note == "raises nothing; recorded: ZeroDivisionError (by zero)"
    with monkeypatch.context() as patch:
        patch.setattr(Model, "run_checked", fail)
        other, same = replayed(file)
    assert (other.within, same.within) == (False, True)
    assert other.note == "raises ZeroDivisionError (by zero); recorded: nothing"


def test_a_recording_of_a_custom_model_asks_for_its_folder(file: Path) -> None:
    own = file.parent / "mine"
    shutil.copytree(shared_model("taau").info.folder, own)
    with recorded(file, Model.load(own, threads=1)) as upscaler:
        upscaler.step(noise(0))
    with pytest.raises(RecordingError, match=r"model 'mine' \(taau\), which does not ship.*--model FOLDER"):
        replayed(file)
    assert replayed(file, model=own)[0].exact


def test_relative_paths_outlive_a_change_of_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shutil.copytree(shared_model("taau").info.folder, tmp_path / "mine")
    monkeypatch.chdir(tmp_path)
    upscaler = Upscaler("mine", display_size=DISPLAY, threads=1, record="a.recording")
    monkeypatch.chdir("/")
    for seed in range(2):
        upscaler.step(full_noise(seed), outputs=("aovs",))  # loads another graph
    assert is_exact(tmp_path / "a.recording", model=tmp_path / "mine") == [True] * 2


def test_a_shipped_model_that_has_changed_is_named(file: Path) -> None:
    recorded(file).close()
    setup = json.loads((file / "recording.json").read_text())
    setup["files"]["step.onnx"] = 64 * "0"
    (file / "recording.json").write_text(json.dumps(setup))
    with pytest.raises(RecordingError, match=r"another 'taau': step\.onnx differs \(recorded .*--model"):
        replayed(file)
    assert not Replay(open_recording(file), model="taau").is_recorded_model


# --- crashes, full disks and damaged files ---


def test_an_upscaler_that_is_dropped_leaves_all_its_frames(file: Path) -> None:
    upscaler = recorded(file)
    upscaler.step(noise(0))
    upscaler.step(noise(1))
    del upscaler
    assert is_exact(file) == [True, True]
    assert not any(isinstance(call, CloseCall) for call in open_recording(file))


def test_a_process_killed_in_a_step_leaves_a_recording_of_the_steps_before(file: Path) -> None:
    command = [sys.executable, "-c", _KILLED_IN_THE_THIRD_STEP, str(file)]
    done = subprocess.run(command, cwd=Path(__file__).parents[1], check=False)
    assert done.returncode == -9
    assert is_exact(file) == [True, True, None]


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
    ("name", "content", "problem"),
    [
        (CALL.format(1), b"x", "is not a safetensors file"),
        (CALL.format(1), None, "there is no such file"),
        (OUTCOME.format(1), b"x", "is not a safetensors file"),
    ],
)
def test_frames_before_a_damaged_file_are_read(file: Path, name: str, content: Any, problem: str) -> None:
    with recorded(file) as upscaler:
        upscaler.step(noise(0))
        upscaler.step(noise(1))
    (file / name).unlink() if content is None else (file / name).write_bytes(content)
    calls = iter(open_recording(file))
    assert isinstance(next(calls), StepCall)
    with pytest.raises(RecordingError, match=f"{name}: {problem}.*The recording is damaged"):
        list(calls)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ({"format": 99}, "is of format 99; this package reads 6"),
        ({"format": 6, "contract": 99}, "is of contract 99; this package reads"),
        ({"format": 6, "contract": CONTRACT}, "missing required field `folder`"),
        ([], "Expected `object`, got `array`"),
    ],
)
def test_a_recording_of_another_version_is_refused(content: object, message: str, file: Path) -> None:
    file.mkdir(parents=True)
    (file / "recording.json").write_text(json.dumps(content))
    with pytest.raises(RecordingError, match=message):
        open_recording(file)


def test_a_path_that_is_not_a_recording_is_refused_and_an_existing_one_is_kept(file: Path) -> None:
    with pytest.raises(RecordingError, match="there is no such folder"):
        open_recording(file)
    recorded(file).close()
    before = files(file)
    with pytest.raises(RecordingError, match=r"already exists\. Choose another name"):
        recorded(file)
    assert files(file) == before
    for path in (file.parent, file / "recording.json"):
        with pytest.raises(RecordingError, match="is not a recording"):
            open_recording(path)


@pytest.mark.parametrize("full", [CALL.format(1), OUTCOME.format(1)])
def test_a_full_disk_ends_the_recording_with_the_last_step(
    full: str, file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Before the step it is refused; after it, the next one is."""
    upscaler, plain = recorded(file), Upscaler(shared_model("taau"), display_size=DISPLAY)
    upscaler.step(noise(0))
    plain.step(noise(0))
    before, seed, replace_file = files(file), 1, Path.replace

    def refuse(part: Path, to: Path) -> Path:
        if to == file / full:
            raise OSError(28, "No space left on device")
        return replace_file(part, to)

    with monkeypatch.context() as patch:
        patch.setattr(Path, "replace", refuse)
        if full == OUTCOME.format(1):
            np.testing.assert_array_equal(upscaler.step(noise(seed)), plain.step(noise(seed)))
            seed += 1
        with pytest.raises(RecordingError, match=r"cannot be written .* Is the disk full"):
            upscaler.step(noise(seed))
    assert files(file) == before
    np.testing.assert_array_equal(upscaler.step(noise(seed)), plain.step(noise(seed)))
    upscaler.close()
    assert is_exact(file) == [True]


# --- manipulated recordings are refused with RecordingError ---


STEP = {
    "call": "step", "name": "step", "outputs": [], "jitter": [0, 0], "reset": False, "exposure": None,
    "pre_exposure": 1,
}  # fmt: skip
STATE = {
    "call": "load_state", "method": "taau", "display_size": None, "render_size": None, "version": 4,
    "history": False, "shaded": False,
}  # fmt: skip


def begun(file: Path) -> Upscaler:
    upscaler = recorded(file)
    upscaler.step(noise(0))
    return upscaler


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("threads", -1), ("threads", 10**6), ("display_size", [2**40, 2**40]), ("scale", 1e300),
        ("skip", "exact"), ("at_rest", "never"), ("executor", "tpu"), ("providers", [1]),
        ("files", {"step.onnx": 1}), ("extrapolation", {"folder": "x"}),
    ],
)  # fmt: skip
def test_an_invalid_setup_is_refused(name: str, value: object, file: Path) -> None:
    begun(file).close()
    setup = json.loads((file / "recording.json").read_text())
    (file / "recording.json").write_text(json.dumps({**setup, name: value}))
    with pytest.raises(RecordingError, match=name):
        open_recording(file)


CALLS: list[tuple[Any, str]] = [
    ({"call": "explode"}, "Invalid value 'explode'"),
    ({}, "missing required field `call`"),
    ([], "Expected `object`, got `array`"),
    ({**STEP, "name": "warm_up"}, r"Invalid enum value 'warm_up' - at `\$.name`"),
    ({**STEP, "jitter": [9, 9]}, "frame.jitter"),
    ({**STEP, "exposure": -1.0}, "frame.exposure"),
    ({**STEP, "surprise": 1}, "unknown field `surprise`"),
    ({**STEP, "outputs": "aovs"}, r"Expected `array`, got `str` - at `\$.outputs`"),
    ({**STATE, "method": 1}, "method"),
    ({**STATE, "history": None}, "history"),
    ({"call": "close", "image": 1}, "unknown field `image`"),
    (None, "Expected `object`"),
]


@pytest.mark.parametrize(
    ("name", "record", "message"),
    [
        *((CALL, *case) for case in CALLS),
        (OUTCOME, {"returned": {"image": 2**40}}, "is not as expected"),
        (OUTCOME, {"raised": [1, 2]}, "is not as expected"),
    ],
)
def test_an_unknown_call_or_outcome_is_refused(name: str, record: object, message: str, file: Path) -> None:
    begun(file).close()
    path = file / name.format(0)
    rewrite(path, json.dumps(record), read(path)[1])
    with pytest.raises(RecordingError, match=message):
        list(open_recording(file))


@pytest.mark.parametrize("name", [CALL.format(0), OUTCOME.format(0), "calls"])
def test_a_link_out_of_the_folder_is_not_followed(name: str, file: Path) -> None:
    begun(file).close()
    outside = file.parent / "outside"
    (file / name).rename(outside)
    (file / name).symlink_to(outside)
    with pytest.raises(RecordingError, match="leads out of"):
        list(open_recording(file))


@pytest.mark.parametrize("name", [CALL.format(0), OUTCOME.format(0), CALL.format(1)])
def test_a_flipped_bit_in_arrays_is_found(name: str, file: Path) -> None:
    upscaler = begun(file)
    upscaler.load_state(upscaler.save_state())
    upscaler.close()
    assert len(list(open_recording(file))) == 3
    data = bytearray((file / name).read_bytes())
    data[-7] ^= 1
    (file / name).write_bytes(data)
    with pytest.raises(RecordingError, match=f"{name}: has changed since it was recorded"):
        list(open_recording(file))


def test_pixels_of_another_size_are_beyond_tolerance(file: Path) -> None:
    begun(file).close()
    pixels = {"image": np.zeros((2, 2, 3), np.float32)}
    rewrite(file / OUTCOME.format(0), '{"returned": {"image": 1}}', pixels)
    [step] = replayed(file)
    assert (step.exact, step.within) == (False, False)


def test_a_sparse_file_is_refused_before_it_is_copied(file: Path) -> None:
    begun(file).close()
    path = file / CALL.format(0)
    count = IMAGE_BYTES + 1
    header = json.dumps({"color": {"dtype": "U8", "shape": [count], "data_offsets": [0, count]}}).encode()
    path.write_bytes(len(header).to_bytes(8, "little") + header)
    os.truncate(path, 8 + len(header) + count)
    with pytest.raises(RecordingError, match="has 8 GiB of arrays; want at most 8"):
        list(open_recording(file))


def test_a_frame_beyond_memory_is_refused(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    begun(file).close()

    def full(*_: object, **__: object) -> None:
        raise MemoryError

    monkeypatch.setattr("supersampler.recording.open_safetensors", full)
    with pytest.raises(RecordingError, match="needs more memory than there is"):
        list(open_recording(file))
