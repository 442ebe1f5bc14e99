"""The job template of examples/farm, run by the command line of Open Job Description."""

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from commands import finished, processes, ran
from supersampler.io.display import decibels, display_transform
from upscale_runs import pixels, upscale, write_shot

pytest.importorskip("openjd.cli", reason="needs openjd-cli")

TEMPLATE = Path(__file__).parents[2] / "examples" / "farm" / "supersample.yaml"
FRAMES, CHUNK, PREROLL = 24, 8, 6
METHOD = "taau"
MIN_DECIBELS = 60.0  # dB, of a chunk's images against those of one run


@pytest.fixture(scope="module", autouse=True)
def _own_sessions(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Give Open Job Description its own temporary folder: /tmp/OpenJD may belong to another user."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("TMPDIR", str(tmp_path_factory.mktemp("sessions")))
        yield


@pytest.fixture(scope="module")
def shot(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A shot whose light drifts; its exposure is measured."""
    return write_shot(tmp_path_factory.mktemp("farm") / "shot", FRAMES, light=1.03)


@pytest.fixture(scope="module")
def chunks(shot: Path) -> tuple[Path, str]:
    """Images of a job, and what its session printed."""
    folder = shot.parent / "job"
    return folder, ran(*job(shot, folder))


def job(shot: Path, output: Path, *options: str) -> list[str]:
    values = {
        "Shot": shot, "Output": output, "Frames": f"0-{FRAMES - 1}", "ChunkSize": CHUNK, "Preroll": PREROLL,
        "Method": METHOD, "Scale": 2, "ShotOptions": "--layout auto", "Options": "--threads 1",
        "Python": sys.executable,
    }  # fmt: skip
    given = [text for name, value in values.items() for text in ("-p", f"{name}={value}")]
    return [sys.executable, "-m", "openjd", "run", str(TEMPLATE), *given, *options]


def tasks(*ranges: str) -> tuple[str, ...]:
    return "--step", "Upscale", "--tasks", json.dumps([{"Frames": text} for text in ranges])


def images(folder: Path) -> list[np.ndarray]:
    paths = sorted(folder.glob("[0-9]*.exr"))
    assert [path.stem for path in paths] == [f"{index:04d}" for index in range(FRAMES)]
    return [pixels(path) for path in paths]


def kill_with_descendants(process: subprocess.Popen[bytes]) -> None:
    """Kill a process and all that it started: the session's tasks have process groups of their own."""
    doomed, all_processes = [process.pid], processes()
    for pid in doomed:
        doomed += [each.pid for each in all_processes if each.parent == pid]
    for pid in doomed:
        with suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)
    process.wait()


def test_a_job_of_chunks_has_the_images_of_one_run(shot: Path, chunks: tuple[Path, str]) -> None:
    whole = shot.parent / "whole"
    upscale(shot, whole, "--preroll", PREROLL, "--threads", 1, method=METHOD)
    for index, (image, other) in enumerate(zip(images(chunks[0]), images(whole), strict=True)):
        if index < CHUNK:
            assert np.array_equal(image, other), index
        error = np.square(display_transform(image) - display_transform(other)).mean()
        assert decibels(float(error)) > MIN_DECIBELS, index


def test_tasks_report_their_progress(chunks: tuple[Path, str]) -> None:
    assert chunks[1].count("openjd_progress: 100.0") == FRAMES // CHUNK
    assert f"openjd_status: frame {FRAMES - 1}" in chunks[1]


@pytest.mark.skipif(not Path("/proc/self/stat").exists(), reason="needs /proc, to find a process's children")
def test_a_killed_worker_of_two_is_restarted(shot: Path, chunks: tuple[Path, str], tmp_path: Path) -> None:
    output = tmp_path / "out"
    commands = [job(shot, output, *tasks("0-7")), job(shot, output, *tasks("8-15", "16-23"))]
    first, second = (subprocess.Popen(command, stdout=subprocess.DEVNULL) for command in commands)
    ends = time.monotonic() + 120.0
    while not (output / "0008.exr").exists() and time.monotonic() < ends:
        time.sleep(0.002)
    kill_with_descendants(second)
    assert (output / "0008.exr").exists()
    assert not (output / "0023.exr").exists()
    kept = (output / "0008.exr").stat().st_mtime_ns
    ran(*commands[1])
    assert first.wait(120.0) == 0
    assert (output / "0008.exr").stat().st_mtime_ns == kept
    for index, (image, other) in enumerate(zip(images(output), images(chunks[0]), strict=True)):
        assert np.array_equal(image, other), index


def test_a_failing_chunk_fails_the_job(shot: Path) -> None:
    done = finished(*job(shot, shot.parent / "missing", *tasks("0-7"), "-p", "Options=--method nothing"))
    assert done.returncode != 0
    assert "nothing" in done.stdout


def test_a_shot_with_wrong_signs_begins_no_chunk(shot: Path) -> None:
    output = shot.parent / "wrong"
    wrong = "ShotOptions=--conventions streamline"  # the layout does not take it
    assert finished(*job(shot, output, "-p", wrong)).returncode != 0
    assert not output.exists()
