"""Training of `gbuffer-fast`: crops of any ratio with G-buffers of both sizes, from `classifier`."""

from pathlib import Path

import numpy as np
import pytest
import torch
from torch import nn

from gbuffer_sets import DISPLAY, frame, gbuffer_data, rendered
from supersampler import ArgumentError
from supersampler.methods.classifier.spec import NetworkConfig
from supersampler.methods.gbuffer_fast.spec import GuidedConfig
from supersampler_model.data.dataset import Dataset
from supersampler_model.methods.base import load_trained, shipped_weights
from supersampler_model.methods.classifier import Classifier
from supersampler_model.methods.gbuffer_fast import GuidedClassifier
from supersampler_model.training.classifier_tasks import GuidedTask
from supersampler_model.training.crops import CropFrame, CropRegion
from supersampler_model.training.datasets import unshaded_set
from supersampler_model.training.tasks import start_task
from supersampler_model.training.trainer import Plan, Trainer

SIZE = 24
TINY = GuidedConfig(network=NetworkConfig(levels=(16, 16, 32, 64), decoder=8, hidden=8))


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return gbuffer_data(tmp_path_factory.mktemp("set"))


@pytest.fixture(scope="module")
def task() -> GuidedTask:
    torch.manual_seed(0)
    return GuidedTask(GuidedClassifier(TINY))


@pytest.fixture(scope="module")
def samples(task: GuidedTask, data: Dataset) -> list[CropFrame]:
    walk = iter(task.stream([task.data(data)], size=SIZE, seed=[1]))
    return [next(walk) for _ in range(3)]


def test_a_crop_anywhere_has_the_g_buffers_of_both_sizes_at_its_place(data: Dataset) -> None:
    dataset = unshaded_set(data, (1.0, 4.0))
    frame_read = dataset.read(dataset.entries("train")[0], 2)
    cut = CropRegion(left=9, top=3, size=SIZE, ratio=(2.0, 2.0), gbuffers="both")
    sample = cut.cut(frame_read, reset=False)
    color = sample.gbuffer["gbuffer_display_base_color"][0].permute(1, 2, 0).numpy()
    expected = frame(2).gbuffer_display
    assert expected is not None
    np.testing.assert_allclose(color, expected["base_color"][3 : 3 + SIZE, 9 : 9 + SIZE], atol=3e-3)
    np.testing.assert_allclose(
        sample.gbuffer["gbuffer_base_color"], sample.color, atol=3e-3, err_msg="what shines is its colour"
    )
    assert rendered(2, 2).color.shape[1] == DISPLAY[0] // 2


def test_states_go_from_frame_to_frame_and_gradients_reach_all_weights(
    task: GuidedTask, samples: list[CropFrame]
) -> None:
    assert isinstance(task.method.net.blend, nn.Conv2d)
    nn.init.normal_(task.method.net.blend.weight, std=0.1)
    states = [task.first_state(samples[0])]
    loss = torch.zeros(())
    for sample in samples:
        stepped = task.step([sample], states)
        assert [state.shape for state in stepped.states[0]] == [state.shape for state in states[0]] or (
            stepped.states[0][3].shape[1] == 2
        )
        states = stepped.states
        loss = loss + stepped.images.mean() + stepped.terms["classes"]
    assert loss.isfinite()
    loss.backward()  # type: ignore[no-untyped-call]
    assert [name for name, p in task.method.named_parameters() if p.grad is None or not p.grad.any()] == []


def test_the_reflectance_in_a_state_is_that_of_the_frame_just_stepped(
    task: GuidedTask, samples: list[CropFrame]
) -> None:
    after = task.step([samples[0]], [task.first_state(samples[0])]).states[0][-1]
    base, least = samples[0].gbuffer["gbuffer_display_base_color"], task.method.config.min_reflectance
    sky = samples[0].gbuffer["gbuffer_display_normal"].square().sum(dim=1, keepdim=True) < 0.1
    torch.testing.assert_close(after, torch.where(sky, 1.0, least + (1.0 - least) * base))


def test_training_begins_with_the_weights_of_the_classifier_for_what_both_have() -> None:
    trained = load_trained(shipped_weights("classifier"))
    theirs, ours = Classifier.of(trained), start_task("gbuffer-fast", trained).method
    assert isinstance(ours, GuidedClassifier)
    first, own = (m.net.state_dict()["encoder.blocks.0.0.0.weight"] for m in (theirs, ours))
    places = [theirs.config.inputs.index(name) for name in ("sample", "edge")]
    for place in places:
        torch.testing.assert_close(own[:, 4 * place : 4 * place + 4], first[:, 4 * place : 4 * place + 4])
    new = ours.config.inputs.index("agreement")
    assert not own[:, 4 * new : 4 * new + 4].any()
    bias, own_bias = (m.net.state_dict()["blend.bias"] for m in (theirs, ours))
    torch.testing.assert_close(own_bias[:4], bias[:4])
    torch.testing.assert_close(own_bias[4:], bias[8:], msg="without the clipped history")


def test_a_run_begins_and_ends_with_weights_of_the_method(data: Dataset, tmp_path: Path) -> None:
    task = start_task("gbuffer-fast")
    trainer = Trainer(task, [data], Plan(steps=1, batch=1, frames=2, size=SIZE), tmp_path / "run")
    trainer.run()
    assert start_task("gbuffer-fast", trainer.trained({})).method.provenance["steps"] == 1


def test_sets_without_display_size_g_buffers_and_weights_of_other_methods_are_refused(
    task: GuidedTask, tmp_path: Path
) -> None:
    with pytest.raises(ArgumentError, match="without G-buffers of display size"):
        task.data(gbuffer_data(tmp_path, gbuffers=False))
    with pytest.raises(ArgumentError, match="of classifier"):
        GuidedClassifier.from_classifier(load_trained(shipped_weights("gbuffer-small")))
