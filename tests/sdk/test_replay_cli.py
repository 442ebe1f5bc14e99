"""Tests of `supersampler upscale --record` and `supersampler replay`, with their exit codes."""

import json
from pathlib import Path

import numpy as np
import pytest

from noise import noise
from supersampler import Upscaler
from supersampler.io.images import read_exr
from supersampler.recording import CALL, OUTCOME
from upscale_runs import images, run, succeeded, upscale, write_shot

COUNT = 4


@pytest.fixture
def shot(tmp_path: Path) -> Path:
    return write_shot(tmp_path / "shot", COUNT)


@pytest.fixture
def file(shot: Path, tmp_path: Path) -> Path:
    done = upscale(shot, tmp_path / "out", "--record", tmp_path / "a.recording", method="taau")
    assert f"supersampler replay {tmp_path / 'a.recording'}" in done.stdout
    return tmp_path / "a.recording"


def test_a_replay_of_an_upscaled_shot_is_the_same_images(file: Path, tmp_path: Path) -> None:
    done = succeeded(run("replay", file, "-o", tmp_path / "again"))
    head, recorded, here, verdict = done.stdout.splitlines()
    assert head == f"{file}: taau, to 64x36"
    assert recorded.replace("recorded", "here    ") == here
    assert verdict == f"{COUNT} of {COUNT} frames are bit-identical to the recorded ones."
    assert images(tmp_path / "again") == images(tmp_path / "out")


def test_another_executor_is_reported_and_tolerated(file: Path) -> None:
    done = succeeded(run("replay", file, "--executor", "onnx"))
    assert "CPU (onnx, fp32)" in done.stdout
    assert f"0 of {COUNT} frames are bit-identical to the recorded ones; frame 0 is the first" in done.stdout
    assert "All differences are within tolerance: mean 1e-05, 99th percentile 0.001." in done.stdout


def test_another_image_is_exit_code_1(file: Path, tmp_path: Path) -> None:
    done = run("replay", file, "--model", "taa", "-o", tmp_path / "png", "--format", "png")
    assert done.exit_code == 1
    assert "The model is not the recorded one" in done.stdout
    assert "Largest difference: 0." in done.stdout
    assert "Frame 0 is the first beyond tolerance" in done.stdout
    assert len(list((tmp_path / "png").glob("*.png"))) == COUNT


def test_a_recording_of_existing_frames_holds_all_of_them(file: Path, shot: Path, tmp_path: Path) -> None:
    before = images(tmp_path / "out")
    upscale(shot, tmp_path / "out", "--record", tmp_path / "b", method="taau")
    assert f"{COUNT} of {COUNT} frames are bit-identical" in run("replay", tmp_path / "b").stdout
    assert images(tmp_path / "out") == before


def test_refused_frames_warnings_and_an_early_end_are_reported(tmp_path: Path) -> None:
    color = np.array(noise(1).color)
    color[2, 2] = np.nan
    upscaler = Upscaler("taau", display_size=(64, 36), record=tmp_path / "a")
    upscaler.step(noise(0))
    with pytest.raises(ValueError, match="size"):
        upscaler.step(noise(1, (200, 100)))
    with pytest.warns(UserWarning, match="NaN"):
        upscaler.step(noise(2, color=color))
    del upscaler
    done = succeeded(run("replay", tmp_path / "a"))
    assert "frame 1: raises FrameError (frame.size" in done.stdout
    assert "warning: frame 2: frame.color" in done.stderr
    assert "The recording was not closed" in done.stdout
    assert "3 of 3 frames are bit-identical" in done.stdout


def test_a_frame_in_which_the_process_ended_is_announced(file: Path) -> None:
    (file / OUTCOME.format(COUNT - 1)).unlink()
    (file / CALL.format(COUNT)).unlink()  # close
    done = succeeded(run("replay", file))
    assert f"frame {COUNT - 1}: its outcome was not recorded" in done.stdout
    assert f"{COUNT - 1} of {COUNT - 1} frames are bit-identical to the recorded ones." in done.stdout


def test_a_damaged_file_is_reported_after_the_findings_of_earlier_frames(file: Path) -> None:
    (file / CALL.format(COUNT)).write_bytes(b"damaged")
    done = run("replay", file)
    assert done.exit_code == 1
    assert f"{COUNT} of {COUNT} frames are bit-identical" in done.stdout
    assert "is not a safetensors file" in done.stderr


def test_a_foreign_file_cannot_control_the_terminal(file: Path) -> None:
    setup = json.loads((file / "recording.json").read_text())
    setup["machine"] = {"cpu": "\x1b[2J\nwhat"}
    (file / "recording.json").write_text(json.dumps(setup))
    assert "?[2J?what" in run("replay", file).stdout


def test_images_of_a_replay_hold_aovs(tmp_path: Path) -> None:
    frame = noise(0, aovs=np.full((18, 32, 1), 0.5, np.float32))
    with Upscaler("taau", display_size=(64, 36), record=tmp_path / "a") as upscaler:
        upscaler.step(frame, outputs=("aovs",))
    assert run("replay", tmp_path / "a", "-o", tmp_path / "out").exit_code == 0
    np.testing.assert_allclose(read_exr(tmp_path / "out" / "0000.exr")["A"], 0.5, atol=1e-3)
