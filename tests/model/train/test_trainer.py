"""The trainer: the loss falls, runs resume exactly, fine-tuning, optimizer and run log."""

import csv
import dataclasses
import errno
import multiprocessing
import multiprocessing.connection
import os
import re
import select
import shutil
import signal
import subprocess
import sys
import time
import zipfile
from collections.abc import Callable, Sequence
from itertools import cycle, islice, pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
import typer

from supersampler import halton_jitter
from supersampler.cli import terminal
from supersampler.cli.terminal import Terminal
from supersampler.errors import ArgumentError, ShotError
from supersampler.frame import Size
from supersampler.io.display import decibels, display_transform
from supersampler.io.files import FolderLock
from supersampler.io.shot import ClassMaps, Shot, ShotWriter
from supersampler_model import ops
from supersampler_model.data.dataset import overview
from supersampler_model.data.dataset.storage import (
    Dataset,
    TrainingFrame,
    create_dataset,
    write_training_frame,
)
from supersampler_model.data.errors import DataError, DatasetError
from supersampler_model.data.scenes.analytic import DiscOverPlane
from supersampler_model.methods.base import load_trained
from supersampler_model.methods.classifier import Classifier, SmallClassifier
from supersampler_model.training.classifier_tasks import ClassifierTask
from supersampler_model.training.cli import update_and_save
from supersampler_model.training.datasets import UNKNOWN, data_hash, dataset_of_shots, sequences_of
from supersampler_model.training.losses import ClassifierWeights
from supersampler_model.training.optimizer import orthogonalised
from supersampler_model.training.run_log import write_log
from supersampler_model.training.trainer import (
    CHECKPOINT,
    DivergedError,
    Trainer,
    TrainingPlan,
    Update,
    load_checkpoint,
)
from supersampler_model.training.validation import (
    BORDER,
    CLASS_NAMES,
    WARM_UP,
    SequenceRunner,
    Validated,
    validate,
)
from upscale_runs import run

DISPLAY, RENDER = (64, 48), (32, 24)
PLAN = TrainingPlan(steps=6, batch=2, frames=2, size=32, average=4, settle=0.0)


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    folder = tmp_path_factory.mktemp("set")
    return dataset_of_shots([shot(folder / "shot", every=1, known=True)], folder / "set", "train")


def trainer(dataset: Dataset, folder: Path, plan: TrainingPlan = PLAN, *, workers: int = 0) -> Trainer:
    folder.mkdir(exist_ok=True)
    torch.manual_seed(0)
    return Trainer(ClassifierTask(Classifier()), [dataset], plan, folder, workers=workers)


def test_a_stopped_and_resumed_run_ends_with_the_same_weights(dataset: Dataset, tmp_path: Path) -> None:
    whole = trainer(dataset, tmp_path / "whole")
    whole.run()
    first = trainer(dataset, tmp_path / "parts")
    first.run(until=3)
    first.save()
    second = trainer(dataset, tmp_path / "parts")
    assert second.done == 3
    second.run()
    for one, other in ((whole.method, second.method), (whole.average, second.average)):
        for name, value in one.state_dict().items():
            assert torch.equal(value, other.state_dict()[name]), name


def test_crops_that_workers_cut_ahead_are_the_same(dataset: Dataset, tmp_path: Path) -> None:
    plan = dataclasses.replace(PLAN, batch=3)  # one worker has two streams, the other one
    alone = trainer(dataset, tmp_path / "alone", plan)
    alone.run(until=3)
    ahead = trainer(dataset, tmp_path / "ahead", plan, workers=2)
    ahead.run(until=1)
    ahead.save()
    resumed = trainer(dataset, tmp_path / "ahead", plan, workers=2)
    resumed.run(until=3)
    for name, value in alone.method.state_dict().items():
        assert torch.equal(value, resumed.method.state_dict()[name]), name


@pytest.fixture
def damaged(dataset: Dataset, tmp_path: Path) -> Path:
    """Return a copy of the set whose last frames are cut off."""
    copy = Path(shutil.copytree(dataset.folder, tmp_path / "damaged"))
    for path in sorted(copy.rglob("*.safetensors"))[3:]:
        path.write_bytes(path.read_bytes()[:-10])
    return copy


@pytest.mark.parametrize("workers", [0, 1])
def test_a_damaged_frame_is_named_by_any_process(damaged: Path, tmp_path: Path, workers: int) -> None:
    small = ("--steps", 9, "--size", 17, "--batch", 1, "--frames", 4, "--workers", workers)
    done = run("train", "classifier-small", "--data", damaged, "-o", tmp_path / "run", *small)
    assert done.exit_code == 1
    *_, line = done.stderr.splitlines()
    assert re.search(r"^error: .*\.safetensors: not a whole training frame", line)


def test_the_end_of_a_worker_is_one_line(dataset: Dataset, tmp_path: Path) -> None:
    run = trainer(dataset, tmp_path, workers=1)
    run.run(until=1)
    for worker in multiprocessing.active_children():
        worker.kill()
        multiprocessing.connection.wait([worker.sentinel])  # nothing is raised before its next frame is due
    with pytest.raises(DataError, match=r"worker process .* ended.* Run again to resume") as caught:
        run.run(until=500)
    assert "\n" not in str(caught.value)


def test_a_worker_that_ends_while_it_passes_a_buffer_is_one_line(
    dataset: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refused(_loader: object) -> None:
        raise ConnectionResetError(errno.ECONNRESET, "Connection reset by peer")

    monkeypatch.setattr("torch.utils.data.dataloader._MultiProcessingDataLoaderIter.__next__", refused)
    with pytest.raises(DataError, match=r"worker process .* ended: .*reset by peer\. .* Run again to resume"):
        trainer(dataset, tmp_path, workers=1).run(until=1)


def test_a_worker_that_ends_while_others_start_is_one_line(
    dataset: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def killed(_parts: object) -> None:  # in a signal handler of torch
        raise RuntimeError("DataLoader worker (pid 1) is killed by signal: Killed. ")

    monkeypatch.setattr("supersampler_model.training.prefetch._stop_watching", killed)
    with pytest.raises(DataError, match=r"worker process .* ended: .*Killed\. .* Run again to resume"):
        trainer(dataset, tmp_path, workers=1).run(until=1)


@pytest.mark.skipif(multiprocessing.get_start_method() != "fork", reason="workers would not be patched")
@pytest.mark.timeout(60)
def test_a_worker_that_is_killed_in_the_middle_of_a_message_is_one_line(
    dataset: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A pipe accepts up to PIPE_BUF bytes at once. After half a message, the trainer would wait forever."""
    trains, send = os.getpid(), multiprocessing.connection.Connection._send  # type: ignore[attr-defined]

    def send_and_end(connection: Any, data: bytes, *_: object) -> None:
        if os.getpid() == trains:
            send(connection, data)
            return
        os.write(connection.fileno(), data[: select.PIPE_BUF])
        os.kill(os.getpid(), signal.SIGKILL)

    monkeypatch.setattr("multiprocessing.connection.Connection._send", send_and_end)
    many = dataclasses.replace(PLAN, batch=64, frames=1, size=17)
    with pytest.raises(DataError, match=r"worker process .* ended.* Run again to resume"):
        trainer(dataset, tmp_path, many, workers=1).run(until=1)


class Interrupting(list[Update]):
    """Updates; Ctrl-C is pressed so many times when the second one is added."""

    times = 1

    def append(self, update: Update) -> None:
        super().append(update)
        for _ in range(self.times * (len(self) == 2)):
            signal.raise_signal(signal.SIGINT)


@pytest.mark.parametrize("until", [2, PLAN.steps])
def test_ctrl_c_saves_the_finished_updates(dataset: Dataset, tmp_path: Path, until: int) -> None:
    before, updates = signal.getsignal(signal.SIGINT), Interrupting()
    with pytest.raises(typer.Exit):
        update_and_save(trainer(dataset, tmp_path), until, updates)
    assert load_checkpoint(tmp_path / CHECKPOINT)["done"] == len(updates) == 2
    assert signal.getsignal(signal.SIGINT) is before


def test_ctrl_c_while_updates_are_saved_saves_them(
    dataset: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    save = Trainer.save

    def interrupted(run: Trainer) -> None:
        signal.raise_signal(signal.SIGINT)
        save(run)

    monkeypatch.setattr(Trainer, "save", interrupted)
    with pytest.raises(typer.Exit):
        update_and_save(trainer(dataset, tmp_path), 1, [])
    assert load_checkpoint(tmp_path / CHECKPOINT)["done"] == 1


def test_ctrl_c_saves_the_finished_updates_if_nobody_reads_the_messages(
    dataset: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Ctrl-C also ends `tee` in `supersampler train ... 2>&1 | tee log`."""

    def refuse(*_: object, **__: object) -> None:  # as rich does after a broken pipe
        raise SystemExit(1)

    class Last(list[Update]):
        def append(self, update: Update) -> None:
            super().append(update)
            monkeypatch.setattr(Terminal, "print", refuse)
            signal.raise_signal(signal.SIGINT)

    monkeypatch.setattr(terminal, "LOG_SECONDS", 0.0)
    with pytest.raises(SystemExit):
        update_and_save(trainer(dataset, tmp_path), PLAN.steps, Last())
    assert load_checkpoint(tmp_path / CHECKPOINT)["done"] == 1


def test_ctrl_c_in_the_last_update_ends_as_any_run(dataset: Dataset, tmp_path: Path) -> None:
    run = trainer(dataset, tmp_path, dataclasses.replace(PLAN, steps=2))
    update_and_save(run, 2, Interrupting())
    assert run.done == run.plan.steps


def test_an_ignored_signal_stays_ignored(dataset: Dataset, tmp_path: Path) -> None:
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        updates = Interrupting()
        update_and_save(trainer(dataset, tmp_path), 3, updates)
    finally:
        signal.signal(signal.SIGINT, before)
    assert len(updates) == 3


def test_ctrl_c_twice_stops_at_once(dataset: Dataset, tmp_path: Path) -> None:
    updates = Interrupting()
    updates.times = 2
    with pytest.raises(KeyboardInterrupt):
        update_and_save(trainer(dataset, tmp_path), PLAN.steps, updates)
    assert not (tmp_path / CHECKPOINT).exists()


@pytest.mark.long  # trains in a process of its own
@pytest.mark.skipif(sys.platform != "linux", reason="reads /proc")
def test_sigterm_to_all_processes_saves_the_finished_updates(dataset: Dataset, tmp_path: Path) -> None:
    small = ("--steps", "100000", "--size", "32", "--batch", "2", "--frames", "2", "--workers", "2")
    words = ["train", "classifier-small", "--data", str(dataset.folder), "-o", str(tmp_path), *small]
    command = [sys.executable, "-m", "supersampler", *words]
    with subprocess.Popen(command, stderr=subprocess.PIPE, text=True, start_new_session=True) as process:
        children = Path(f"/proc/{process.pid}/task/{process.pid}/children")
        while len(children.read_text().split()) < 2:
            assert process.poll() is None
            time.sleep(0.05)
        time.sleep(2.0)  # some updates
        os.killpg(process.pid, signal.SIGTERM)
        assert process.stderr is not None
        said = process.stderr.read()
        assert process.wait(timeout=60) == 130, said
    assert "Traceback" not in said
    assert f"Stopped after {load_checkpoint(tmp_path / CHECKPOINT)['done']} updates" in said
    with pytest.raises(ProcessLookupError):
        os.killpg(process.pid, 0)


Relabel = Callable[[int, TrainingFrame], TrainingFrame]


@pytest.fixture
def validated(dataset: Dataset, tmp_path: Path) -> Callable[[Relabel], Validated]:
    """Return a function that validates an untrained network after changing the frames' truth."""
    [entry] = dataset.entries("train")

    def measured(relabel: Relabel) -> Validated:
        other = create_dataset(tmp_path / "set", dataset.description)
        for index in range(entry.spec.frames):
            write_training_frame(other.path(entry, index), relabel(index, dataset.read(entry, index)))
        torch.manual_seed(0)
        return validate(Classifier().eval(), [(other, entry)])

    return measured


def test_pixels_without_a_reference_do_not_count_in_validation(
    dataset: Dataset, validated: Callable[[Relabel], Validated]
) -> None:
    """The last frame has no reference, the one before only half of one."""
    half, last = DISPLAY[0] // 2, dataset.entries("train")[0].spec.frames - 1
    torch.manual_seed(0)
    runner, expected = SequenceRunner(Classifier().eval(), ops.Size(*DISPLAY)), []
    for index, frame in enumerate(dataset.frames(dataset.entries("train")[0])):
        image = runner.step(frame)
        assert image is not None
        shown = display_transform(image[0].permute(1, 2, 0).numpy(), frame.exposure)
        truth = display_transform(frame.reference.astype(np.float32), frame.exposure)
        if WARM_UP <= index < last:
            known = slice(BORDER, half if index == last - 1 else -BORDER)
            rows = slice(BORDER, -BORDER)
            expected.append(decibels(float(np.square(shown - truth, dtype=np.float64)[rows, known].mean())))

    def relabelled(index: int, frame: TrainingFrame) -> TrainingFrame:
        reference = np.array(frame.reference)
        reference[:, {last - 1: half, last: 0}.get(index, DISPLAY[0]) :] = np.nan
        return dataclasses.replace(frame, reference=reference)

    assert validated(relabelled).psnr == pytest.approx(np.mean(expected))


def test_classes_of_the_first_frames_and_of_the_border_do_not_count_in_validation(
    validated: Callable[[Relabel], Validated],
) -> None:
    def relabelled(index: int, frame: TrainingFrame) -> TrainingFrame:
        ghost = 1 - frame.ghost
        if index >= WARM_UP:
            ghost[BORDER:-BORDER, BORDER:-BORDER] = frame.ghost[BORDER:-BORDER, BORDER:-BORDER]
        return dataclasses.replace(frame, ghost=ghost)

    assert validated(relabelled).overlap == validated(lambda _, frame: frame).overlap != {}


def test_unknown_classes_do_not_count_in_validation(
    dataset: Dataset, validated: Callable[[Relabel], Validated]
) -> None:
    torch.manual_seed(0)
    [entry], method = dataset.entries("train"), Classifier().eval()
    runner = SequenceRunner(method, ops.Size(*DISPLAY))
    for frame in dataset.frames(entry):
        runner.step(frame)
    classes = runner.history[list(method.history).index("classes")]
    inferred = ops.resize_nearest(classes[:, :3], ops.Size(*DISPLAY)).argmax(dim=1)[0].numpy()
    ghost, unknown = inferred.astype(np.uint8), np.full(DISPLAY[::-1], UNKNOWN, np.uint8)
    ghost[:, : DISPLAY[0] // 2] = UNKNOWN
    half_known = validated(lambda _, frame: dataclasses.replace(frame, ghost=ghost, alias=unknown)).overlap
    assert set(half_known.values()) == {1.0}
    assert set(half_known) <= set(CLASS_NAMES[:3])
    none = validated(lambda _, frame: dataclasses.replace(frame, ghost=unknown, alias=unknown))
    assert none.overlap == {}


def test_a_run_is_not_resumed_with_another_plan_or_loss(dataset: Dataset, tmp_path: Path) -> None:
    trainer(dataset, tmp_path).save()
    with pytest.raises(ArgumentError, match=r"of another plan \(batch 2\); want the run's own plan"):
        trainer(dataset, tmp_path, dataclasses.replace(PLAN, batch=4))
    task = ClassifierTask(Classifier())
    task.losses = ClassifierWeights(ghost=1.0)
    with pytest.raises(ArgumentError, match="losses"):
        Trainer(task, [dataset], PLAN, tmp_path)
    with pytest.raises(ArgumentError, match=r"another method \(classifier\); want the run's own method"):
        Trainer(ClassifierTask(SmallClassifier()), [dataset], PLAN, tmp_path)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("size", 56), ("size", 16), ("batch", 0), ("frames", 0), ("steps", -3), ("seed", -1),
        ("rate", np.nan), ("rate", np.inf), ("rate", -1.0),
    ],
)  # fmt: skip
def test_an_impossible_plan_is_refused(dataset: Dataset, tmp_path: Path, name: str, value: Any) -> None:
    with pytest.raises(ArgumentError, match=name):
        trainer(dataset, tmp_path, dataclasses.replace(PLAN, **{name: value}))


def test_a_run_whose_loss_is_not_finite_is_not_saved(dataset: Dataset, tmp_path: Path) -> None:
    run = trainer(dataset, tmp_path, dataclasses.replace(PLAN, rate=1e30))
    with pytest.raises(DivergedError, match="lower learning rate"):
        update_and_save(run, PLAN.steps, [])
    assert not (tmp_path / CHECKPOINT).exists()


def test_a_run_takes_its_folder_before_the_first_update(
    dataset: Dataset, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Trainer, "run", lambda *_, **__: pytest.fail("it has trained"))
    command = ["train", "classifier-small", "--data", dataset.folder, "-o", tmp_path, "--size", 17]
    with monkeypatch.context() as full:
        full.setattr(Path, "write_bytes", refuse)
        done = run(*command)
    assert done.exit_code == 1
    assert "checkpoint.pt: cannot be written ([Errno 28] No space left on device)" in done.stderr
    with pytest.raises(pytest.fail.Exception):
        run(*command)
    assert "of another plan (batch 8)" in run(*command, "--batch", 4).stderr


def test_two_runs_do_not_train_in_one_folder_at_once(dataset: Dataset, tmp_path: Path) -> None:
    """A run that follows a killed one also removes its partial checkpoint."""
    partial = tmp_path / ".checkpoint.01234567.partial.pt"
    partial.touch()
    command = [
        "train",
        "classifier-small",
        "--data",
        dataset.folder,
        "-o",
        tmp_path,
        "--steps",
        1,
        "--size",
        17,
    ]
    with FolderLock(tmp_path):
        assert "another run writes to it" in run(*command).stderr
    assert partial.exists()
    assert run(*command).exit_code == 0
    assert not partial.exists()


def refuse(*_: object) -> None:
    raise OSError(28, "No space left on device")


def test_a_resumed_run_keeps_the_provenance_of_its_start(dataset: Dataset, tmp_path: Path) -> None:
    task, origin = ClassifierTask(Classifier()), {"steps": 7, "commit": "x", "data": "y"}
    Trainer(task, [dataset], PLAN, tmp_path, initial=origin, attributions=["someone"]).save()
    for later in ({}, {"steps": 8}):
        facts = Trainer(task, [dataset], PLAN, tmp_path, initial=later).trained({}).facts
        assert (facts["init"], facts["attributions"]) == (origin, ["someone"])
    assert Trainer(task, [dataset], PLAN, tmp_path, attributions=["b"]).attributions == ["b"]


def test_a_run_stopped_in_its_last_validation_ends_with_weights(dataset: Dataset, tmp_path: Path) -> None:
    command = ["train", "classifier-small", "--data", dataset.folder, "-o", tmp_path, "--steps", 1]
    command += ["--size", 17, "--batch", 1, "--frames", 1]
    assert run(*command).exit_code == 0
    for name in ("weights.safetensors", "log.csv"):
        (tmp_path / name).unlink()  # as if it had been stopped before they were written
    assert run(*command).exit_code == 0
    assert load_trained(tmp_path / "weights.safetensors").facts["steps"] == 1
    assert [row["step"] for row in rows(tmp_path)] == ["1.0"]
    assert run(*command).output == "", "nothing is left to do"


def test_sequences_of_ratios_that_the_method_lacks_are_counted(dataset: Dataset, tmp_path: Path) -> None:
    coarse = shot(tmp_path / "coarse", sizes=[(16, 12)])
    command = ["train", "classifier-small", "--data", dataset.folder, "--shot", coarse.path, "-o", tmp_path]
    command += ["--steps", 1, "--size", 17, "--batch", 1, "--frames", 1]
    said = run(*command).stderr
    assert "train-shots: 1 of 1 sequences are not read: classifier-small takes ratios from 1 to 3." in said
    assert said.count("are not read") == 1


def test_a_set_without_training_sequences_is_named(dataset: Dataset, tmp_path: Path) -> None:
    for split in ("validation", "test"):
        dataset_of_shots([shot(tmp_path / split)], tmp_path / f"{split}-set", split)
    for given in (["validation"], ["test"], ["test", dataset.folder]):
        sets = [f"--data={tmp_path / f'{one}-set' if isinstance(one, str) else one}" for one in given]
        result = run("train", "classifier-small", *sets, "-o", tmp_path / "run")
        assert result.exit_code == 2
        text = f"{given[0]}-set, without training sequences; want a training set or a shot"
        assert text in result.output


@pytest.mark.parametrize("text", ["step;loss\n1;0,5\n", "loss\n0.5\n", "step,loss\n1,low\n", "\0\xff"])
def test_a_log_that_another_program_has_rewritten_is_named(tmp_path: Path, text: str) -> None:
    (tmp_path / "log.csv").write_text(text, encoding="latin-1")
    with pytest.raises(ShotError, match=r"log\.csv: is not the log of a run .*Move it away"):
        write_log(tmp_path, 2, {"loss": 0.5})


def test_train_says_which_of_its_arguments_have_no_effect(dataset: Dataset, tmp_path: Path) -> None:
    [entry] = dataset.entries("train")
    few = dataclasses.replace(entry, spec=dataclasses.replace(entry.spec, frames=2), split="validation")
    description = dataclasses.replace(dataset.description, sequences=(entry, few))
    both = create_dataset(tmp_path / "set", description)
    for each in (entry, few):
        for index in range(each.spec.frames):
            write_training_frame(both.path(each, index), dataset.read(entry, index))
    both.path(entry, entry.spec.frames - 1).unlink()
    options = ["--steps", "1", "--size", "17", "--batch", "1", "--frames", "1", "-o", str(tmp_path / "run")]
    command = ["train", "classifier-small", "--data", str(both.folder), *options]
    done = run(*command)
    assert "There are no validation scores: no complete validation sequence has a reference after the" in (
        done.stderr
    )
    assert "only 11 of 12 training frames are rendered" in done.stderr
    done = run(*command, "--init", "shipped")
    assert (done.exit_code, "--init is ignored" in done.stderr) == (0, True)
    write_training_frame(both.path(entry, 11), dataset.read(entry, 11))
    assert "The training set had 11 frames when the run stopped, and has 12 now" in run(*command).stderr
    unknown = [*command, "--init", "shipped"]
    unknown[1] = "classifier-paper"
    assert "--init is 'shipped'; want a file, as no weights ship" in run(*unknown).stderr


def test_a_file_that_is_not_a_checkpoint_is_refused(tmp_path: Path) -> None:
    broken = tmp_path / "checkpoint.pt"
    broken.write_bytes(b"not a checkpoint")
    with pytest.raises(ArgumentError, match="checkpoint"):
        load_checkpoint(broken)
    with zipfile.ZipFile(broken, "w", zipfile.ZIP_DEFLATED) as file:
        file.writestr("archive/data.pkl", bytes(1 << 20))
    with pytest.raises(ArgumentError, match="bytes that claim to hold 1048576"):
        load_checkpoint(broken)
    broken.unlink()
    os.mkfifo(broken)
    with pytest.raises(ArgumentError, match="is not a regular file"):
        load_checkpoint(broken)


DAMAGE: dict[str, Callable[[dict[str, Any]], Any]] = {
    "no updates": lambda content: content.pop("done"),
    "too many updates": lambda content: content.update(done=PLAN.steps + 1),
    "no states": lambda content: content.update(states=[]),
    "another error": lambda content: content.update(error=5),
    "other positions": lambda content: content.update(positions=[{"at": 1}] * PLAN.batch),
    "other weights": lambda content: content["method"].popitem(),
    "no optimizer": lambda content: content.update(optimizer=[]),
    "other facts": lambda content: content.update(initial=5),
}


@pytest.mark.parametrize("case", DAMAGE)
def test_a_checkpoint_with_another_content_is_refused(dataset: Dataset, tmp_path: Path, case: str) -> None:
    trainer(dataset, tmp_path).save()
    content = load_checkpoint(tmp_path / CHECKPOINT)
    DAMAGE[case](content)
    torch.save(content, tmp_path / CHECKPOINT)
    with pytest.raises(ArgumentError, match=r"checkpoint is .*checkpoint\.pt, with another content"):
        trainer(dataset, tmp_path)


def shot(
    folder: Path,
    *,
    every: int | None = 2,
    first: int = 0,
    known: bool = False,
    sizes: Sequence[Size] = (RENDER,),
    factors: Sequence[float] = (1.0,),
) -> Shot:
    """Write a shot whose frames are those of the scene from `first` on; sizes and pre-exposures repeat.

    Every so many frames have references, with ghosting classes if they are `known`.
    """
    writer = ShotWriter(folder, name="disc", display_size=DISPLAY, frame_rate=30.0)
    scene = DiscOverPlane()
    for index, size, factor in zip(range(12), cycle(sizes), cycle(factors), strict=False):
        frame = scene.frame(first + index, size, halton_jitter(index, 2.0))
        frame = dataclasses.replace(frame, color=factor * np.asarray(frame.color), pre_exposure=factor)
        truth = scene.truth(first + index, DISPLAY) if every and index % every == 0 else None
        ghost = scene.disoccluded(first + index, DISPLAY).astype(np.uint8)
        classes = ClassMaps(ghost, 0 * ghost) if known else None
        writer.write(frame, reference=None if truth is None else factor * truth, classes=classes)
    return Shot.open(folder)


def test_references_become_truth_and_missing_ones_are_marked(tmp_path: Path) -> None:
    dataset = dataset_of_shots([shot(tmp_path / "shot")], tmp_path / "set", "train")
    [entry] = dataset.entries("train")
    even, odd = dataset.read(entry, 0), dataset.read(entry, 1)
    assert np.isfinite(even.reference).all()
    assert np.isnan(odd.reference).all()
    assert (even.ghost == UNKNOWN).all()
    assert entry.ratio == 2.0


def test_info_states_neither_classes_nor_samples_of_shots_that_do_not(tmp_path: Path) -> None:
    dataset_of_shots([shot(tmp_path / "shot")], tmp_path / "set", "train")
    said = overview.rows(tmp_path / "set")
    assert said["display size"] == "64x48"
    assert said["classes"].startswith("train: not known")


def test_copies_of_frames_have_no_pre_exposure(tmp_path: Path) -> None:
    plain, exposed = (
        dataset_of_shots([shot(tmp_path / name, factors=factors)], tmp_path / f"set {name}", "train")
        for name, factors in (("plain", (1.0,)), ("exposed", (2.0, 0.25, 8.0)))
    )
    for a, b in zip(*(d.frames(d.entries("train")[0]) for d in (plain, exposed)), strict=True):
        for name in ("color", "reference"):
            np.testing.assert_allclose(getattr(a, name), getattr(b, name), rtol=2e-3)
        assert a.exposure == pytest.approx(b.exposure, rel=1e-3)


def test_crops_have_the_ratio_of_their_frame_and_no_history_of_another_size(tmp_path: Path) -> None:
    """Ratios of both axes differ; the size changes with every fourth frame."""
    sizes = [(32, 16)] * 4 + [(40, 24)] * 4
    dataset = dataset_of_shots([shot(tmp_path / "shot", sizes=sizes)], tmp_path / "set", "train")
    frames = iter(ClassifierTask(Classifier()).stream([dataset], size=32, seed=[0]))
    found = set()
    for before, now in pairwise(islice(frames, 24)):
        is_small = now.view.extent in ((16.0, 32.0 * 16 / 48), (32.0 * 16 / 48, 16.0))
        assert is_small or now.view.extent in ((20.0, 16.0), (16.0, 20.0))
        assert now.reset or now.color.shape == before.color.shape
        found.add(is_small)
    assert found == {True, False}


def test_a_copy_of_one_shot_is_never_taken_for_another(tmp_path: Path) -> None:
    mine, other = shot(tmp_path / "mine"), shot(tmp_path / "other", first=3)
    sets = [
        dataset_of_shots([each], tmp_path / f"set of {each.path.name}", "train") for each in (mine, other)
    ]
    assert data_hash(sets[:1]) != data_hash(sets[1:])
    moved = Shot.open((tmp_path / "mine").rename(tmp_path / "moved"))
    assert data_hash([dataset_of_shots([moved], sets[0].folder, "train")]) == data_hash(sets[:1])
    with pytest.raises(DatasetError, match=r"have changed since .*: disc\. .* use another folder"):
        dataset_of_shots([other], sets[0].folder, "train")
    reference = moved.source / "reference" / "0002.exr"
    shutil.copy(reference.with_name("0004.exr"), reference)
    with pytest.raises(DatasetError, match="have changed"):
        dataset_of_shots([moved], sets[0].folder, "train")


@pytest.mark.long  # trains
def test_training_on_shots_learns_from_the_frames_with_references(tmp_path: Path) -> None:
    dataset = dataset_of_shots([shot(tmp_path / "shot")], tmp_path / "set", "train")
    sequence = [(dataset, dataset.entries("train")[0])]
    losses: list[float] = []
    torch.manual_seed(0)
    plan = TrainingPlan(steps=40, batch=2, frames=2, size=48, rate=2e-2, average=8)
    trainer = Trainer(ClassifierTask(Classifier()), [dataset], plan, tmp_path)
    before = validate(trainer.average.eval(), sequence).psnr
    trainer.run(on_update=lambda update: losses.append(update.losses["image"]))
    assert np.isfinite(losses).all()
    assert all(parameter.isfinite().all() for parameter in trainer.method.parameters())
    assert validate(trainer.average.eval(), sequence).psnr > before + 0.1


def test_a_shot_without_any_reference_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ShotError, match="no frame has a reference"):
        dataset_of_shots([shot(tmp_path / "shot", every=None)], tmp_path / "set", "train")


def test_data_without_a_usable_sequence_is_described(dataset: Dataset) -> None:
    with pytest.raises(ArgumentError, match=r"data is 12 consecutive frames at ratio 2; want 13 .* 1 to 3"):
        sequences_of([dataset], (1.0, 3.0), min_frames=13)


@pytest.mark.parametrize("shape", [(8, 8), (4, 20), (20, 4)])
def test_singular_values_come_near_one(shape: tuple[int, int]) -> None:
    torch.manual_seed(0)
    values = torch.linalg.svdvals(orthogonalised(torch.randn(shape)))
    assert values.min() > 0.6
    assert values.max() < 1.3


def rows(folder: Path) -> list[dict[str, str]]:
    with (folder / "log.csv").open(newline="") as file:
        return list(csv.DictReader(file))


def test_rows_are_added_and_those_of_later_steps_dropped(tmp_path: Path) -> None:
    write_log(tmp_path, 10, {"loss": 0.5, "psnr": 30.0})
    write_log(tmp_path, 20, {"loss": 0.4, "psnr": 31.0, "visibility": 0.2}, np.zeros((4, 6, 3), np.float32))
    write_log(tmp_path, 20, {"loss": 0.3, "psnr": 32.0})
    assert [(row["step"], row["loss"]) for row in rows(tmp_path)] == [("10.0", "0.5"), ("20.0", "0.3")]
    assert list((tmp_path / "tensorboard").iterdir())


@pytest.mark.parametrize("name", ["weights.safetensors", "log.csv"])
def test_a_run_does_not_start_over_foreign_files(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_bytes(b"mine")
    done = run("train", "classifier", "--data", tmp_path / "none", "-o", tmp_path)
    assert done.exit_code == 1
    assert f"{name}: already exists, and is not of a run in this folder" in done.stderr
    assert [path.name for path in tmp_path.iterdir()] == [name]
