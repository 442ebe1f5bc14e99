"""Fuzz tests of model folders: damaged ones load and step, or are refused with an error of the package.

Damaged graphs reach ONNX Runtime only where the package's own reader accepts them. How ONNX Runtime handles
them is not tested here.
"""

import hashlib
import json
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from fuzzing import damaged, dumped, examples, hostile_array, replaced, run_apart
from noise import noise
from supersampler import Model, Upscaler
from supersampler.backends.onnx.graph_file import refusal_of
from supersampler.backends.onnx.runtime import CPU
from supersampler.extrapolation import Extrapolator
from supersampler.methods.model_file import find_model, read_model_info


def folder_of(method: str, path: Path) -> Path:
    shutil.copytree(find_model(method), path)
    return path


def described(folder: Path) -> dict[str, Any]:
    return dict(json.loads((folder / "model.json").read_text()))


def describe(folder: Path, description: Any) -> None:
    (folder / "model.json").write_bytes(dumped(description))


def replace_file(folder: Path, name: str, content: bytes) -> None:
    """With the hash that belongs to it."""
    (folder / name).write_bytes(content)
    description = described(folder)
    description["files"][name] = hashlib.sha256(content).hexdigest()
    describe(folder, description)


def step(model: Model) -> None:
    ratio = 2.0 if model.info.ratios[1] >= 2.0 >= model.info.ratios[0] else model.info.ratios[0]
    upscaler = Upscaler(model, scale=ratio, validate="off")
    for seed in range(2):
        image = upscaler.step(noise(seed))
    assert np.isfinite(image).all()


def prepare_descriptions() -> Callable[[int], object]:
    folders = {
        method: folder_of(method, Path(method)) for method in ("taau", "classifier-small", "guided-warp")
    }
    texts = {method: described(folder) for method, folder in folders.items()}
    texts["classifier-small"]["parity"] = {}  # not read by a session
    for method in folders:
        load(method, folders)

    def run(case: int) -> None:
        rng, method = np.random.default_rng(case), list(folders)[case % len(folders)]
        folder, description = folders[method], texts[method]
        for _ in range(int(rng.integers(1, 3))):
            description = replaced(description, rng)
        describe(folder, description)
        if rng.random() < 0.1:
            (folder / "model.json").write_bytes(damaged((folder / "model.json").read_bytes(), rng))
        load(method, folders)

    return run


def load(method: str, folders: dict[str, Path]) -> None:
    if method == "guided-warp":
        Extrapolator(folders[method], [CPU], 1)
    else:
        step(Model.load(folders[method], threads=1))


def prepare_networks() -> Callable[[int], object]:
    folder = folder_of("classifier-small", Path("classifier-small"))
    network = (folder / "network.npz").read_bytes()
    arrays = dict(np.load(folder / "network.npz"))
    step(Model.load(folder, threads=1, executor="cpu"))  # its kernels are compiled

    def run(case: int) -> None:
        rng = np.random.default_rng(case)
        if case % 2:
            replace_file(folder, "network.npz", damaged(network, rng))
        else:
            name = str(rng.choice(list(arrays)))
            np.savez(folder / "made.npz", **{**arrays, name: hostile_array(arrays[name], rng)})
            replace_file(folder, "network.npz", (folder / "made.npz").read_bytes())
        step(Model.load(folder, threads=1, executor="cpu"))

    return run


def prepare_graphs() -> Callable[[int], object]:
    folder = folder_of("bilinear", Path("bilinear"))
    graphs = [(find_model(method) / "step.onnx").read_bytes() for method in ("bilinear", "taa")]

    def run(case: int) -> None:
        rng = np.random.default_rng(case)
        content = damaged(graphs[case % 2], rng)
        refused = refusal_of(content) is not None
        replace_file(folder, "step.onnx", content)
        read_model_info(folder)
        Model.load(folder, threads=1, executor="onnx")
        assert not refused

    return run


def test_no_model_json_harms_its_reader() -> None:
    findings = run_apart(prepare_descriptions, examples(60), seconds=60.0)  # kernels of variants are compiled
    assert findings == []


def test_no_network_file_harms_its_reader() -> None:
    assert run_apart(prepare_networks, examples(30)) == []


def test_no_graph_file_harms_its_reader() -> None:
    assert run_apart(prepare_graphs, examples(60)) == []
