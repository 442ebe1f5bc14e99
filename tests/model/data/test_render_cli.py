"""`supersampler render`: its files, interruptions, full disks and invalid options."""

import multiprocessing
import os
import pickle
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest
from typer.testing import Result

from commands import processes
from gltf_files import cube
from supersampler_model.data.dataset.storage import open_dataset, read_training_frame
from supersampler_model.data.processes import run_parts
from upscale_runs import run, succeeded

SMALL = ("--frames", "2", "--display-size", "64x36", "--samples", "4", "--ratio", "2")


def render(*arguments: object) -> Result:
    return run("render", *arguments)


@pytest.fixture
def files(tmp_path: Path) -> Path:
    folder = tmp_path / "files"
    folder.mkdir()
    cube().save(folder / "cube.glb")
    return folder


@pytest.mark.long  # renders sequences
def test_sequences_of_files_are_rendered_beside_procedural_ones(files: Path, tmp_path: Path) -> None:
    options = ("--scenes", "floors", "--gltf", files, "--gltf-fraction", "0.5", "--sequences", "2", *SMALL)
    answer = succeeded(render(tmp_path / "set", *options))
    assert "4 frames of 64x36" in answer.output
    dataset = open_dataset(tmp_path / "set")
    assert sorted(entry.spec.family for entry in dataset.entries()) == ["floors", "gltf"]
    assert all(dataset.complete(entry) == 2 for entry in dataset.entries())


@pytest.mark.long  # renders sequences
def test_further_ratios_of_a_set_are_rendered_on_request(tmp_path: Path) -> None:
    options = ("--scenes", "floors", "--sequences", "1", *SMALL)
    assert render(tmp_path, *options).exit_code == 0
    before = dict.fromkeys(tmp_path.rglob("*.safetensors"))
    answer = succeeded(render(tmp_path, *options, "--also", "2,4"))
    names = sorted(path.name for path in set(tmp_path.rglob("*.safetensors")) - set(before))
    assert names == [f"000{i}.{r}x.safetensors" for i in range(2) for r in (2, 4)]
    answer = render(tmp_path, *options, "--also", "0.5")
    assert answer.exit_code == 2
    assert "--also" in answer.output


@pytest.mark.long  # renders sequences
def test_a_disk_error_is_one_line_and_the_next_run_continues(tmp_path: Path) -> None:
    options = ("--scenes", "floors", "--sequences", "1", *SMALL)
    out = tmp_path / "set"
    out.mkdir()
    (out / "train").write_text("in the way")
    answer = render(out, *options)
    assert answer.exit_code == 1
    [line] = answer.output.splitlines()
    assert line.startswith(f"error: {out / 'train'}")
    assert "cannot be written" in line
    (out / "train").unlink()
    assert render(out, *options).exit_code == 0


def test_processes_that_have_started_end_where_another_cannot_start() -> None:
    parts: list[Any] = [id, lambda _: None]
    with pytest.raises((pickle.PicklingError, AttributeError), match="lambda"):
        run_parts(parts)
    assert multiprocessing.active_children() == []


@pytest.mark.long  # kills a process
def test_a_killed_run_leaves_whole_frames_ends_its_workers_and_continues(tmp_path: Path) -> None:
    out, options = tmp_path / "set", ("--scenes", "floors", "--sequences", "1", *SMALL, "--frames", "24")
    command = [sys.executable, "-m", "supersampler", "render", str(out), *options]
    process = subprocess.Popen(command, start_new_session=True)
    while not list(out.glob("train/*/0001.safetensors")):
        assert process.poll() is None
        time.sleep(0.02)
    process.kill()
    process.wait()
    _wait_for_the_end_of_group(process.pid)
    [entry] = open_dataset(out).entries()
    there = open_dataset(out).complete(entry)
    assert 2 <= there < 24
    partial = out / entry.folder / ".0023.00000000.partial.safetensors"
    partial.write_bytes(b"half a frame")
    kept = (out / entry.folder / "0000.safetensors").stat().st_mtime_ns
    assert render(out, *options).exit_code == 0
    assert not partial.exists()
    assert (out / entry.folder / "0000.safetensors").stat().st_mtime_ns == kept
    for index in range(24):
        read_training_frame(open_dataset(out).path(entry, index))


def _wait_for_the_end_of_group(group: int) -> None:
    until = time.monotonic() + 100.0
    while any(process.group == group for process in processes()):
        if time.monotonic() > until:
            os.killpg(group, signal.SIGKILL)
            pytest.fail("workers outlive a killed run")
        time.sleep(0.05)


def test_a_broken_file_is_named_before_anything_is_written(files: Path, tmp_path: Path) -> None:
    file = cube()
    file.json["meshes"][0]["primitives"][0]["indices"] = 99
    file.save(files / "worse.glb")
    answer = render(tmp_path / "set", "--gltf", files, *SMALL)
    assert answer.exit_code == 1
    [line] = answer.output.splitlines()
    assert line.startswith(f"error: {files / 'worse.glb'}: mesh 0 'Cube', primitive 0")
    assert not (tmp_path / "set").exists()


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--scenes", "floors, wires"), "error: --scenes is 'wires'; want some of fences, "),
        (("--samples", str(1 << 40)), "error: --samples is 1099511627776; want a square number"),
        (("--frames", "0"), "error: --frames is 0; want 1 to 1048576."),
        (("--frames", str(10**20)), f"error: --frames is {10**20}; want 1 to"),
        (("--sequences", str(10**20)), f"error: --sequences is {10**20}; want 1 to"),
        (("--ratio", "0.5"), "error: --ratio is [0.5]; want some from 1.0 to "),
        (("--gltf", "nowhere"), "error: --gltf is nowhere, which is not a folder; want a folder"),
        (("--gltf-fraction", "0.5"), "error: --gltf-fraction is 0.5; want none without --gltf"),
        (("--ratio", "2;3"), "error: --ratio is '2;3'; want comma-separated numbers"),
        (("--ratio", "nan"), "error: "),
        (("--also", "nan"), "error: "),
        (("--seed", "-1"), "Usage: "),
        (("--workers", "0"), "Usage: "),
    ],
)
def test_a_mistake_is_named_before_anything_is_written(
    tmp_path: Path, options: tuple[str, ...], message: str
) -> None:
    answer = render(tmp_path / "set", *options)
    assert answer.exit_code in (1, 2)
    assert answer.output.lstrip().startswith(message)
    assert message == "Usage: " or len(answer.output.splitlines()) == 1
    assert not (tmp_path / "set").exists()
