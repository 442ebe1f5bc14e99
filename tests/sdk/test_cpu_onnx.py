"""`executor="cpu+onnx"`: kernels gather and compose, ONNX Runtime runs the network in between."""

import itertools
import json
import shutil
from collections.abc import Mapping
from dataclasses import replace
from functools import cache
from hashlib import sha256
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from compact_frames import cropped
from noise import Size, noise
from shared_models import shared_model
from supersampler import ArgumentError, Frame, Model, ModelError, Shot, Upscaler
from supersampler.backends.onnx.runtime import NAMES, ort
from supersampler.errors import ProviderError
from supersampler.frame import Float32
from supersampler.io.display import display_transform
from supersampler.methods.model_file import find_model, model_names, read_model_info
from supersampler_bench.specs import with_default_gbuffers
from supersampler_bench.stress.scenes import still

METHODS = [name for name in model_names() if "int8" in read_model_info(find_model(name)).networks]
BOUNDS: Mapping[tuple[str, str], tuple[float, float]] = {
    ("int8", "cpu"): (1e-3, 0.015),
    ("fp32", "onnx"): (5e-4, 5e-3),
}
"""Mean difference, and that at 99.9 % of values, of images in [0, 1]: from the CPU backend, of the same
network; from the ONNX backend, whose network has inputs that are not rounded to bytes."""
SIZES = [((33, 17), (50, 26)), ((61, 35), (61, 35)), ((5, 40), (11, 93)), ((1, 1), (2, 2))]


@cache
def model(name: str, executor: Any, precision: Any = "auto") -> Model:
    return shared_model(name, executor=executor, precision=precision, threads=2, providers="cpu")


def step_both(name: str, kind: tuple[str, str], frames: list[Frame], display: Size) -> list[tuple[Any, Any]]:
    precision, other = kind
    models = model(name, "cpu+onnx", precision), model(name, other)
    pair = [Upscaler(one, display_size=display, validate="off") for one in models]
    frames = [with_default_gbuffers(frame, models[0].info.gbuffers, display) for frame in frames]
    results = [[u.step(frame, outputs=("weight", "class_map")) for u in pair] for frame in frames]
    return [(one, two) for one, two in results]


def check(one: Float32, two: Float32, bounds: tuple[float, float]) -> None:
    off = np.abs(display_transform(one) - display_transform(two))
    assert off.mean() <= bounds[0]
    assert np.quantile(off, 0.999) <= bounds[1]


@pytest.mark.parametrize("kind", BOUNDS)
@pytest.mark.parametrize("name", METHODS)
def test_frames_of_a_shot_have_the_images_of_the_backend_with_the_same_network(
    name: str, kind: tuple[str, str]
) -> None:
    frames = [cropped(item.frame, 160, 90) for item in itertools.islice(Shot.open("plaza"), 6)]
    for one, two in step_both(name, kind, frames, (275, 153)):
        check(one.image, two.image, BOUNDS[kind])
        np.testing.assert_allclose(one.weight, two.weight, atol=0.5)
        assert np.abs(one.weight - two.weight).mean() <= 0.02
        assert np.abs(one.class_map - two.class_map).mean() <= 0.02


@pytest.mark.parametrize("kind", BOUNDS)
@pytest.mark.parametrize(("render", "display"), SIZES)
def test_sizes_may_be_odd(render: Size, display: Size, kind: tuple[str, str]) -> None:
    frames = [noise(seed, render) for seed in range(4)]
    for one, two in step_both("classifier", kind, frames, display):
        off = np.abs(display_transform(one.image) - display_transform(two.image))
        assert off.mean() <= 3e-3
        assert np.quantile(off, 0.99) <= 0.03


@pytest.mark.parametrize("precision", ["fp32", "int8"])
def test_skipping_changes_no_bit(precision: str) -> None:
    loaded = model("classifier", "cpu+onnx", precision)
    options: dict[str, Any] = {"display_size": (640, 64), "validate": "off"}
    one, two = (Upscaler(loaded, **options, skip=skip) for skip in (True, False))
    frames = still((320, 32))
    for index in range(3 * len(frames)):
        frame = frames[index % len(frames)]
        if index > 2 * len(frames):  # part of the image changes, the rest is frozen
            color = np.array(frame.color)
            color[8:16, index % 32 : index % 32 + 8] = 0.9
            frame = replace(frame, color=color)
        np.testing.assert_array_equal(one.step(frame), two.step(frame))
    converged = one.stats.converged
    assert converged is not None
    assert 0.3 < converged < 1.0


def test_it_says_what_runs_where() -> None:
    found = model("classifier", "cpu+onnx")
    assert (found.executor, found.precision) == ("cpu+onnx", "fp32")
    assert found.providers == ["CPUExecutionProvider"]
    assert model("classifier", "cpu+onnx", "int8").precision == "int8"
    plan = found.plan((320, 180), (640, 360))
    assert plan.history_bytes == model("classifier", "cpu").plan((320, 180), (640, 360)).history_bytes
    assert plan.working_bytes is None  # ONNX Runtime does not say what it takes


def test_it_continues_a_history_of_the_cpu_backend() -> None:
    frame, kernels, found = noise(0, (32, 18)), model("classifier", "cpu"), model("classifier", "cpu+onnx")
    _, history = kernels.run(frame, kernels.first_history((64, 36), (32, 18)))
    image, _ = found.run(noise(1, (32, 18)), history)
    other, _ = kernels.run(noise(1, (32, 18)), history)
    off = np.abs(display_transform(image) - display_transform(other))
    assert off.mean() <= 3e-3


def test_the_time_of_the_network_is_a_stage() -> None:
    loaded = shared_model("classifier", executor="cpu+onnx")
    upscaler = Upscaler(loaded, display_size=(64, 36), validate="off")
    upscaler.step(noise(0, (32, 18)))
    first = upscaler.stats.stages
    upscaler.step(noise(1, (32, 18)))
    assert {"gather", "network inputs", "network", "finish"} <= first.keys()
    assert all(0.0 < first[name] < seconds for name, seconds in upscaler.stats.stages.items())


@pytest.mark.parametrize("name", ["taa", "taau", "bicubic", "gbuffer-small"])
def test_a_method_without_kernels_around_a_network_is_refused(name: str) -> None:
    with pytest.raises(ArgumentError, match=r"'cpu\+onnx'.*want a classifier"):
        Model.load(name, executor="cpu+onnx")


@pytest.mark.parametrize(
    ("options", "match"),
    [
        ({"precision": "fp16"}, "want a classifier, whose network is in fp32"),
        ({"capture": True}, "capture is True"),
    ],
)
def test_what_it_does_not_have_is_refused(options: dict[str, Any], match: str) -> None:
    with pytest.raises(ArgumentError, match=match):
        Model.load("classifier", executor="cpu+onnx", **options)


def test_a_provider_that_is_not_installed_is_refused() -> None:
    missing = next(name for name, full in NAMES.items() if full not in ort.get_available_providers())
    with pytest.raises(ProviderError, match=missing):
        Model.load("classifier", executor="cpu+onnx", providers=missing)


def test_a_network_with_other_tensors_is_refused(tmp_path: Path) -> None:
    folder = tmp_path / "model"
    shutil.copytree(find_model("classifier"), folder)
    content = (find_model("classifier-small") / "network.onnx").read_bytes()  # 56 blend parameters
    (folder / "network.onnx").write_bytes(content)
    described = json.loads((folder / "model.json").read_text())
    described["files"]["network.onnx"] = sha256(content).hexdigest()
    (folder / "model.json").write_text(json.dumps(described))
    with pytest.raises(ModelError, match=r"blend_parameters.*\(1, 56, "):
        Model.load(folder, executor="cpu+onnx")
