"""Training of `gbuffer` on crops with G-buffers, with larger weights on reflective surfaces."""

from dataclasses import replace
from pathlib import Path

import pytest
import torch

from gbuffer_sets import gbuffer_data
from supersampler.methods.gbuffer.spec import SMALL_NETWORK, GBufferConfig
from supersampler_model.methods.gbuffer import SmallGBuffer
from supersampler_model.training import gbuffer_task
from supersampler_model.training.crops import CropFrame
from supersampler_model.training.gbuffer_task import GBufferTask, reflective_of
from supersampler_model.training.tasks import start_task
from supersampler_model.training.trainer import Plan, Trainer

RATIO, SIZE = 2, 24


@pytest.fixture(scope="module")
def task() -> GBufferTask:
    torch.manual_seed(0)
    network = replace(SMALL_NETWORK, surfaces=(8, 8), detailed=(8, 8), frame=8, levels=(8, 8, 8, 8))
    return GBufferTask(SmallGBuffer(GBufferConfig(network=network)))


@pytest.fixture(scope="module")
def samples(task: GBufferTask, tmp_path_factory: pytest.TempPathFactory) -> list[CropFrame]:
    dataset = task.data(gbuffer_data(tmp_path_factory.mktemp("set"), RATIO))
    walk = iter(task.stream([dataset], size=SIZE, seed=[1]))
    return [next(walk) for _ in range(3)]


def test_errors_weigh_more_on_metal_and_mirrors_alone(task: GBufferTask, samples: list[CropFrame]) -> None:
    sample = samples[0]
    rough = {name: value.clone() for name, value in sample.gbuffer.items()}
    rough["gbuffer_display_metallic"][:] = 0.0
    rough["gbuffer_display_roughness"][:] = 0.5
    rough["gbuffer_display_metallic"][..., 2, 3] = 1.0
    rough["gbuffer_display_roughness"][..., 4, 5] = 0.01
    changed = sample._replace(gbuffer=rough)
    stepped = task.step([changed], [task.first_state(changed)])
    assert isinstance(stepped.weight, torch.Tensor)
    normal = rough["gbuffer_display_normal"].square().sum(dim=1, keepdim=True) > 0.5
    expected = torch.ones_like(stepped.weight)
    expected[..., 2, 3] = expected[..., 4, 5] = 1.5
    torch.testing.assert_close(stepped.weight, torch.where(normal, expected, torch.ones_like(expected)))


def test_errors_weigh_more_where_normals_have_turned(task: GBufferTask, samples: list[CropFrame]) -> None:
    states = [task.first_state(samples[0])]
    states = task.step([samples[0]], states).states
    gathered = task.gather(samples[1], states[0])
    still = float(reflective_of(gathered).mean())
    turned = {name: value.clone() for name, value in samples[1].gbuffer.items()}
    turned["gbuffer_display_normal"] = -turned["gbuffer_display_normal"]
    after = task.gather(samples[1]._replace(gbuffer=turned), states[0])
    assert float(reflective_of(after).mean()) > still + 0.3


def test_states_go_from_frame_to_frame_and_gradients_reach_all_weights(
    task: GBufferTask, samples: list[CropFrame]
) -> None:
    for parameter in task.method.net.blend.parameters():
        torch.nn.init.normal_(parameter, std=0.1)
    states = [task.first_state(samples[0])]
    loss = torch.zeros(())
    for sample in samples:
        stepped = task.step([sample], states)
        assert [state.shape for state in stepped.states[0]] == [state.shape for state in states[0]]
        states = stepped.states
        loss = loss + stepped.images.mean() + stepped.terms["structure"]
    assert loss.isfinite()
    loss.backward()  # type: ignore[no-untyped-call]
    missing = [name for name, p in task.method.named_parameters() if p.grad is None or not p.grad.any()]
    assert missing == []


def test_a_run_of_each_kind_begins(tmp_path: Path) -> None:
    dataset = gbuffer_data(tmp_path / "set", RATIO)
    task = start_task("gbuffer-small")
    trainer = Trainer(task, [dataset], Plan(steps=1, batch=1, frames=2, size=SIZE), tmp_path / "run")
    trainer.run()
    trained = trainer.trained({})
    assert trained.method == "gbuffer-small"
    again = start_task("gbuffer-small", trained).method
    assert again.provenance["steps"] == 1
    assert start_task("gbuffer-small-4x").config["ratio"] == 4


def test_structure_is_a_mean_over_the_pixels_of_all_processes(
    task: GBufferTask, samples: list[CropFrame], monkeypatch: pytest.MonkeyPatch
) -> None:
    alone = task.step([samples[0]], [task.first_state(samples[0])]).terms["structure"]
    monkeypatch.setattr(gbuffer_task, "mean_of_processes", lambda total: 2.0 * total)
    shared = task.step([samples[0]], [task.first_state(samples[0])]).terms["structure"]
    torch.testing.assert_close(shared, 0.5 * alone)
