"""Training on two processes ends with the weights of one, also if a process is killed and the run resumed."""

import os
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

import shared_run
from gbuffer_sets import gbuffer_data
from supersampler_model.data.dataset.storage import write_training_frame
from supersampler_model.training.trainer import CHECKPOINT, load_checkpoint

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="finds processes in /proc")

TWO = [sys.executable, "-m", "torch.distributed.run", "--standalone", "--nproc-per-node", "2"]


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two sets; in the second some crops know less of the reference than others."""
    folder = tmp_path_factory.mktemp("sets")
    _, partly = (gbuffer_data(folder / name) for name in (shared_run.WHOLE, shared_run.PARTLY))
    [entry] = partly.entries("train")
    for index, frame in enumerate(partly.frames(entry)):
        reference = frame.reference.copy()
        reference[: 5 * index % 32] = np.nan
        write_training_frame(partly.path(entry, index), replace(frame, reference=reference))
    return folder


@pytest.fixture(scope="module")
def shared(data: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folders of the runs of `shared_run`, on two processes."""
    folder = tmp_path_factory.mktemp("shared")
    subprocess.run([*TWO, str(shared_run.__file__), str(data), str(folder)], check=True, timeout=300)
    return folder


@pytest.mark.parametrize("name", shared_run.TASKS)
def test_two_processes_end_with_the_weights_of_one(
    data: Path, shared: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    monkeypatch.setattr("torch.autocast", shared_run.FullPrecision)
    run = shared_run.trainer(name, data, tmp_path / name)
    first = {key: tensor.clone() for key, tensor in run.method.state_dict().items()}
    run.run()
    found = load_checkpoint(shared / name / CHECKPOINT)["method"]
    for key, alone in run.method.state_dict().items():
        moved, off = ((alone - other).double().norm() for other in (first[key], found[key]))
        assert off <= 0.01 * moved, key


def test_a_run_of_two_processes_of_which_one_is_killed_goes_on_to_the_same_weights(
    data: Path, shared: Path, tmp_path: Path
) -> None:
    plan = shared_run.COMMAND
    settings = {
        "steps": plan.steps,
        "batch": plan.batch,
        "frames": plan.frames,
        "size": plan.size,
        "every": 2,
    }
    options = [word for name, value in settings.items() for word in (f"--{name}", str(value))]
    folders = ["--data", str(data / shared_run.PARTLY), "-o", str(tmp_path)]
    train = [sys.executable, "-m", "supersampler", "train", "classifier", *folders, *options]
    command = [*TWO, "--no-python", *train]
    with subprocess.Popen(command) as run:
        while not (tmp_path / CHECKPOINT).exists():
            assert run.poll() is None
            time.sleep(0.01)
        os.kill(workers(run.pid)[1], signal.SIGKILL)
        assert run.wait(timeout=300) != 0
    assert load_checkpoint(tmp_path / CHECKPOINT)["done"] < plan.steps
    subprocess.run(command, check=True, timeout=300)
    resumed, whole = (load_checkpoint(folder / CHECKPOINT) for folder in (tmp_path, shared / "command"))
    assert resumed["done"] == whole["done"] == plan.steps
    for kind in ("method", "average"):
        for key, value in whole[kind].items():
            assert torch.equal(value, resumed[kind][key]), key


def workers(parent: int) -> list[int]:
    """Process ids of the children of a process."""
    return [int(pid) for pid in Path(f"/proc/{parent}/task/{parent}/children").read_text().split()]
