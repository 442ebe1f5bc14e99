"""`classifier`: inputs and network, light that is not accumulated yet, and `classifier-large`."""

import numpy as np
import pytest
import torch
from torch import Tensor

from noise import noise
from supersampler import Upscaler
from supersampler.methods.at_rest import AT_REST_HISTORY
from supersampler.methods.classifier import spec
from supersampler.methods.spec import large_size
from supersampler_bench.stress.scenes import still
from supersampler_model import ops
from supersampler_model.methods import classifier_inputs
from supersampler_model.methods.base import load_trained, shipped_weights
from supersampler_model.methods.classifier import Classifier, LargeClassifier, unexplained_light
from supersampler_model.methods.classifier_network import ClassifierNetwork, pack, unpack
from torch_inputs import plain_inputs

DISPLAY = ops.Size(47, 27)
DARK, LIT = 0.2, 0.8
SIZE = ops.Size(16, 8)
HISTORY = classifier_inputs.WarpedHistory(
    *(torch.full((1, 1, 8, 16), value) for value in (DARK, DARK, 0.0, DARK, 4.0, 0.0, 0.0, 0.0, 1.0, 0.0))
)
HISTORY = HISTORY._replace(range=torch.full((1, 2, 8, 16), DARK))


def gathered(value: float | None = None) -> classifier_inputs.Gathered:
    """A frame of noise with a history of noise, `value` here and there in every image."""
    frame = noise(1)
    assert frame.color is not None
    method, random = Classifier(), np.random.default_rng(3)
    images = [
        torch.from_numpy(np.ascontiguousarray(a, np.float32))[None]
        for a in (frame.color.transpose(2, 0, 1), frame.depth[None], frame.motion.transpose(2, 0, 1))
    ]
    history_color, state, classes, depth, *_ = method.first_history(DISPLAY, ops.Size(32, 18))
    history_color = torch.from_numpy(random.gamma(0.5, 2.0, history_color.shape).astype(np.float32))
    state = torch.from_numpy(random.uniform(0.0, 1.0, state.shape).astype(np.float32))
    if value is not None:
        for image in (*images, history_color):
            image[torch.from_numpy(random.random(image.shape) < 0.1)] = value
    history = classifier_inputs.History(history_color, state, classes, depth + 0.02, torch.ones(1))
    view = ops.View(DISPLAY, ops.Size(32, 18), torch.tensor([frame.jitter]))
    with torch.no_grad():
        color, depth, motion = images
        return method.gather(color, depth, motion, torch.ones(1), history, view, view)


@pytest.mark.parametrize("value", [None, float("nan"), float("inf"), -1.0, 65504.0, 1e-40])
def test_inputs_of_the_network_are_at_most_about_one(value: float | None) -> None:
    packed, half = Classifier().network_inputs(gathered(value))
    assert tuple(packed.shape) == (1, 4 * len(spec.DEFAULT_INPUTS), 16, 24)
    assert tuple(half.shape) == (1, spec.CLASSES + len(spec.NEIGHBOURHOOD_INPUTS), 16, 24)
    for seen in (packed, half):
        assert seen.isfinite().all()
        assert seen.min() >= -1.0
        assert seen.max() <= 1.001


@pytest.mark.parametrize(("across", "down", "blur"), [(0.0, 0.0, 0.0), (0.5, 0.0, 0.5), (0.5, 0.5, 1.0)])
def test_the_history_is_blurred_most_where_it_is_read_between_pixels(
    across: float, down: float, blur: float
) -> None:
    g = gathered()
    position = torch.zeros_like(g.reprojection.position) + torch.tensor([4.0 + across, 7.0 + down])
    seen = classifier_inputs.pixel_inputs(
        g._replace(reprojection=g.reprojection._replace(position=position))
    )["blur"]
    torch.testing.assert_close(seen, torch.full_like(seen, blur))


@pytest.mark.parametrize(
    ("code", "of_one", "of_64"), [("saturating", 0.2, 64 / 68), ("logarithm", 0.166, 1.0)]
)
def test_counts_are_encoded_from_0_without_samples_towards_1(
    code: spec.CountCode, of_one: float, of_64: float
) -> None:
    encoded = classifier_inputs.COUNTS[code](torch.tensor([0.0, 1.0, 64.0]))
    assert encoded.tolist() == pytest.approx([0.0, of_one, of_64], abs=1e-3)


@pytest.mark.parametrize("channels", [8, 2])
def test_the_network_infers_the_same_from_pixels_as_from_packed_ones(channels: int) -> None:
    torch.manual_seed(0)
    config = spec.NetworkConfig(levels=(8, 8, 32, 64), decoder=8, hidden=8)
    network = ClassifierNetwork(config, packed=12, half_inputs=channels, blend_parameters=3).eval()
    torch.nn.init.normal_(network.blend.weight)
    pixels = torch.rand(1, 3, 32, 48)
    half_inputs = torch.rand(1, channels, 16, 24)
    with torch.no_grad():
        logits, blend = network(pack(pixels), half_inputs)
        logits_of_pixels, blend_of_pixels = network.on_pixels([pixels[:, :1], pixels[:, 1:]], half_inputs)
    torch.testing.assert_close(logits_of_pixels, logits, rtol=1e-4, atol=1e-5)
    torch.testing.assert_close(blend_of_pixels, unpack(blend), rtol=1e-4, atol=1e-5)


def test_without_samples_the_history_keeps_its_count_and_range() -> None:
    g, method = gathered(), Classifier().eval()
    nothing = {name: getattr(g.current, name) * 0.0 for name in ("sample", "confidence", "sampled", "glare")}
    warped = g.warped._replace(surface=g.warped.surface * 0.0 + 1.0, glare=g.warped.glare * 0.0)
    alone = g._replace(current=g.current._replace(**nothing), warped=warped, reactive=warped.samples * 0.0)
    with torch.no_grad():
        state = method.finish(alone, *method.infer(alone)).state
    kept = ops.cut_to(torch.cat([warped.samples, warped.range], dim=1), DISPLAY)
    known = (kept[:, :1] > 0.0).expand_as(kept)
    assert known.float().mean() > 0.5
    torch.testing.assert_close(state[known], kept[known])


def spots(count: int) -> Tensor:
    luma = torch.full((1, 1, 8, 16), DARK)
    luma.view(-1)[: 5 * count : 5] = LIT
    return luma


def test_sparse_light_over_all_of_the_history_is_unexplained_where_it_is() -> None:
    luma, around = spots(4), torch.full((1, 1, 8, 16), DARK)
    assert torch.equal(unexplained_light(luma, around, HISTORY, SIZE, None), luma > DARK)


def test_a_few_bright_pixels_are_a_glint_and_an_area_that_comes_to_light_is_explained() -> None:
    dark, area = torch.full((1, 1, 8, 16), DARK), torch.full((1, 1, 8, 16), DARK)
    area[..., 8:] = LIT
    for luma, around in ((spots(2), dark), (area, area)):
        assert not unexplained_light(luma, around, HISTORY, SIZE, None).any()


@pytest.mark.parametrize(("render", "display"), [((16, 9), (32, 18)), ((13, 7), (21, 11)), ((1, 1), (1, 1))])
def test_the_image_is_that_of_the_classifier_at_the_larger_size_filtered(
    render: tuple[int, int], display: tuple[int, int]
) -> None:
    trained = load_trained(shipped_weights("classifier"))
    large = LargeClassifier.from_classifier(trained)
    classifier = Classifier(large.config).eval()
    classifier.load_state_dict(large.state_dict())
    inner = ops.Size(*large_size(ops.Size(*display)))
    ours = large.first_history(ops.Size(*display), ops.Size(*render))
    theirs = classifier.first_history(inner, ops.Size(*render))
    own = len(ours) - len(AT_REST_HISTORY)  # the mean of what stands still has the size of the display
    assert [t.shape for t in ours[:own]] == [t.shape for t in theirs[:own]]
    generator = torch.Generator().manual_seed(0)
    for _ in range(3):
        color, depth = (torch.rand(1, c, *render[::-1], generator=generator) for c in (3, 1))
        motion, jitter = torch.zeros(1, 2, *render[::-1]), torch.rand(1, 2, generator=generator) - 0.5
        frame = {"color": color, "depth": depth, "motion": motion, "jitter": jitter, **plain_inputs(render)}
        frame["exposure"] = torch.tensor([2.0])
        sizes = {"display_size": torch.tensor(display)}, {"display_size": torch.tensor(inner)}
        outer, larger = ([({**frame, **one})[name] for name in large.inputs()] for one in sizes)
        with torch.no_grad():
            image, ours, maps = large.step(*outer, *ours)
            whole, theirs, _ = classifier.step(*larger, *theirs)
        torch.testing.assert_close(image, ops.downsample(whole, ops.Size(*display), torch.tensor([2.0])))
        assert image.shape[2:] == display[::-1]
        assert [m.shape[2:] for m in maps] == [display[::-1]] * 2


@pytest.mark.parametrize("executor", ["cpu", "onnx"])
def test_maps_have_the_sizes_of_the_display(executor: str) -> None:
    upscaler = Upscaler("classifier-large", display_size=(33, 19), executor=executor, threads=1)  # type: ignore[arg-type]
    for frame in still((18, 10))[:3]:
        result = upscaler.step(frame, outputs=("class_map", "weight", "count", "converged"))
    maps = {name: getattr(result, name).shape for name in ("class_map", "weight", "count", "converged")}
    assert maps.pop("class_map") == (10, 17, 6)
    assert set(maps.values()) == {(19, 33)}
    assert upscaler.stats.converged is not None
