"""`extrapolate` equals `classifier` before training; each of its encoders sees one kind of frame."""

from collections.abc import Mapping

import numpy as np
import pytest
import torch
from torch import Tensor

from lit_scene import LitScene
from shared_models import shared_model
from supersampler import Upscaler, halton_jitter
from supersampler.errors import ArgumentError
from supersampler.frame import Float32
from supersampler_model import ops
from supersampler_model.methods.base import Method, Trained, load_trained, shipped_weights
from supersampler_model.methods.classifier import Classifier
from supersampler_model.methods.extrapolate import Extrapolate, UnshadedExtrapolate
from supersampler_model.methods.guided_warp import GuidedWarp
from torch_inputs import step_by_name, tensors_of

RENDER, DISPLAY = (40, 23), (80, 46)
SCENE = LitScene(velocity=(1.3, -0.6), radius=7.0, disc_velocity=(2.5, 0.5), sky=5.0)
State = list[Tensor]
Sizes = tuple[int, int]


@pytest.fixture(scope="module")
def weights() -> Trained:
    return load_trained(shipped_weights("classifier"))


@pytest.fixture(scope="module")
def classifier(weights: Trained) -> Classifier:
    return Classifier.of(weights)


@pytest.fixture
def from_classifier(weights: Trained) -> Extrapolate:
    return Extrapolate.from_classifier(weights)


def given(index: int, render: Sizes = RENDER, display: Sizes = DISPLAY) -> dict[str, Tensor]:
    frame = SCENE.frame(index, render, halton_jitter(index, 2.0))
    names = [*UnshadedExtrapolate.inputs(), "gbuffer_normal", "adds_samples"]
    return tensors_of(frame, display, names)


def step(method: Method, inputs: Mapping[str, Tensor], history: State) -> tuple[Tensor, State]:
    image, history, _ = step_by_name(method, inputs, history)
    return image, history


def first(method: Method, render: Sizes = RENDER) -> State:
    return method.first_history(ops.Size(*DISPLAY), ops.Size(*render))


def test_before_training_shaded_frames_are_those_of_classifier_bit_for_bit(
    classifier: Classifier, from_classifier: Extrapolate
) -> None:
    ours, theirs = first(from_classifier), first(classifier)
    for index in range(4):
        one, ours = step(from_classifier, given(index), ours)
        other, theirs = step(classifier, given(index), theirs)
        assert torch.equal(one, other)
    assert all(torch.equal(a, b) for a, b in zip(ours, theirs[: len(ours)], strict=True))


@pytest.mark.parametrize("pattern", ["susu", "suusus"])
def test_before_training_extrapolated_frames_are_those_of_classifier(
    from_classifier: Extrapolate, pattern: str
) -> None:
    inner, history, shaded = from_classifier.on_extrapolated(), first(from_classifier), State()
    model = shared_model("classifier", "onnx")
    upscaler = Upscaler(model, display_size=DISPLAY, extrapolation="guided-warp", validate="off")
    for index, kind in enumerate(pattern):
        inputs, frame = given(index), SCENE.frame(index, RENDER, halton_jitter(index, 2.0))
        if kind == "s":
            shaded = GuidedWarp().after_shaded(inputs)
            image, history = step(from_classifier, inputs, history)
            theirs = upscaler.step(frame)
        else:
            color, shaded = step(GuidedWarp(), inputs, shaded)
            image, history = step(inner, {**inputs, "color": color}, history)
            theirs = upscaler.extrapolate(SCENE.frame(index, RENDER, halton_jitter(index, 2.0), color=None))
        off: Float32 = np.abs(image[0].permute(1, 2, 0).numpy() - theirs)
        assert np.quantile(off, 0.99) < 1e-4  # of torch and ONNX Runtime


def changed(method: Extrapolate, encoder: str) -> Extrapolate:
    with torch.no_grad():
        for parameter in method.net.get_submodule(encoder).parameters():
            parameter.add_(0.3)
    return method


@pytest.mark.parametrize("encoder", ["encoder", "extrapolated_encoder"])
def test_each_encoder_sees_frames_of_one_kind_alone(
    weights: Trained, from_classifier: Extrapolate, encoder: str
) -> None:
    other = changed(Extrapolate.from_classifier(weights), encoder)
    _, history = step(from_classifier, given(0), first(from_classifier))
    of_shaded, of_drawn = (
        torch.equal(step(a, given(1), history)[0], step(b, given(1), history)[0])
        for a, b in ((from_classifier, other), (from_classifier.on_extrapolated(), other.on_extrapolated()))
    )
    assert (of_shaded, of_drawn) == (encoder != "encoder", encoder == "encoder")


def test_once_trained_extrapolated_frames_depend_on_base_colour(from_classifier: Extrapolate) -> None:
    inner = changed(from_classifier, "extrapolated_encoder").on_extrapolated()
    _, history = step(from_classifier, given(0), first(from_classifier))
    inputs = given(1)
    black = {**inputs, "gbuffer_base_color": torch.zeros_like(inputs["gbuffer_base_color"])}
    assert not torch.equal(step(inner, inputs, history)[0], step(inner, black, history)[0])


def test_weights_of_another_method_are_refused(weights: Trained) -> None:
    with pytest.raises(ArgumentError, match="want of classifier or classifier-small"):
        Extrapolate.from_classifier(weights._replace(method="gbuffer-small"))
    with pytest.raises(ArgumentError, match="want of extrapolate"):
        Extrapolate.of(weights)


def test_weights_of_both_sizes_begin_it(weights: Trained) -> None:
    small = Extrapolate.from_classifier(load_trained(shipped_weights("classifier-small")))
    assert small.config.network.levels == (16, 32, 64, 128)
    assert small.provenance["steps"] > 0


@pytest.mark.parametrize("bad", [float("nan"), float("inf"), float("-inf"), -3.0, 1e30])
def test_base_colour_out_of_range_spoils_no_pixel(from_classifier: Extrapolate, bad: float) -> None:
    inner = changed(from_classifier, "extrapolated_encoder").on_extrapolated()
    _, history = step(from_classifier, given(0), first(from_classifier))
    inputs = given(1)
    inputs["gbuffer_base_color"][:, :, 3:9, 4:20] = bad
    image, history = step(inner, inputs, history)
    assert image.isfinite().all()
    assert (image >= 0.0).all()
    assert all(tensor.isfinite().all() for tensor in history)
