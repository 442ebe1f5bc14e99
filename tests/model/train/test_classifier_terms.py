"""Training terms of the classifier: weights of invalid history, and the classification loss."""

from dataclasses import replace

import pytest
import torch
from torch import Tensor

from supersampler.methods.classifier.spec import BASE, ClassifierConfig, NetworkConfig
from supersampler_model import ops
from supersampler_model.data.labels import Alias, Ghost
from supersampler_model.methods.classifier import Classifier
from supersampler_model.training.classifier_tasks import ClassifierTask
from supersampler_model.training.crops import CropFrame
from supersampler_model.training.datasets import UNKNOWN
from supersampler_model.training.losses import class_loss
from torch_inputs import plain_inputs

RENDER, DISPLAY = ops.Size(12, 8), ops.Size(24, 16)
SMALL = ClassifierConfig(network=NetworkConfig(levels=(8, 16, 32, 64), decoder=8, hidden=8))


@pytest.fixture(scope="module")
def task() -> ClassifierTask:
    torch.manual_seed(0)
    return ClassifierTask(Classifier(SMALL).eval())


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


def weights(task: ClassifierTask, *samples: CropFrame) -> Tensor:
    with torch.no_grad():
        weight = task.step(list(samples), [task.first_state(s) for s in samples]).weight
    assert isinstance(weight, Tensor)
    return weight


@pytest.mark.parametrize(
    ("ghost", "heavy"), [(Ghost.NONE, 0), (Ghost.VISIBILITY, 1), (Ghost.SHADING, 1), (UNKNOWN, 0)]
)
def test_errors_weigh_more_where_the_history_is_of_no_use(
    task: ClassifierTask, ghost: int, heavy: int
) -> None:
    assert task.losses.ghost > 0.0
    assert (weights(task, sample(labels(ghost))) == 1.0 + heavy * task.losses.ghost).all()


def test_what_comes_from_outside_of_a_crop_counts_as_hidden_unless_it_is_unknown(
    task: ClassifierTask,
) -> None:
    """Motion of 3 render pixels leads the right quarter of the crop off it."""
    ghost = labels(Ghost.NONE)
    ghost[:, :4] = UNKNOWN
    weight = weights(task, sample(ghost, motion=3.0))[0, 0]
    expected = torch.ones(*DISPLAY[::-1])
    expected[4:, 18:] += task.losses.ghost
    torch.testing.assert_close(weight, expected)


def test_the_classes_of_both_groups_are_learned_from_their_own_labels(task: ClassifierTask) -> None:
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


def test_crops_are_stepped_together_as_they_are_alone(task: ClassifierTask) -> None:
    one, other = sample(labels(Ghost.NONE)), sample(labels(Ghost.SHADING), motion=1.0)
    other = other._replace(color=other.color.flip(3))
    with torch.no_grad():
        both = task.step([one, other], [task.first_state(s) for s in (one, other)])
        each = [task.step([s], [task.first_state(s)]) for s in (one, other)]
    torch.testing.assert_close(both.images, torch.cat([done.images for done in each]), rtol=1e-4, atol=1e-5)
    for states, done in zip(both.states, each, strict=True):
        for a, b in zip(states, done.states[0], strict=True):
            torch.testing.assert_close(a, b, rtol=1e-4, atol=1e-5)


def test_a_state_is_what_a_whole_frame_would_leave(task: ClassifierTask) -> None:
    """The same tensors in the same order as those of the method's own step, without the mean of samples."""
    frame = sample(labels(Ghost.NONE), motion=0.3)
    inputs = {name: getattr(frame, name) for name in ("color", "depth", "motion", "exposure")}
    inputs |= {"jitter": frame.view.jitter, "display_size": torch.tensor(DISPLAY), **plain_inputs(RENDER)}
    history = task.method.first_history(DISPLAY, RENDER)
    state = task.first_state(frame)
    assert torch.equal(state[4], frame.view.jitter)
    for _ in range(3):
        with torch.no_grad():
            done = task.method.step(*(inputs[name] for name in task.method.inputs()), *history)
            stepped = task.step([frame], [state])
        history, state = done.history, stepped.states[0]
        torch.testing.assert_close(stepped.images, done.image)
        for name, a, b in zip(BASE.history, state, history[: len(state)], strict=True):
            torch.testing.assert_close(a, b, msg=name)


def test_gradients_go_through_the_colour_of_the_history_alone(task: ClassifierTask) -> None:
    frame = sample(labels(Ghost.NONE))
    stepped = task.step([frame], [task.first_state(frame)])
    assert [state.requires_grad for state in stepped.states[0]] == [True, False, False, False, False, False]


def test_a_larger_weight_of_ghosts_weighs_more(task: ClassifierTask) -> None:
    heavy = ClassifierTask(task.method, replace(task.losses, ghost=2.0))
    assert (weights(heavy, sample(labels(Ghost.SHADING))) == 3.0).all()
