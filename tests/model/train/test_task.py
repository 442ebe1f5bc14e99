"""The trainer works with any recurrent method: one with G-buffers and its own loss, and the shipped ones."""

from collections.abc import Callable
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any, cast

import pytest
import torch
from torch import Tensor, nn

from supersampler.errors import ArgumentError
from supersampler.methods.classifier.spec import ClassifierConfig, NetworkConfig
from supersampler.methods.gbuffer.spec import SMALL_NETWORK, GBufferConfig
from supersampler.methods.gbuffer_fast.spec import GuidedConfig
from supersampler_model.data.dataset.storage import Dataset
from supersampler_model.methods.classifier import LargeClassifier
from supersampler_model.methods.extrapolate import Extrapolate
from supersampler_model.methods.gbuffer import SmallGBuffer
from supersampler_model.methods.gbuffer_fast import GuidedClassifier
from supersampler_model.training.classifier_tasks import ExtrapolateTask, GuidedTask, LargeTask
from supersampler_model.training.datasets import method_inputs
from supersampler_model.training.gbuffer_task import GBufferTask
from supersampler_model.training.task import State, Task, start_task
from supersampler_model.training.trainer import Trainer, TrainingPlan
from supersampler_model.training.validation import CLASS_NAMES, validate, validation_entries

pytest_plugins = ["training_fixtures"]


def test_a_frame_without_an_input_of_the_step_is_refused(data: Dataset) -> None:
    frame = data.read(data.entries("validation")[0], 0)
    with pytest.raises(ArgumentError, match="without gbuffer_normal"):
        method_inputs(frame, ["color", "gbuffer_normal"])


TINY = NetworkConfig(levels=(16, 16, 32, 64), decoder=8, hidden=8)
TINY_GBUFFER = replace(SMALL_NETWORK, surfaces=(8, 8), detailed=(8, 8), frame=8, levels=(8, 8, 8, 8))
TASKS: dict[str, Callable[[], Task]] = {
    "classifier-large": lambda: LargeTask(LargeClassifier(ClassifierConfig(network=TINY))),
    "gbuffer-fast": lambda: GuidedTask(GuidedClassifier(GuidedConfig(network=TINY))),
    "extrapolate": lambda: ExtrapolateTask(Extrapolate(ClassifierConfig(network=TINY))),
    "gbuffer-small": lambda: GBufferTask(SmallGBuffer(GBufferConfig(network=TINY_GBUFFER))),
}

SHADED = [name for name in TASKS if name != "extrapolate"]
"""Tasks that change all weights of their network in two frames."""


@pytest.mark.parametrize("name", TASKS)
def test_gradients_of_three_frames_reach_all_weights(data: Dataset, name: str) -> None:
    torch.manual_seed(0)
    task = TASKS[name]()
    for parameter in cast(Any, task.method).net.blend.parameters():
        nn.init.normal_(parameter, std=0.1)
    walk = iter(task.stream([task.data(data)], size=24, seed=[1]))
    states, loss, shapes = list[State](), torch.zeros(()), []
    for sample in islice(walk, 3):
        stepped = task.step([sample], states or [task.first_state(sample)])
        states = stepped.states
        shapes.append([tensor.shape for tensor in states[0]])
        assert stepped.images.shape == sample.reference.shape == (1, 3, 24, 24)
        assert isinstance(stepped.weight, Tensor)
        assert stepped.weight.shape == (1, 1, 24, 24)
        loss = loss + stepped.images.mean() + sum(stepped.terms.values())
    assert shapes == [shapes[0]] * 3
    assert loss.isfinite()
    loss.backward()  # type: ignore[no-untyped-call]
    assert [name for name, p in task.method.named_parameters() if p.grad is None or not p.grad.any()] == []


@pytest.mark.parametrize("name", ["classifier", "classifier-small", "classifier-paper", *SHADED])
def test_a_run_changes_all_weights_and_another_begins_with_them(
    data: Dataset, tmp_path: Path, name: str
) -> None:
    torch.manual_seed(0)
    task = start_task(name)
    before = [p.clone() for p in task.method.parameters()]
    run = Trainer(task, [data], TrainingPlan(steps=2, batch=1, frames=2, size=24), tmp_path)
    run.run()
    assert not any(torch.equal(a, b) for a, b in zip(before, run.method.parameters(), strict=True))
    assert start_task(name, run.trained({})).method.provenance["steps"] == 2


def test_a_larger_history_is_validated_at_the_size_of_the_display(data: Dataset) -> None:
    task = start_task("classifier-large")
    found = validate(task.method.eval(), validation_entries([data], task.ratios), task.runner)
    assert found.psnr > 5.0
    assert {"geometry"} <= set(found.overlap) <= set(CLASS_NAMES)  # others only where they are predicted


def test_the_ratio_of_a_variant_is_its_own() -> None:
    assert start_task("gbuffer-small-4x").config["ratio"] == 4
