"""Kernels compiled for a classifier's config compute the same images as torch."""

import json
from dataclasses import asdict, replace
from hashlib import sha256
from typing import Any

import numpy as np
import pytest
import torch
from torch import Tensor, nn

from noise import Size, noise
from supersampler import Frame, Model, Upscaler
from supersampler.backends.onnx.session import frame_inputs
from supersampler.frame import Float32
from supersampler.io.display import display_transform
from supersampler.methods.classifier.spec import ClassifierConfig, NetworkConfig
from supersampler.methods.classifier.variant import CONFIGURED, Variant
from supersampler.methods.model_file import find_model
from supersampler_export import calibrate
from supersampler_export.cpu_network import cpu_network
from supersampler_model.methods.classifier.model import Classifier
from supersampler_model.ops.size import Size as ModelSize

VARIANTS = [
    Variant(corrected=False, rectified=False, own_motion=False),
    Variant(
        corrected=True, rectified=False, own_motion=True
    ),  # 19 outputs: those of four pixels are no multiple of eight
]
TINY = NetworkConfig(levels=(16, 16, 32, 64), decoder=16, hidden=16)
Made = tuple[Classifier, Model]


@pytest.fixture(scope="module", params=VARIANTS, ids=lambda variant: variant.kernel("with"))
def made(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Made:
    """A method with random weights, and its model: of the folder only what the CPU backend needs."""
    method = Classifier(
        ClassifierConfig(network=TINY, **{n: getattr(request.param, n) for n in CONFIGURED})
    ).eval()
    torch.manual_seed(0)
    assert isinstance(method.net.blend, nn.Conv2d)
    assert method.net.blend.bias is not None
    nn.init.normal_(method.net.blend.weight, std=0.5)  # zeros would hide what lies where
    nn.init.normal_(method.net.blend.bias, std=0.5)
    folder = tmp_path_factory.mktemp("model")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(calibrate, "FRAMES", 2)
        network = cpu_network(method)
    assert network is not None
    (folder / "network.npz").write_bytes(network)
    described = json.loads((find_model("classifier") / "model.json").read_text())
    described["config"] = asdict(method.config)
    described["files"] = {"network.npz": sha256(network).hexdigest()}
    (folder / "model.json").write_text(json.dumps(described))
    return method, Model.load(folder, threads=2, executor="cpu")


def step_both(made: Made, frames: list[Frame], display: Size) -> list[tuple[Float32, Float32]]:
    """Images of torch and of the CPU backend, (H, W, 3)."""
    method, model = made
    upscaler = Upscaler(model, display_size=display, validate="off", skip="exact")
    history: Any = method.first_history(ModelSize(*display), ModelSize(*frames[0].size))
    pairs = []
    for frame in frames:
        inputs = frame_inputs(frame, display, method.inputs())
        tensors: list[Tensor] = [
            torch.from_numpy(np.ascontiguousarray(inputs[name])) for name in method.inputs()
        ]
        with torch.no_grad():
            image, history, _ = method.step(*tensors, *history)
        pairs.append((image[0].permute(1, 2, 0).numpy(), upscaler.step(frame)))
    return pairs


def compare(pairs: list[tuple[Float32, Float32]]) -> None:
    for ours, theirs in pairs:
        off = np.abs(display_transform(ours) - display_transform(theirs))
        assert off.mean() <= 3e-3
        assert np.quantile(off, 0.99) <= 0.03


@pytest.mark.parametrize(
    ("render", "display"), [((33, 17), (50, 27)), ((61, 35), (61, 35)), ((5, 40), (11, 93)), ((1, 1), (2, 2))]
)
def test_every_variant_computes_what_torch_computes(made: Made, render: Size, display: Size) -> None:
    compare(step_both(made, [noise(seed, render) for seed in range(4)], display))


@pytest.mark.parametrize("bad", [np.nan, np.inf, -1.0, 1e30])
def test_hostile_pixels_do_the_same_to_every_variant(made: Made, bad: float) -> None:
    frames = [noise(seed) for seed in range(4)]
    spots = np.random.default_rng(0).random((18, 32)) < 0.05
    spoilt: dict[str, Any] = {}
    for name in ("color", "depth", "motion"):
        spoilt[name] = np.array(getattr(frames[2], name), np.float32)
        spoilt[name][spots] = bad
    frames[2] = replace(frames[2], **spoilt)
    pairs = step_both(made, frames, (64, 36))
    assert all(np.isfinite(theirs).all() and theirs.min() >= 0.0 for _, theirs in pairs)
    compare(pairs)


def test_a_variant_says_what_its_config_counts() -> None:
    for corrected in (False, True):
        for rectified in (False, True):
            for own in (False, True):
                variant = Variant(corrected, rectified, own)
                config = ClassifierConfig(corrected=corrected, rectified=rectified, own_motion=own)
                assert variant == Variant.of(asdict(config))
                assert variant == Variant.with_parts(*variant.kernel("module.function").split("+")[1:])
                assert variant.blend_parameters == config.blend_parameters
