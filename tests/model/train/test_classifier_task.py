"""Training of `classifier`, `classifier-large` and `gbuffer-fast`: weights, classes, states, batches."""

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
import torch
from torch import Tensor, nn

from gbuffer_sets import frame as gbuffer_frame
from gbuffer_sets import gbuffer_data
from supersampler import ArgumentError
from supersampler.methods.classifier.spec import BASE, ClassifierConfig, NetworkConfig
from supersampler.methods.gbuffer_fast.spec import GuidedConfig
from supersampler_model import ops
from supersampler_model.data.dataset.storage import Dataset
from supersampler_model.data.labels import Alias, Ghost
from supersampler_model.methods.base import load_trained, shipped_weights
from supersampler_model.methods.classifier import Classifier
from supersampler_model.methods.gbuffer_fast import GuidedClassifier
from supersampler_model.training.classifier_tasks import ClassifierTask, GuidedTask
from supersampler_model.training.crops import CropFrame, CropRegion
from supersampler_model.training.datasets import UNKNOWN, unshaded_set
from supersampler_model.training.losses import class_loss
from supersampler_model.training.task import State, Stepped, fast_convolutions, in_batches, start_task
from torch_inputs import plain_inputs, step_by_name

pytest_plugins = ["training_fixtures"]

RENDER, DISPLAY = ops.Size(12, 8), ops.Size(24, 16)
TINY = ClassifierConfig(network=NetworkConfig(levels=(8, 16, 32, 64), decoder=8, hidden=8))
SIZE = 24
GUIDED = GuidedConfig(network=NetworkConfig(levels=(16, 16, 32, 64), decoder=8, hidden=8))


@pytest.fixture(scope="module")
def task() -> ClassifierTask:
    torch.manual_seed(0)
    return ClassifierTask(Classifier(TINY).eval())


def sample(ghost: Tensor, *, motion: float = 0.0, alias: int = Alias.NONE) -> CropFrame:
    """A noisy frame that moves along x, with labels for each of 24x16 pixels."""
    random = torch.Generator().manual_seed(0)
    vectors = torch.zeros(1, 2, *RENDER[::-1])
    vectors[:, 0] = motion
    return CropFrame(
        color=torch.rand(1, 3, *RENDER[::-1], generator=random),
        depth=torch.full((1, 1, *RENDER[::-1]), 0.5),
        motion=vectors,
        exposure=torch.ones(1),
        view=ops.View(DISPLAY, RENDER, torch.tensor([[0.1, -0.2]])),
        reset=True,
        reference=torch.rand(1, 3, *DISPLAY[::-1], generator=random),
        ghost=ghost,
        alias=torch.full((1, *DISPLAY[::-1]), int(alias)),
    )


def labels(value: int) -> Tensor:
    return torch.full((1, *DISPLAY[::-1]), int(value))


def weights(task: ClassifierTask, *samples: CropFrame, frames: int = 2) -> Tensor:
    """Return the weights of the error in the last of some frames; the first has no history."""
    with torch.no_grad():
        states = [task.first_state(s) for s in samples]
        for _ in range(frames):
            weight, states = (stepped := task.step(list(samples), states)).weight, stepped.states
    assert isinstance(weight, Tensor)
    return weight


@pytest.mark.parametrize(
    ("instruction", "expected"), [("avx512_bf16", torch.bfloat16), ("avx2", torch.float32)]
)
def test_convolutions_are_in_bfloat16_where_the_cpu_has_it(
    instruction: str, expected: torch.dtype, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: {instruction: True})
    with fast_convolutions(torch.device("cpu")):
        image = nn.functional.conv2d(torch.ones(1, 1, 4, 4), torch.ones(1, 1, 3, 3))
    assert image.dtype == expected


@pytest.mark.parametrize(
    ("ghost", "heavy"), [(Ghost.NONE, 0), (Ghost.VISIBILITY, 1), (Ghost.SHADING, 1), (UNKNOWN, 0)]
)
def test_errors_weigh_more_where_the_history_is_of_no_use(
    task: ClassifierTask, ghost: int, heavy: int
) -> None:
    assert task.losses.ghost > 0.0
    assert (weights(task, sample(labels(ghost))) == 1.0 + heavy * task.losses.ghost).all()


def test_errors_weigh_more_where_there_is_no_history(task: ClassifierTask) -> None:
    assert (weights(task, sample(labels(Ghost.NONE)), frames=1) == 1.0 + task.losses.ghost).all()


def test_pixels_from_outside_a_crop_count_as_hidden(task: ClassifierTask) -> None:
    """Motion of 3 render pixels leads the right quarter of the crop off it."""
    ghost = labels(Ghost.NONE)
    ghost[:, :4] = UNKNOWN
    weight = weights(task, sample(ghost, motion=3.0))[0, 0]
    expected = torch.ones(*DISPLAY[::-1])
    expected[:, 18:] += task.losses.ghost
    torch.testing.assert_close(weight, expected)


def test_each_group_of_classes_is_learned_from_its_own_labels(task: ClassifierTask) -> None:
    ghost = labels(Ghost.NONE)
    ghost[:, :, :10] = Ghost.SHADING
    frame = sample(ghost, alias=Alias.TEXTURE)
    said: list[Tensor] = []
    handle = task.method.net.register_forward_hook(lambda *call: said.append(call[2][0]))
    with torch.no_grad():
        terms = task.step([frame], [task.first_state(frame)]).terms
    handle.remove()
    logits = ops.cut_to(said[0], ops.half_of(ops.Size(*ghost.shape[:0:-1])))
    torch.testing.assert_close(terms["classes"], class_loss(logits, ghost, frame.alias, task.losses))
    exchanged = class_loss(logits, frame.alias, ghost, task.losses)
    assert not torch.isclose(terms["classes"], exchanged, rtol=1e-3)


def test_a_state_is_that_of_a_whole_frame(task: ClassifierTask) -> None:
    """States are the tensors of the method's own step in their order, without the mean of samples."""
    frame = sample(labels(Ghost.NONE), motion=0.3)
    inputs = {name: getattr(frame, name) for name in ("color", "depth", "motion", "exposure")}
    inputs |= {"jitter": frame.view.jitter, "display_size": torch.tensor(DISPLAY), **plain_inputs(RENDER)}
    history = task.method.first_history(DISPLAY, RENDER)
    state = task.first_state(frame)
    assert torch.equal(state[4], frame.view.jitter)
    for _ in range(3):
        done = step_by_name(task.method, inputs, history)
        with torch.no_grad():
            stepped = task.step([frame], [state])
        history, state = done.history, stepped.states[0]
        torch.testing.assert_close(stepped.images, done.image)
        for name, a, b in zip(BASE.history, state, history[: len(state)], strict=True):
            torch.testing.assert_close(a, b, msg=name)


def test_gradients_go_through_the_colour_of_the_history_alone(task: ClassifierTask) -> None:
    frame = sample(labels(Ghost.NONE))
    stepped = task.step([frame], [task.first_state(frame)])
    assert [state.requires_grad for state in stepped.states[0]] == [True, False, False, False, False, False]


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


@pytest.fixture(scope="module")
def samples(data: Dataset) -> list[list[CropFrame]]:
    """Two crops of two frames."""
    task = ClassifierTask(Classifier(TINY))
    walks = [iter(task.stream([data], size=SIZE, seed=[n])) for n in range(2)]
    return [[next(walk) for _ in range(2)] for walk in walks]


def stepped(task: ClassifierTask, crops: list[list[CropFrame]]) -> list[Stepped]:
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
    gradients, batch = [], stepped(task, samples)
    alone = [stepped(task, [crop]) for crop in samples]
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


@pytest.fixture(scope="module")
def guided_task() -> GuidedTask:
    torch.manual_seed(0)
    return GuidedTask(GuidedClassifier(GUIDED))


@pytest.fixture(scope="module")
def guided_samples(guided_task: GuidedTask, data: Dataset) -> list[CropFrame]:
    walk = iter(guided_task.stream([guided_task.data(data)], size=SIZE, seed=[1]))
    return [next(walk) for _ in range(3)]


def test_a_crop_anywhere_has_the_g_buffers_of_both_sizes_at_its_place(data: Dataset) -> None:
    dataset = unshaded_set(data, (1.0, 4.0))
    frame_read = dataset.read(dataset.entries("train")[0], 2)
    cut = CropRegion(left=9, top=3, size=SIZE, gbuffers="both")
    sample = cut.cut(frame_read, reset=False)
    color = sample.gbuffer["gbuffer_display_base_color"][0].permute(1, 2, 0).numpy()
    expected = gbuffer_frame(2).gbuffer_display
    assert expected is not None
    np.testing.assert_allclose(color, expected["base_color"][3 : 3 + SIZE, 9 : 9 + SIZE], atol=3e-3)
    np.testing.assert_allclose(
        sample.gbuffer["gbuffer_base_color"], sample.color, atol=3e-3, err_msg="what shines is its colour"
    )


def test_the_reflectance_in_a_state_is_that_of_the_frame_just_stepped(
    guided_task: GuidedTask, guided_samples: list[CropFrame]
) -> None:
    after = guided_task.step([guided_samples[0]], [guided_task.first_state(guided_samples[0])]).states[0][-1]
    base, least = (
        guided_samples[0].gbuffer["gbuffer_display_base_color"],
        guided_task.method.config.min_reflectance,
    )
    sky = guided_samples[0].gbuffer["gbuffer_display_normal"].square().sum(dim=1, keepdim=True) < 0.1
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


def test_sets_without_display_size_g_buffers_and_weights_of_other_methods_are_refused(
    guided_task: GuidedTask, tmp_path: Path
) -> None:
    with pytest.raises(ArgumentError, match="without G-buffers of display size"):
        guided_task.data(gbuffer_data(tmp_path, gbuffers=False))
    with pytest.raises(ArgumentError, match="of classifier"):
        GuidedClassifier.from_classifier(load_trained(shipped_weights("gbuffer-small")))
