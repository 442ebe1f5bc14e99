"""Training of `classifier-large`: references of the display, states of the larger history."""

from pathlib import Path

import pytest
import torch
from torch import nn

from gbuffer_sets import gbuffer_data
from supersampler.methods.classifier.spec import ClassifierConfig, NetworkConfig
from supersampler_model import ops
from supersampler_model.data.dataset import Dataset
from supersampler_model.methods.base import load_trained, shipped_weights
from supersampler_model.methods.classifier import LargeClassifier
from supersampler_model.training.classifier_tasks import LargeTask
from supersampler_model.training.crops import CropFrame
from supersampler_model.training.tasks import start_task
from supersampler_model.training.trainer import Plan, Trainer
from supersampler_model.training.validation import validate, validation_entries
from torch_inputs import plain_inputs

SIZE = 24
TINY = ClassifierConfig(network=NetworkConfig(levels=(8, 16, 32, 64), decoder=8, hidden=8))


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return gbuffer_data(tmp_path_factory.mktemp("set"))


@pytest.fixture
def task() -> LargeTask:
    torch.manual_seed(0)
    return LargeTask(LargeClassifier(TINY))


@pytest.fixture
def samples(task: LargeTask, data: Dataset) -> list[CropFrame]:
    walk = iter(task.stream([data], size=SIZE, seed=[1]))
    return [next(walk) for _ in range(3)]


def test_images_have_the_size_of_the_crops_and_states_are_larger(
    task: LargeTask, samples: list[CropFrame]
) -> None:
    assert isinstance(task.method.net.blend, nn.Conv2d)
    nn.init.normal_(task.method.net.blend.weight, std=0.1)
    states, loss = [task.first_state(samples[0])], torch.zeros(())
    sizes = [tensor.shape for tensor in states[0]]
    for sample in samples:
        stepped = task.step([sample], states)
        states = stepped.states
        assert [tensor.shape for tensor in states[0]] == sizes
        assert stepped.images.shape == sample.reference.shape == (1, 3, SIZE, SIZE)
        assert isinstance(stepped.weight, torch.Tensor)
        assert stepped.weight.shape == (1, 1, SIZE, SIZE)
        assert states[0][0].shape == (1, 3, 34, 34)
        loss = loss + stepped.images.mean() + stepped.terms["classes"]
    assert loss.isfinite()
    loss.backward()  # type: ignore[no-untyped-call]
    assert [name for name, p in task.method.named_parameters() if p.grad is None or not p.grad.any()] == []


def test_a_crop_of_a_whole_frame_gives_the_image_that_the_method_gives() -> None:
    task = start_task("classifier-large", load_trained(shipped_weights("classifier")))
    method, render, display = task.method, ops.Size(16, 12), ops.Size(32, 24)
    history, states = method.first_history(display, render), None
    generator = torch.Generator().manual_seed(0)
    for index in range(3):
        color, depth = (torch.rand(1, c, 12, 16, generator=generator) for c in (3, 1))
        motion, jitter = torch.full((1, 2, 12, 16), 0.7), torch.rand(1, 2, generator=generator) - 0.5
        classes, exposure = torch.zeros(1, 24, 32, dtype=torch.int64), torch.tensor([1.5])
        view, truth = ops.View(display, render, jitter), torch.zeros(1, 3, 24, 32)
        sample = CropFrame(color, depth, motion, exposure, view, index == 0, truth, classes, classes)
        states = [task.first_state(sample)] if states is None else states
        with torch.no_grad():
            given = plain_inputs(render) | {
                "color": color,
                "depth": depth,
                "motion": motion,
                "jitter": jitter,
            }
            given |= {"exposure": exposure, "display_size": torch.tensor(display)}
            image, history, _ = method.step(*(given[name] for name in method.inputs()), *history)
            stepped = task.step([sample], states)
        states = stepped.states
        torch.testing.assert_close(stepped.images, image, rtol=1e-3, atol=1e-4)


def test_a_run_learns_and_is_validated(data: Dataset, tmp_path: Path) -> None:
    torch.manual_seed(0)
    task = LargeTask(LargeClassifier(TINY))
    trainer = Trainer(task, [data], Plan(steps=2, batch=2, frames=2, size=SIZE), tmp_path)
    before = [p.clone() for p in task.method.parameters()]
    trainer.run()
    assert any(not torch.equal(a, b) for a, b in zip(before, task.method.parameters(), strict=True))
    entries = validation_entries(trainer.datasets, task.ratios)
    found = validate(trainer.average.eval(), entries, task.runner)
    assert found.psnr > 5.0
    assert set(found.overlap) >= {"visibility", "geometry"}
