"""Fuzz tests of .safetensors readers: Arm's sequences, training frames, weights."""

import json
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from safetensors.torch import save as save_torch
from torch import zeros

from fuzzing import damaged, dumped, examples, replaced, run_apart
from imported_scene import COUNT, SIZE, arm_tensors, write_safetensors
from supersampler import ArgumentError, ShotError
from supersampler.io.shot import import_arm
from supersampler_model.data.dataset.storage import TrainingFrame, read_training_frame, write_training_frame
from supersampler_model.methods.base import load_trained
from supersampler_model.methods.classifier import Classifier


def training_frame() -> TrainingFrame:
    def of(shape: tuple[int, ...], kind: Any) -> Any:
        return np.ones(shape, kind)

    return TrainingFrame(
        color=of((4, 6, 3), np.float16), depth=of((4, 6), np.float32), motion=of((4, 6, 2), np.float16),
        jitter=(0.1, 0.2), reset=True, exposure=1.0, reference=of((8, 12, 3), np.float16),
        ghost=of((8, 12), np.uint8), alias=of((8, 12), np.uint8),
        gbuffer_display={"normal": of((8, 12, 3), np.float16), "roughness": of((8, 12), np.uint8)},
    )  # fmt: skip


def weights() -> bytes:
    trained = {"method": "classifier", "config": {"a": 1}, "facts": {"steps": 3}}
    return save_torch({"weight": zeros(3, 2)}, {"trained": json.dumps(trained)})


def with_other_header(data: bytes, rng: np.random.Generator) -> bytes:
    """Change one value of the JSON header, and keep its length right, mostly."""
    length = int.from_bytes(data[:8], "little")
    header = dumped(replaced(json.loads(data[8 : 8 + length]), rng))
    claimed = len(header) if rng.random() < 0.9 else int(rng.choice([0, 1, 2**31, 2**62]))
    return claimed.to_bytes(8, "little") + header + data[8 + length :]


def prepare() -> Callable[[int], object]:
    def read_arm(path: Path) -> None:
        for item in import_arm(path):
            assert item.reference is None or item.reference.dtype == np.float32

    with tempfile.TemporaryDirectory() as folder:
        path = write_safetensors(Path(folder) / "a", arm_tensors())
        arm = path.read_bytes()
        write_training_frame(path, training_frame())
        frame = path.read_bytes()
    kinds = [(arm, read_arm), (frame, read_training_frame), (weights(), load_trained)]

    def run(case: int) -> None:
        rng, path = np.random.default_rng(case), Path("case.safetensors")
        data, read = kinds[case % len(kinds)]
        path.unlink(missing_ok=True)  # the last case's may still be mapped
        path.write_bytes(with_other_header(data, rng) if rng.random() < 0.7 else damaged(data, rng))
        read(path)

    return run


def test_no_safetensors_file_harms_its_reader() -> None:
    assert run_apart(prepare, examples(60)) == []


CHANGES: dict[str, tuple[str, Any, str]] = {
    "no frames": ("all", 0, "has 0 frames; want 1 to"),
    "no pixels": ("colour_linear", np.zeros((COUNT, 3, 0, 0), np.float16), "is 0x0"),
    "a plane at 0": ("depth_params", np.zeros((COUNT, 4), np.float32), "want finite numbers other than 0"),
    "a bright exposure": ("exposure", np.full((COUNT, 1), 1e5, np.float32), "want|natural logarithms"),
    "a long exposure": ("exposure", np.zeros((COUNT, 2), np.float32), "want a value for each of 3 frames"),
    "too few cuts": ("camera_cut", np.zeros((1, 1), bool), "want a value for each of 3 frames"),
    "truth without sides": ("ground_truth_linear", np.zeros((COUNT, 3), np.float32), r"want \(3, 3, H, W\)"),
    "whole numbers": ("depth", np.zeros((COUNT, 1, *SIZE[::-1]), np.int32), "want floating point"),
    "no rate": ("EmulatedFramerate", np.zeros((0,), np.int32), "is not a number > 0"),
}


@pytest.mark.parametrize("case", CHANGES)
def test_an_invalid_sequence_is_a_shot_error(tmp_path: Path, case: str) -> None:
    name, value, message = CHANGES[case]
    tensors = arm_tensors()
    if name == "all":
        tensors = {name: tensor[:0] for name, tensor in tensors.items()}
    elif name == "colour_linear":
        for other in ("colour_linear", "motion_lr", "depth"):
            tensors[other] = tensors[other][..., :0, :0]
    else:
        tensors[name] = value
    with pytest.raises(ShotError, match=message):
        import_arm(write_safetensors(tmp_path / "a.safetensors", tensors))


def test_tensors_that_share_bytes_are_refused(tmp_path: Path) -> None:
    entries = {
        name: {"dtype": "U8", "shape": [8], "data_offsets": [at, at + 8]} for name, at in (("a", 0), ("b", 7))
    }
    header = json.dumps(entries).encode()
    (tmp_path / "a.safetensors").write_bytes(len(header).to_bytes(8, "little") + header + bytes(15))
    with pytest.raises(ShotError, match="'a' and 'b' overlap"):
        import_arm(tmp_path / "a.safetensors")


NETWORK = {"network": {"levels": [32768] * 4}}
WEIGHTS: dict[str, tuple[str, str]] = {
    "nested": ("[" * 100_000, "maximum recursion depth"),
    "no facts": ('{"method": "classifier", "config": {}, "facts": 5}', "facts is 5"),
    "wide": (json.dumps({"method": "classifier", "config": NETWORK, "facts": {}}), "want at most 1024"),
    "no levels": (
        json.dumps({"method": "classifier", "config": {"network": {"levels": []}}, "facts": {}}),
        "zip",
    ),
}


@pytest.mark.parametrize("case", WEIGHTS)
def test_invalid_weights_are_an_argument_error(tmp_path: Path, case: str) -> None:
    text, message = WEIGHTS[case]
    (tmp_path / "w.safetensors").write_bytes(save_torch({"weight": zeros(3, 2)}, {"trained": text}))
    with pytest.raises(ArgumentError, match=message):
        Classifier.of(load_trained(tmp_path / "w.safetensors"))


@pytest.mark.parametrize(
    "shape",
    [
        "[0, 1e30]",
        f"[0, {10**30}]",
        "[-2, -3]",
        "[[0]]",
        "0",
        "[2.0, 3]",
        "[" * 100_000,
        f"[{'9,' * 10**6}9]",
    ],
)
def test_an_invalid_shape_is_a_shot_error(tmp_path: Path, shape: str) -> None:
    size = 0 if shape.startswith("[0,") else 24
    entry = f'{{"dtype": "F32", "shape": {shape}, "data_offsets": [0, {size}]}}'
    header = f'{{"colour_linear": {entry}}}'.encode()
    (tmp_path / "a.safetensors").write_bytes(len(header).to_bytes(8, "little") + header + bytes(24))
    with pytest.raises(ShotError, match="has a header or tensor that cannot be read"):
        import_arm(tmp_path / "a.safetensors")
