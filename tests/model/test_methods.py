"""`taa` and `taau` on scenes whose truth is exact; `taa` averages as Salvi's slides say."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from torch import Tensor

from more_scenes import ShadingStep, dots
from shared_models import shared_model
from supersampler import Frame, Upscaler, halton_jitter
from supersampler.frame import Float32
from supersampler.io.display import display_transform
from supersampler.methods.classifier.spec import INPUTS, ClassifierConfig, PaperConfig, SmallConfig
from supersampler.methods.model_file import model_names
from supersampler.methods.registry import methods
from supersampler.methods.taa.spec import TaaConfig
from supersampler_bench.quality import metrics
from supersampler_model import ops
from supersampler_model.data.scenes.analytic import AnalyticScene, DiscOverPlane, Plane, checker, zone_plate
from supersampler_model.methods.base import Method
from supersampler_model.methods.classifier import Classifier, SmallClassifier
from supersampler_model.methods.classifier_paper import PaperClassifier
from supersampler_model.methods.taa import Gathered, Taa
from torch_inputs import Stepped, plain_inputs

RENDER, DISPLAY = (64, 36), (128, 72)
OPTIONS = {
    "clip to centre": TaaConfig(clip="center"),
    "clamp": TaaConfig(clip="clamp"),
    "minimum and maximum alone": TaaConfig(gamma=None),
    "no minimum and maximum": TaaConfig(intersect_extent=False),
    "rgb": TaaConfig(space="rgb"),
    "5x5 window": TaaConfig(window=5),
    "7x7 window": TaaConfig(window=7),
    "a quarter new": TaaConfig(alpha=0.25),
}
SIZE = ops.Size(6, 4)


def psnr(image: Float32, truth: Float32) -> float:
    return metrics.psnr(display_transform(image), display_transform(truth))


def frames(scene: AnalyticScene, count: int) -> Iterator[Frame]:
    for index in range(count):
        yield scene.frame(index, RENDER, halton_jitter(index, 2.0))


def run(name: str, scene: AnalyticScene, count: int) -> list[Float32]:
    upscaler = Upscaler(shared_model(name), display_size=DISPLAY, validate="off")
    return [upscaler.step(frame) for frame in frames(scene, count)]


def run_torch(method: Method, scene: AnalyticScene, count: int) -> list[Float32]:
    stepped = Stepped(method, DISPLAY)
    return [stepped.step(frame) for frame in frames(scene, count)]


@pytest.mark.parametrize("velocity", [(0.37, 0.21), (2.0, -1.3)])
def test_taau_beats_every_other_method_on_a_pan(velocity: tuple[float, float]) -> None:
    scene = Plane(checker, velocity)
    score = {}
    for name in model_names():
        if methods()[name].task:
            continue
        images = run(name, scene, 20)
        score[name] = np.mean([psnr(images[i], scene.truth(i, DISPLAY, 8)) for i in range(12, 20)])
    assert score.pop("taau") > max(score.values()) + 1.0


def test_taau_leaves_no_ghost_behind_a_mover() -> None:
    scene = DiscOverPlane()
    temporal, spatial = run("taau", scene, 16), run("bilinear", scene, 16)
    errors = {"taau": 0.0, "bilinear": 0.0}
    for index in range(8, 16):
        revealed = scene.disoccluded(index, DISPLAY)
        truth = display_transform(scene.truth(index, DISPLAY, 8))
        for name, images in (("taau", temporal), ("bilinear", spatial)):
            errors[name] += float(np.mean((display_transform(images[index]) - truth)[revealed] ** 2))
    assert errors["taau"] < 1.4 * errors["bilinear"]  # three times as much where the history is kept


def coloured_zone_plate(x: NDArray[np.float64], y: NDArray[np.float64]) -> NDArray[np.float64]:
    """In grey, clipping towards any point is the same."""
    return np.stack([zone_plate(x + d, y - d)[..., 0] for d in (0.0, 1.1, 2.3)], axis=-1)


@pytest.mark.parametrize("option", OPTIONS)
def test_every_option_of_salvi_changes_the_image_and_integrates_over_time(option: str) -> None:
    scene = Plane(coloured_zone_plate)
    truth = scene.truth(0, DISPLAY)
    default, other = (run_torch(Taa(c), scene, 32) for c in (None, OPTIONS[option]))
    assert np.abs(default[-1] - other[-1]).max() > 1e-3
    assert np.isfinite(other[-1]).all()
    assert psnr(other[-1], truth) > psnr(other[0], truth) + 0.5


def test_a_larger_gamma_keeps_more_of_the_history() -> None:
    step = ShadingStep(Plane(checker), at=12)
    truth = step.truth(15, DISPLAY)
    small, large = (
        run_torch(Taa(TaaConfig(gamma=g, intersect_extent=False)), step, 16)[15] for g in (0.75, 3.0)
    )
    assert psnr(small, truth) > psnr(large, truth)  # "more temporally stable results at the cost of ghosting"


CHOICES: list[dict[str, Any]] = [
    {"rectified": False},
    {"own_motion": False},
    {"neighbourhood_inputs": ()},
    {"inputs": tuple(name for name in INPUTS if name not in ("count", "contrast", "surface"))},
    {"contraction": 0.0},
    {"recurrent": False},
    {"tone_space": "channels"},
    {"tone_space": "logarithm"},
    {"count_code": "logarithm"},
]
CLASSIFIERS = (
    Classifier(),
    SmallClassifier(SmallConfig(inputs=INPUTS, rectified=True, own_motion=True)),
    PaperClassifier(PaperConfig(inputs=INPUTS)),
    *(Classifier(replace(ClassifierConfig(inputs=INPUTS), **choice)) for choice in CHOICES),
)


@pytest.mark.parametrize("method", CLASSIFIERS, ids=range(len(CLASSIFIERS)))
def test_the_classifier_renders_the_scene_with_any_options(method: Classifier) -> None:
    """Untrained: the paper's network then blends half of the history, ours the running mean."""
    scene = Plane(dots)
    truth = scene.truth(0, DISPLAY)
    images = run_torch(method.eval(), scene, 6)
    assert all(np.isfinite(image).all() and image.min() >= 0.0 for image in images)
    assert psnr(images[-1], truth) > psnr(np.full_like(truth, truth.mean()), truth) + 1.0


def plane(value: float, channels: int = 3) -> Tensor:
    return torch.full((1, channels, SIZE.height, SIZE.width), value)


def gathered(box: ops.Corners, has_history: float = 1.0) -> Gathered:
    """A sample of 0.2 and a history of 0.6, toned RGB."""
    return Gathered(plane(0.2), plane(0.6), plane(has_history, 1), plane(1.0, 1), plane(0.0, 1), box)


@pytest.mark.parametrize(("clip", "cut_to"), [("sample", 0.4), ("center", 0.4), ("clamp", 0.4)])
def test_the_history_is_cut_by_the_box_before_it_is_averaged(clip: str, cut_to: float) -> None:
    method = Taa(TaaConfig(space="rgb", clip=clip))  # type: ignore[arg-type]
    image = method.finish(gathered(ops.Corners(plane(0.1), plane(0.4))), plane(0.1, 1), torch.ones(1))
    torch.testing.assert_close(ops.tone(image), plane(0.02 + 0.9 * cut_to), rtol=1e-4, atol=1e-4)


def test_the_box_is_one_deviation_around_the_mean_and_within_the_extent() -> None:
    color = plane(0.0)
    color[..., 2, 2] = 0.9  # mean 0.1, deviation sqrt(0.09 - 0.01) of the nine around
    deviation = 0.08**0.5
    box = Taa(TaaConfig(space="rgb")).neighbourhood_box(color)
    assert float(box[0][0, 0, 2, 2]) == 0.0, "the extent is the narrower bound below"
    assert float(box[1][0, 0, 2, 2]) == pytest.approx(0.1 + deviation, rel=1e-4)
    wide = Taa(TaaConfig(space="rgb", intersect_extent=False, gamma=2.0)).neighbourhood_box(color)
    assert float(wide[0][0, 0, 2, 2]) == pytest.approx(0.1 - 2.0 * deviation, rel=1e-4)
    extent = Taa(TaaConfig(space="rgb", gamma=None)).neighbourhood_box(color)
    assert [float(corner[0, 0, 2, 2]) for corner in extent] == pytest.approx([0.0, 0.9])


def test_the_reported_weight_is_that_of_the_history() -> None:
    method = Taa()
    planes = {
        "color": plane(0.3),
        "motion": plane(0.0, 2),
        "jitter": torch.zeros(1, 2),
        "exposure": torch.ones(1),
    }
    planes |= {"display_size": torch.tensor(SIZE), **plain_inputs(SIZE)}
    inputs = [planes[name] for name in method.inputs()]
    first = method.step(*inputs, *method.first_history(SIZE, SIZE))
    assert not first.aux_outputs[0].any()
    torch.testing.assert_close(method.step(*inputs, *first.history).aux_outputs[0], plane(0.9, 1))
