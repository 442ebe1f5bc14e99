"""The trainer works with any recurrent method: one with G-buffers and its own loss, and the shipped ones."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import islice
from pathlib import Path
from typing import Any, ClassVar, cast

import pytest
import torch
from torch import Tensor, nn
from torch.nn import functional as F

from gbuffer_sets import gbuffer_data
from supersampler.errors import ArgumentError
from supersampler.methods.classifier.spec import ClassifierConfig, NetworkConfig
from supersampler.methods.gbuffer.spec import SMALL_NETWORK, GBufferConfig
from supersampler.methods.gbuffer_fast.spec import GuidedConfig
from supersampler.methods.spec import DISPLAY, MethodSpec
from supersampler_model.data.dataset import Dataset
from supersampler_model.methods.base import Method
from supersampler_model.methods.classifier import LargeClassifier
from supersampler_model.methods.gbuffer import SmallGBuffer
from supersampler_model.methods.gbuffer_fast import GuidedClassifier
from supersampler_model.training.classifier_tasks import GuidedTask, LargeTask
from supersampler_model.training.crops import CropFrame, Stream
from supersampler_model.training.datasets import gbuffer_set, method_inputs
from supersampler_model.training.gbuffer_task import GBufferTask
from supersampler_model.training.losses import ImageWeights
from supersampler_model.training.task import State, Stepped, Task, start_task
from supersampler_model.training.trainer import Trainer, TrainingPlan
from supersampler_model.training.validation import validate, validation_entries

PLAN = TrainingPlan(steps=24, batch=2, frames=2, size=24, rate=8e-2, average=4)


class Mixture(Method):
    """A learned mean of base colour, this frame's nearest samples and the previous image."""

    spec: ClassVar = MethodSpec(
        name="mixture",
        source="a test",
        inputs=("color", "exposure", "gbuffer_display_base_color"),
        history={"color": (1, 3, *DISPLAY)},
        ratios=(2.0, 2.0),
    )

    def __init__(self) -> None:
        super().__init__()
        self.net = nn.Conv2d(9, 3, 1)

    def compute(
        self, color: Tensor, exposure: Tensor, gbuffer_display_base_color: Tensor, history_color: Tensor
    ) -> tuple[Tensor, Tensor]:
        image = self.mixed(self.seen(color * exposure, gbuffer_display_base_color, history_color))
        return image / exposure, image

    def seen(self, color: Tensor, base_color: Tensor, previous: Tensor) -> Tensor:
        return torch.cat([F.interpolate(color, scale_factor=2.0), base_color, previous], dim=1)

    def mixed(self, seen: Tensor) -> Tensor:
        return F.softplus(self.net(seen))


class MixtureTask(Task):
    """Crops as they are in `gbuffer_windows`; the images' total variation is a term of the loss."""

    def __init__(self) -> None:
        self.method: Mixture = Mixture()
        self.losses = ImageWeights(change=0.25)

    @property
    def config(self) -> dict[str, Any]:
        return {}

    def data(self, dataset: Dataset) -> Dataset:
        return gbuffer_set(dataset, 2)

    def stream(self, datasets: Sequence[Dataset], *, size: int, seed: Sequence[int]) -> Stream:
        return Stream(datasets, ratios=(2, 2), size=size, seed=seed, gbuffers="both", aligned=True)

    def first_state(self, sample: CropFrame) -> State:
        return [torch.zeros_like(sample.reference)]

    def step(self, samples: list[CropFrame], states: list[State]) -> Stepped:
        seen = [
            self.method.seen(s.color * s.exposure, s.gbuffer["gbuffer_display_base_color"], previous)
            for s, (previous,) in zip(samples, states, strict=True)
        ]
        images = self.method.mixed(torch.cat(seen))
        exposed = torch.cat([s.exposure for s in samples]).reshape(-1, 1, 1, 1)
        rough = 0.001 * images.diff(dim=3).abs().mean()
        return Stepped(
            images / exposed, [[images[i : i + 1]] for i in range(len(samples))], terms={"rough": rough}
        )


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return gbuffer_data(tmp_path_factory.mktemp("set"))


def trainer(dataset: Dataset, folder: Path) -> Trainer:
    folder.mkdir(exist_ok=True)
    torch.manual_seed(0)
    return Trainer(MixtureTask(), [dataset], PLAN, folder)


def test_a_task_learns_and_validation_passes_the_inputs_of_its_step(dataset: Dataset, tmp_path: Path) -> None:
    run = trainer(dataset, tmp_path)
    entries = validation_entries(run.datasets, run.method.ratios)
    before = validate(run.average.eval(), entries)
    terms: list[list[str]] = []
    run.run(on_update=lambda update: terms.append(list(update.losses)))
    after = validate(run.average.eval(), entries)
    assert after.psnr > before.psnr + 1.0
    assert after.overlap == {}
    assert terms == [["image", "rough"]] * PLAN.steps


def test_a_frame_without_an_input_of_the_step_is_refused(dataset: Dataset) -> None:
    frame = dataset.read(dataset.entries("validation")[0], 0)
    with pytest.raises(ArgumentError, match="without gbuffer_normal"):
        method_inputs(frame, ["color", "gbuffer_normal"])


def test_weights_say_what_they_were_made_from(dataset: Dataset, tmp_path: Path) -> None:
    trained = trainer(dataset, tmp_path).trained({"validation": {}})
    assert (trained.method, trained.config) == ("mixture", {})
    assert trained.tensors.keys() == {"net.weight", "net.bias"}


TINY = NetworkConfig(levels=(16, 16, 32, 64), decoder=8, hidden=8)
TINY_GBUFFER = replace(SMALL_NETWORK, surfaces=(8, 8), detailed=(8, 8), frame=8, levels=(8, 8, 8, 8))
TASKS: dict[str, Callable[[], Task]] = {
    "classifier-large": lambda: LargeTask(LargeClassifier(ClassifierConfig(network=TINY))),
    "gbuffer-fast": lambda: GuidedTask(GuidedClassifier(GuidedConfig(network=TINY))),
    "gbuffer-small": lambda: GBufferTask(SmallGBuffer(GBufferConfig(network=TINY_GBUFFER))),
}


@pytest.mark.parametrize("name", TASKS)
def test_gradients_of_three_frames_reach_all_weights(dataset: Dataset, name: str) -> None:
    torch.manual_seed(0)
    task = TASKS[name]()
    for parameter in cast(Any, task.method).net.blend.parameters():
        nn.init.normal_(parameter, std=0.1)
    walk = iter(task.stream([task.data(dataset)], size=24, seed=[1]))
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


@pytest.mark.parametrize(
    "name",
    [
        "classifier",
        "classifier-small",
        "classifier-large",
        "classifier-paper",
        "gbuffer-small",
        "gbuffer-fast",
    ],
)
def test_a_run_changes_all_weights_and_another_begins_with_them(
    dataset: Dataset, tmp_path: Path, name: str
) -> None:
    torch.manual_seed(0)
    task = start_task(name)
    before = [p.clone() for p in task.method.parameters()]
    run = Trainer(task, [dataset], TrainingPlan(steps=2, batch=1, frames=2, size=24), tmp_path)
    run.run()
    assert not any(torch.equal(a, b) for a, b in zip(before, run.method.parameters(), strict=True))
    assert start_task(name, run.trained({})).method.provenance["steps"] == 2


def test_a_larger_history_is_validated_at_the_size_of_the_display(dataset: Dataset) -> None:
    task = start_task("classifier-large")
    found = validate(task.method.eval(), validation_entries([dataset], task.ratios), task.runner)
    assert found.psnr > 5.0
    assert set(found.overlap) >= {"visibility", "geometry"}


def test_the_ratio_of_a_variant_is_its_own() -> None:
    assert start_task("gbuffer-small-4x").config["ratio"] == 4
