"""Fine-tuning on a user's shots, with references for some frames and without classes."""

from pathlib import Path

import numpy as np
import pytest
import torch

from supersampler import halton_jitter
from supersampler.errors import ShotError
from supersampler.io.shot import Shot, ShotWriter
from supersampler_model.data.scenes.analytic import DiscOverPlane
from supersampler_model.methods.classifier import Classifier
from supersampler_model.training.classifier_tasks import ClassifierTask
from supersampler_model.training.datasets import UNKNOWN, dataset_of_shots
from supersampler_model.training.trainer import Plan, Trainer
from supersampler_model.training.validation import validate

DISPLAY, RENDER = (64, 48), (32, 24)


def shot(folder: Path, *, every: int | None = 2) -> Shot:
    writer = ShotWriter(folder, name="disc", display_size=DISPLAY, frame_rate=30.0)
    scene = DiscOverPlane()
    for index in range(12):
        truth = scene.truth(index, DISPLAY) if every and index % every == 0 else None
        writer.write(scene.frame(index, RENDER, halton_jitter(index, 2.0)), reference=truth)
    return Shot.open(folder)


def test_references_become_truth_and_what_is_missing_is_marked(tmp_path: Path) -> None:
    dataset = dataset_of_shots([shot(tmp_path / "shot")], tmp_path / "set", "train")
    [entry] = dataset.entries("train")
    even, odd = dataset.read(entry, 0), dataset.read(entry, 1)
    assert np.isfinite(even.reference).all()
    assert np.isnan(odd.reference).all()
    assert (even.ghost == UNKNOWN).all()
    assert entry.ratio == 2.0


def test_training_on_shots_learns_from_the_frames_with_references(tmp_path: Path) -> None:
    dataset = dataset_of_shots([shot(tmp_path / "shot")], tmp_path / "set", "train")
    sequence = [(dataset, dataset.entries("train")[0])]
    losses: list[float] = []
    torch.manual_seed(0)
    plan = Plan(steps=40, batch=2, frames=2, size=48, rate=2e-2, average=8)
    trainer = Trainer(ClassifierTask(Classifier()), [dataset], plan, tmp_path)
    before = validate(trainer.average.eval(), sequence).psnr
    trainer.run(on_update=lambda update: losses.append(update.losses["image"]))
    assert np.isfinite(losses).all()
    assert all(parameter.isfinite().all() for parameter in trainer.method.parameters())
    assert validate(trainer.average.eval(), sequence).psnr > before + 0.1


def test_a_shot_without_any_reference_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ShotError, match="no frame has a reference"):
        dataset_of_shots([shot(tmp_path / "shot", every=None)], tmp_path / "set", "train")
