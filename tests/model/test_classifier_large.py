"""`classifier-large` is `classifier` on a larger history: its image, maps and weights."""

import pytest
import torch

from supersampler import ArgumentError, Upscaler
from supersampler.methods.at_rest import AT_REST_HISTORY
from supersampler.methods.spec import large_size
from supersampler_bench.stress.scenes import still
from supersampler_model import ops
from supersampler_model.methods.base import load_trained, shipped_weights
from supersampler_model.methods.classifier import Classifier, LargeClassifier
from torch_inputs import plain_inputs


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


def test_weights_of_another_method_are_refused() -> None:
    trained = load_trained(shipped_weights("classifier-small"))
    with pytest.raises(ArgumentError, match="of classifier-small; want of classifier"):
        LargeClassifier.from_classifier(trained)


@pytest.mark.parametrize("executor", ["cpu", "onnx"])
def test_maps_have_the_sizes_of_the_display(executor: str) -> None:
    upscaler = Upscaler("classifier-large", display_size=(33, 19), executor=executor, threads=1)  # type: ignore[arg-type]
    for frame in still((18, 10))[:3]:
        result = upscaler.step(frame, outputs=("class_map", "weight", "count", "converged"))
    maps = {name: getattr(result, name).shape for name in ("class_map", "weight", "count", "converged")}
    assert maps.pop("class_map") == (10, 17, 6)
    assert set(maps.values()) == {(19, 33)}
    assert upscaler.stats.converged is not None
