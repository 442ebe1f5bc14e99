"""Classifiers with random weights, stepped in torch and by the kernels of the CPU backend."""

import json
from dataclasses import asdict
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch import nn

from noise import Size
from supersampler import Frame, Model, Upscaler
from supersampler.frame import Float32
from supersampler.io.display import display_transform
from supersampler.methods.classifier.spec import NetworkConfig
from supersampler.methods.model_file import find_model
from supersampler_export import quantize
from supersampler_export.quantize import cpu_network
from supersampler_model.methods.classifier import Classifier
from supersampler_model.ops.images import Size as ModelSize
from torch_inputs import tensors_of

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
    """Return the images of torch and of the CPU backend, (H, W, 3)."""
    method, model = made
    upscaler = Upscaler(model, display_size=display, validate="off")
    history: Any = method.first_history(ModelSize(*display), ModelSize(*frames[0].size))
    pairs = []
    for frame in frames:
        tensors = tensors_of(frame, display, method.inputs()).values()
        with torch.no_grad():
            image, history, _ = method.step(*tensors, *history)
        pairs.append((image[0].permute(1, 2, 0).numpy(), upscaler.step(frame)))
    return pairs


def compare(pairs: list[tuple[Float32, Float32]]) -> None:
    """Assert that images differ by what an int8 network explains."""
    for ours, theirs in pairs:
        off = np.abs(display_transform(ours) - display_transform(theirs))
        assert off.mean() <= 3e-3
        assert np.quantile(off, 0.99) <= 0.03
