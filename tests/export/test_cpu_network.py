"""The CPU kernels compute what torch computes, for every compiled variant of the network."""

import json
from dataclasses import asdict, replace
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch import nn

from gbuffer_method import textured
from noise import Size, noise
from supersampler import Frame, Model, Upscaler
from supersampler.frame import Float32
from supersampler.io.display import display_transform
from supersampler.methods.classifier.spec import ClassifierConfig, NetworkConfig
from supersampler.methods.gbuffer_fast.spec import GuidedConfig
from supersampler.methods.gbuffers import arrays_by_name, frame_of
from supersampler.methods.model_file import find_model
from supersampler_export import quantize
from supersampler_export.quantize import cpu_network
from supersampler_model.methods.classifier import Classifier
from supersampler_model.methods.classifier_paper import PaperClassifier
from supersampler_model.methods.gbuffer_fast import GuidedClassifier
from supersampler_model.methods.taau import Taau
from torch_inputs import Stepped

TINY = NetworkConfig(levels=(16, 16, 32, 64), decoder=16, hidden=16)
Made = tuple[Classifier, Model]


def with_random_weights(method: Classifier, folder: Path) -> Made:
    """Return the method, and its model, written to `folder` with only what the CPU backend needs."""
    torch.manual_seed(0)
    assert isinstance(method.net.blend, nn.Conv2d)
    assert method.net.blend.bias is not None
    nn.init.normal_(method.net.blend.weight, std=0.5)  # zeros would hide what lies where
    nn.init.normal_(method.net.blend.bias, std=0.5)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(quantize, "FRAMES", 2)
        network = cpu_network(method.eval())
    assert network is not None
    (folder / "network.npz").write_bytes(network)
    described = json.loads((find_model(method.name) / "model.json").read_text())
    described["config"] = asdict(method.config)
    described["files"] = {"network.npz": sha256(network).hexdigest()}
    (folder / "model.json").write_text(json.dumps(described))
    return method, Model.load(folder, threads=2, executor="cpu")


def step_both(made: Made, frames: list[Frame], display: Size) -> list[tuple[Float32, Float32]]:
    method, model = made
    upscaler, torch_steps = Upscaler(model, display_size=display, validate="off"), Stepped(method, display)
    return [(torch_steps.step(frame), upscaler.step(frame)) for frame in frames]


def compare(pairs: list[tuple[Float32, Float32]]) -> None:
    """Assert that images differ by what an int8 network explains."""
    for ours, theirs in pairs:
        off = np.abs(display_transform(ours) - display_transform(theirs))
        assert off.mean() <= 3e-3
        assert np.quantile(off, 0.99) <= 0.03


RENDER, DISPLAY = (32, 18), (64, 36)
CONFIGS = {
    "no further colours": ClassifierConfig(network=TINY, rectified=False, own_motion=False),
    "own motion": ClassifierConfig(network=TINY, rectified=False),  # 60 outputs: not a multiple of eight
    "guided": GuidedConfig(network=TINY),
}


@pytest.mark.parametrize("method", [Taau(), PaperClassifier(), Classifier(ClassifierConfig(recurrent=False))])
def test_methods_and_constants_without_kernels_have_no_int8_network(method: Any) -> None:
    assert cpu_network(method) is None


@pytest.fixture(scope="module", params=CONFIGS)
def made(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Made:
    config = CONFIGS[request.param]
    kind = GuidedClassifier if isinstance(config, GuidedConfig) else Classifier
    return with_random_weights(kind(config), tmp_path_factory.mktemp("model"))


def with_arrays(frame: Frame, arrays: dict[str, Any]) -> Frame:
    """Return the frame with these arrays, by tensor name, in place of its own."""
    return frame_of({**arrays_by_name(frame), **arrays}, jitter=frame.jitter, reset=frame.reset)


def frames_for(made: Made, render: Size = RENDER, display: Size = DISPLAY) -> list[Frame]:
    """Return four frames of noise, with G-buffers where the model reads them."""
    frames = [noise(seed, render) for seed in range(4)]
    if not made[1].info.gbuffers:
        return frames
    for seed, frame in enumerate(frames):
        sampled, shown = textured(render, frame.jitter, 0.01 * seed), textured(display, moved=0.01 * seed)
        del sampled["depth"]
        frames[seed] = replace(frame, gbuffer=sampled, gbuffer_display=shown)
    return frames


@pytest.mark.parametrize(
    ("render", "display"),
    [((33, 17), (50, 27)), ((61, 35), (61, 35)), ((21, 13), (63, 39)), ((5, 40), (11, 93)), ((1, 1), (2, 2))],
)
def test_every_variant_computes_what_torch_computes(made: Made, render: Size, display: Size) -> None:
    compare(step_both(made, frames_for(made, render, display), display))


def test_half_floats_have_the_images_of_floats(made: Made) -> None:
    frames = []
    for frame in frames_for(made):
        arrays = {name: array for name, array in arrays_by_name(frame).items() if not name.endswith("depth")}
        frames.append(with_arrays(frame, {name: a.astype(np.float16) for name, a in arrays.items()}))
    compare(step_both(made, frames, DISPLAY))


@pytest.mark.parametrize("bad", [np.nan, np.inf, -1.0, 1e30])
def test_invalid_pixels_have_the_same_effect_on_every_variant(made: Made, bad: float) -> None:
    frames, random = frames_for(made), np.random.default_rng(0)
    arrays = {name: np.array(array, np.float32) for name, array in arrays_by_name(frames[2]).items()}
    for array in arrays.values():
        array[random.random(array.shape[:2]) < 0.05] = bad
    frames[2] = replace(with_arrays(frames[2], arrays), reset=False)
    pairs = step_both(made, frames, DISPLAY)
    assert all(np.isfinite(theirs).all() and theirs.min() >= 0.0 for _, theirs in pairs)
    compare(pairs)
