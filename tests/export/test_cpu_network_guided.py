"""Kernels of `gbuffer-fast` compute the same images as torch."""

import json
from dataclasses import asdict, replace
from hashlib import sha256
from typing import Any

import numpy as np
import pytest
import torch
from torch import nn

from noise import Size, noise
from supersampler import Frame, Model, Upscaler
from supersampler.backends.onnx.session import frame_inputs
from supersampler.frame import Float32
from supersampler.io.display import display_transform
from supersampler.methods.classifier.spec import NetworkConfig
from supersampler.methods.gbuffer_fast.spec import GBUFFER_FAST, GBUFFERS_READ, GuidedConfig
from supersampler.methods.gbuffers import GBUFFERS, grouped
from supersampler.methods.model_file import find_model
from supersampler.methods.spec import INPUTS, Shape, dtype_of
from supersampler_export import calibrate
from supersampler_export.cpu_network import cpu_network
from supersampler_model.methods.gbuffer_fast.model import GuidedClassifier
from supersampler_model.ops.size import Size as ModelSize

TINY = NetworkConfig(levels=(16, 16, 32, 64), decoder=16, hidden=16)
Made = tuple[GuidedClassifier, Model]


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Made:
    """The method with random weights, and its model: of the folder only what the CPU backend needs."""
    method = GuidedClassifier(GuidedConfig(network=TINY)).eval()
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
    described["method"], described["config"] = GBUFFER_FAST.name, asdict(method.config)
    described["files"] = {"network.npz": sha256(network).hexdigest()}
    described["ratios"] = list(GBUFFER_FAST.ratios)
    described["inputs"] = [_tensor(name, INPUTS[name]) for name in GBUFFER_FAST.inputs]
    described["history"] = [
        {**_tensor(f"history.{name}", shape), "output": f"next.{name}"}
        for name, shape in GBUFFER_FAST.history.items()
    ]
    (folder / "model.json").write_text(json.dumps(described))
    return method, Model.load(folder, threads=2, executor="cpu")


def _tensor(name: str, shape: Shape) -> dict[str, Any]:
    return {"name": name, "type": dtype_of(name), "shape": list(shape)}


def surfaces(seed: int, render: Size, display: Size) -> dict[str, Any]:
    """Return G-buffers of patches of colour that face this way or that; the sky above."""
    made: dict[str, Any] = {}
    for name in GBUFFERS_READ:
        width, height = display if GBUFFERS[name].of_display else render
        y, x = np.mgrid[:height, :width].astype(np.float32)
        u, v = (x + 0.5) / width, (y + 0.5) / height
        wave = np.sin(9.0 * u + seed) * np.cos(7.0 * v)
        if name.endswith("base_color"):
            made[name] = np.stack([0.5 + 0.5 * wave, (wave > 0.0) * 1.0, u], -1).astype(np.float32)
        elif name.endswith("normal"):
            normal = np.stack([wave, 0.3 * wave, 1.0 + 0.0 * wave], -1)
            made[name] = (normal / np.linalg.norm(normal, axis=-1, keepdims=True)).astype(np.float32)
            made[name][v < 0.2] = 0.0
        else:
            made[name] = (0.02 + 0.01 * (np.sin(0.3 * u * render[0]) > 0.3)).astype(np.float32)
    return made


def surfaced(seed: int, render: Size, display: Size) -> Frame:
    """Return a frame of noise with the G-buffers that the method reads."""
    gbuffer, gbuffer_display = grouped(surfaces(seed, render, display))
    return noise(seed, render, gbuffer=gbuffer, gbuffer_display=gbuffer_display)


def test_half_floats_are_read_as_the_numbers_that_they_are(made: Made) -> None:
    display, halves = (64, 36), []
    for seed in range(3):
        buffers = surfaces(seed, (32, 18), display)
        for name in buffers:
            buffers[name] = buffers[name].astype(np.float32 if name.endswith("depth") else np.float16)
        gbuffer, gbuffer_display = grouped(buffers)
        halves.append(noise(seed, gbuffer=gbuffer, gbuffer_display=gbuffer_display))
    compare(step_both(made, halves, display))


def step_both(made: Made, frames: list[Frame], display: Size) -> list[tuple[Float32, Float32]]:
    """Images of torch and of the CPU backend, (H, W, 3)."""
    method, model = made
    upscaler = Upscaler(model, display_size=display, validate="off", skip="exact")
    history: Any = method.first_history(ModelSize(*display), ModelSize(*frames[0].size))
    pairs = []
    for frame in frames:
        inputs = frame_inputs(frame, display, method.inputs())
        tensors = [torch.from_numpy(np.ascontiguousarray(inputs[name])) for name in method.inputs()]
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
    ("render", "display"),
    [
        ((33, 17), (50, 27)),
        ((61, 35), (61, 35)),
        ((21, 13), (63, 39)),
        ((16, 10), (64, 40)),
        ((1, 1), (2, 2)),
    ],
)
def test_the_kernels_compute_what_torch_computes(made: Made, render: Size, display: Size) -> None:
    compare(step_both(made, [surfaced(seed, render, display) for seed in range(4)], display))


@pytest.mark.parametrize("bad", [np.nan, np.inf, -2.0, 1e30])
def test_hostile_pixels_do_the_same_to_both(made: Made, bad: float) -> None:
    display = (64, 36)
    frames = [surfaced(seed, (32, 18), display) for seed in range(4)]
    spots = np.random.default_rng(0).random((18, 32)) < 0.05
    spoilt: dict[str, Any] = {}
    for name in ("color", "depth", "motion"):
        spoilt[name] = np.array(getattr(frames[2], name), np.float32)
        spoilt[name][spots] = bad
    buffers = surfaces(2, (32, 18), display)
    for buffer in buffers.values():
        buffer[np.random.default_rng(1).random(buffer.shape[:2]) < 0.05] = bad
    gbuffer, gbuffer_display = grouped(buffers)
    frames[2] = replace(frames[2], **spoilt, gbuffer=gbuffer, gbuffer_display=gbuffer_display)
    pairs = step_both(made, frames, display)
    assert all(np.isfinite(theirs).all() and theirs.min() >= 0.0 for _, theirs in pairs)
    compare(pairs)
