"""Crops of equal shapes are stepped as one batch, with the results of each alone."""

from collections.abc import Mapping
from typing import NamedTuple

import pytest
import torch
from torch import Tensor, nn

from gbuffer_sets import gbuffer_data
from supersampler.methods.classifier.spec import ClassifierConfig, NetworkConfig
from supersampler_model.data.dataset import Dataset
from supersampler_model.methods.classifier import Classifier
from supersampler_model.training.classifier_tasks import ClassifierTask
from supersampler_model.training.crops import CropFrame
from supersampler_model.training.task import State, Stepped, in_batches

SIZE = 24
TINY = ClassifierConfig(network=NetworkConfig(levels=(8, 16, 32, 64), decoder=8, hidden=8))


class Pair(NamedTuple):
    """Arguments and results of the stages here."""

    planes: Mapping[str, Tensor]
    size: tuple[int, int]


def doubled(pair: Pair, offset: list[Tensor]) -> Pair:
    return Pair({name: 2.0 * plane + offset[0] for name, plane in pair.planes.items()}, pair.size)


def crop(value: float, width: int, name: str = "a") -> tuple[Pair, list[Tensor]]:
    return Pair({name: torch.full((1, width), value)}, (width, 1)), [torch.tensor([value])]


def test_results_are_in_the_order_of_the_crops_whatever_their_shapes_and_names() -> None:
    crops = [crop(1.0, 3), crop(2.0, 2), crop(3.0, 3), crop(4.0, 3, "b"), crop(5.0, 2)]
    for one, of_all in zip(crops, in_batches(doubled, crops), strict=True):
        alone = doubled(*one)
        assert isinstance(of_all, Pair)
        assert (of_all.size, [*of_all.planes]) == (alone.size, [*alone.planes])
        torch.testing.assert_close([*of_all.planes.values()], [*alone.planes.values()], rtol=0, atol=0)


def test_crops_of_equal_shapes_are_one_call() -> None:
    calls = []

    def counted(pair: Pair, offset: list[Tensor]) -> Pair:
        calls.append(pair.size)
        return doubled(pair, offset)

    in_batches(counted, [crop(1.0, 3), crop(2.0, 2), crop(3.0, 3)])
    assert calls == [(3, 1), (2, 1)]
    assert in_batches(counted, []) == []


@pytest.fixture(scope="module")
def samples(tmp_path_factory: pytest.TempPathFactory) -> list[list[CropFrame]]:
    """Three crops of two frames: two of equal shapes, and one of a larger crop."""
    data: Dataset = gbuffer_data(tmp_path_factory.mktemp("set"))
    task = ClassifierTask(Classifier(TINY))
    walks = [iter(task.stream([data], size=size, seed=[n])) for n, size in enumerate((SIZE, SIZE, 32))]
    return [[next(walk) for _ in range(2)] for walk in walks]


def stepped(task: ClassifierTask, crops: list[list[CropFrame]]) -> list[Stepped]:
    """Step each frame of crops of one size."""
    states: list[State] = [task.first_state(frames[0]) for frames in crops]
    results = []
    for frames in zip(*crops, strict=True):
        results.append(task.step(list(frames), states))
        states = results[-1].states
    return results


def test_images_states_and_gradients_are_those_of_each_crop_alone(samples: list[list[CropFrame]]) -> None:
    torch.manual_seed(0)
    task = ClassifierTask(Classifier(TINY))
    task.method.eval()  # batch normalisation alone would see the others
    assert isinstance(task.method.net.blend, nn.Conv2d)
    nn.init.normal_(task.method.net.blend.weight, std=0.1)
    pair, gradients = samples[:2], []
    batch = stepped(task, pair)
    alone = [stepped(task, [crop]) for crop in pair]
    for frame, result in enumerate(batch):
        for place in range(2):
            one = alone[place][frame]
            torch.testing.assert_close(result.images[place : place + 1], one.images, rtol=0, atol=1e-6)
            torch.testing.assert_close(result.states[place], one.states[0], rtol=0, atol=1e-6)
    images = batch[-1].images, torch.cat([results[-1].images for results in alone])
    for image in images:
        task.method.zero_grad()
        image.square().mean().backward()  # type: ignore[no-untyped-call]
        gradients.append([p.grad.clone() for p in task.method.parameters() if p.grad is not None])
    torch.testing.assert_close(*gradients, rtol=1e-4, atol=1e-7)
