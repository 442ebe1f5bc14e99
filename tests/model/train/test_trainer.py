"""The trainer: the loss falls, runs resume exactly, and unusable data is refused."""

import dataclasses
import signal
from functools import partial
from pathlib import Path

import numpy as np
import pytest
import torch
import typer

from stopped_run import assert_goes_on_exactly
from supersampler import halton_jitter
from supersampler.errors import ArgumentError
from supersampler_model.data.dataset import Dataset, TrainingFrame, create_dataset
from supersampler_model.data.dataset.description import Description, SequenceEntry
from supersampler_model.data.dataset.frame_file import write_training_frame
from supersampler_model.data.scenes.analytic import DiscOverPlane
from supersampler_model.data.specs import SequenceSpec
from supersampler_model.methods.classifier import Classifier, LargeClassifier, SmallClassifier
from supersampler_model.methods.classifier_paper import PaperClassifier
from supersampler_model.training.classifier_tasks import ClassifierTask
from supersampler_model.training.cli import update_and_save
from supersampler_model.training.losses import ClassifierWeights
from supersampler_model.training.tasks import start_task
from supersampler_model.training.trainer import CHECKPOINT, Plan, Trainer, Update, load_checkpoint
from supersampler_model.training.validation import validate

DISPLAY, RENDER = (64, 48), (32, 24)
PLAN = Plan(steps=6, batch=2, frames=2, size=32, average=4, settle=0.0)


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    entry = SequenceEntry(spec=SequenceSpec(family="fences", seed=1, frames=9), ratio=2.0, split="train")
    description = Description(display_size=DISPLAY, samples=1, gbuffers=False, seed=0, sequences=(entry,))
    made = create_dataset(tmp_path_factory.mktemp("set"), description)
    scene = DiscOverPlane()
    for index in range(entry.spec.frames):
        frame = scene.frame(index, RENDER, halton_jitter(index, 2.0))
        truth = scene.truth(index, DISPLAY)
        assert frame.color is not None
        ghost = scene.disoccluded(index, DISPLAY).astype(np.uint8)
        write_training_frame(
            made.path(entry, index),
            TrainingFrame(
                color=frame.color.astype(np.float16), depth=frame.depth,
                motion=frame.motion.astype(np.float16), jitter=frame.jitter, reset=index == 0, exposure=1.0,
                reference=truth.astype(np.float16), ghost=ghost, alias=np.zeros_like(ghost),
            ),
        )  # fmt: skip
    return made


def trainer(dataset: Dataset, folder: Path, plan: Plan = PLAN) -> Trainer:
    folder.mkdir(exist_ok=True)
    torch.manual_seed(0)
    return Trainer(ClassifierTask(Classifier()), [dataset], plan, folder)


def test_a_run_that_was_stopped_ends_with_the_same_weights(dataset: Dataset, tmp_path: Path) -> None:
    assert_goes_on_exactly(partial(trainer, dataset), tmp_path)


class Interrupting(list[Update]):
    """Updates; Ctrl-C is pressed so many times when the second one is added."""

    times = 1

    def append(self, update: Update) -> None:
        super().append(update)
        for _ in range(self.times * (len(self) == 2)):
            signal.raise_signal(signal.SIGINT)


@pytest.mark.parametrize("until", [2, PLAN.steps])
def test_ctrl_c_saves_what_is_done(dataset: Dataset, tmp_path: Path, until: int) -> None:
    before, updates = signal.getsignal(signal.SIGINT), Interrupting()
    with pytest.raises(typer.Exit):
        update_and_save(trainer(dataset, tmp_path), until, updates)
    assert load_checkpoint(tmp_path / CHECKPOINT)["done"] == len(updates) == 2
    assert signal.getsignal(signal.SIGINT) is before


def test_ctrl_c_in_the_last_update_ends_as_any_run(dataset: Dataset, tmp_path: Path) -> None:
    run = trainer(dataset, tmp_path, dataclasses.replace(PLAN, steps=2))
    update_and_save(run, 2, Interrupting())
    assert run.done == run.plan.steps


def test_ctrl_c_twice_stops_at_once(dataset: Dataset, tmp_path: Path) -> None:
    updates = Interrupting()
    updates.times = 2
    with pytest.raises(KeyboardInterrupt):
        update_and_save(trainer(dataset, tmp_path), PLAN.steps, updates)
    assert not (tmp_path / CHECKPOINT).exists()


def test_the_error_falls(dataset: Dataset, tmp_path: Path) -> None:
    losses: list[float] = []
    plan = Plan(steps=48, batch=2, frames=2, size=48, rate=2e-2)
    trainer(dataset, tmp_path, plan).run(on_update=lambda u: losses.append(sum(u.losses.values())))
    assert np.mean(losses[-8:]) < 0.9 * np.mean(losses[:8])


@pytest.mark.parametrize("method", [Classifier, SmallClassifier, LargeClassifier, PaperClassifier])
def test_every_classifier_learns_with_gradients_in_all_its_weights(
    dataset: Dataset, tmp_path: Path, method: type[Classifier]
) -> None:
    torch.manual_seed(0)
    start, plan = start_task(method.name), dataclasses.replace(PLAN, steps=2)
    before = [p.clone() for p in start.method.parameters()]
    run = Trainer(start, [dataset], plan, tmp_path)
    run.run()
    moved = [not torch.equal(a, b) for a, b in zip(before, run.method.parameters(), strict=True)]
    assert all(moved)


def test_classes_of_a_first_frame_do_not_count_in_validation(dataset: Dataset, tmp_path: Path) -> None:
    [entry] = dataset.entries("train")
    method, other = Classifier().eval(), create_dataset(tmp_path / "set", dataset.description)
    for index in range(entry.spec.frames):
        frame = dataset.read(entry, index)
        classes = 1 - frame.ghost if frame.reset else frame.ghost
        write_training_frame(other.path(entry, index), dataclasses.replace(frame, ghost=classes))
    overlaps = [validate(method, [(each, entry)]).overlap for each in (dataset, other)]
    assert overlaps[0] == overlaps[1] != {}


def test_a_run_is_not_gone_on_with_by_another_plan(dataset: Dataset, tmp_path: Path) -> None:
    first = trainer(dataset, tmp_path)
    first.run(until=1)
    first.save()
    with pytest.raises(ArgumentError, match="plan"):
        trainer(dataset, tmp_path, dataclasses.replace(PLAN, batch=4))


def test_a_run_is_not_gone_on_with_by_another_loss(dataset: Dataset, tmp_path: Path) -> None:
    trainer(dataset, tmp_path).save()
    with pytest.raises(ArgumentError, match="losses"):
        Trainer(ClassifierTask(Classifier(), ClassifierWeights(ghost=1.0)), [dataset], PLAN, tmp_path)


@pytest.mark.parametrize(
    ("plan", "name"),
    [(dataclasses.replace(PLAN, size=56), "size"), (dataclasses.replace(PLAN, batch=0), "batch")],
)
def test_a_plan_that_cannot_be_is_refused(dataset: Dataset, tmp_path: Path, plan: Plan, name: str) -> None:
    with pytest.raises(ArgumentError, match=name):
        trainer(dataset, tmp_path, plan)


def test_a_checkpoint_that_is_none_is_refused(tmp_path: Path) -> None:
    broken = tmp_path / "checkpoint.pt"
    broken.write_bytes(b"not a checkpoint")
    with pytest.raises(ArgumentError, match="checkpoint"):
        load_checkpoint(broken)
