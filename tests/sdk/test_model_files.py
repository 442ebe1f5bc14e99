"""Tests of reading model folders: each wrong field or file is refused by name."""

import hashlib
import io
import json
import os
import shutil
import signal
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper

from noise import noise
from supersampler import Model, ModelError, ShotError, Upscaler
from supersampler.backends.onnx.graph_file import refusal_of
from supersampler.backends.onnx.runtime import CPU, ort
from supersampler.extrapolation import Extrapolator
from supersampler.io.json_files import read_json
from supersampler.io.shot import Shot, shot
from supersampler.methods import model_file
from supersampler.methods.classifier.network_file import INPUT_PLANES, read_network
from supersampler.methods.classifier.spec import Variant
from supersampler.methods.model_file import MAX_DESCRIPTION, find_model, read_model_info

SHIPPED = find_model("taa").parent


def copied(method: str, folder: Path) -> Path:
    """Copy a shipped model into a folder."""
    return Path(shutil.copytree(find_model(method), folder / "model"))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    return copied("taau", tmp_path)


def change(folder: Path, **members: Any) -> None:
    path = folder / "model.json"
    path.write_text(json.dumps({**json.loads(path.read_text()), **members}))


def replace_file(folder: Path, name: str, content: bytes) -> None:
    (folder / name).write_bytes(content)
    files = json.loads((folder / "model.json").read_text())["files"]
    change(folder, files={**files, name: hashlib.sha256(content).hexdigest()})


TENSOR = {"name": "color", "type": "float32", "shape": [1, 3, "render_height", "render_width"]}
DISPLAY = "display_height", "display_width"
HISTORY = {**TENSOR, "name": "history.color", "output": "next.color", "shape": [1, 3, *DISPLAY]}
OK = "0" * 64


@pytest.mark.parametrize(
    ("members", "match"),
    [
        ({"ratios": []}, r"array` of length 2 - at `\$\.ratios`, is \[\]"),
        ({"ratios": [2, 1]}, "ratios"),
        ({"ratios": [1, 5]}, r"ratios: \(1\.0, 5\.0\); want within \(1\.0, 4\.0\), the range of 'taau'"),
        ({"ratios": [1, True]}, r"Expected `float`, got `bool` - at `\$\.ratios\[1\]`, is True"),
        ({"ratios": [1, 10**400]}, r"out of range - at `\$\.ratios\[1\]`"),
        ({"ratios": "1,2"}, r"Expected `array`, got `str` - at `\$\.ratios`, is '1,2'"),
        ({"method": 3}, r"at `\$\.method`, is 3"),
        ({"source": "\ud800"}, "is not JSON"),
        ({"inputs": 7}, r"at `\$\.inputs`, is 7"),
        ({"inputs": [7]}, r"Expected `object`, got `int` - at `\$\.inputs\[0\]`, is 7"),
        ({"inputs": [{}]}, r"missing required field `name` - at `\$\.inputs\[0\]`"),
        ({"inputs": [TENSOR] * 101}, "length <= 100"),
        ({"inputs": [TENSOR, TENSOR]}, "'color' twice"),
        ({"inputs": [{**TENSOR, "name": "__class__"}]}, "any of color, depth"),
        ({"inputs": [{**TENSOR, "shape": [1, 4, "render_height", "render_width"]}]}, "input 'color'"),
        ({"inputs": [{**TENSOR, "shape": [2**40]}]}, r"inputs\[0\]\.shape\[0\]"),
        ({"inputs": [{**TENSOR, "type": "object"}]}, r"at `\$\.inputs\[0\]\.type`, is 'object'"),
        ({"inputs": []}, "without 'color'"),
        ({"history": [{**HISTORY, "shape": [1, 3, "anything", 1]}]}, "history 'history.color'"),
        ({"history": [{**HISTORY, "shape": [1, 1024, 1024, 1]}]}, "product is at most 1024"),
        ({"history": [{**HISTORY, "output": "image"}]}, "'image' twice"),
        ({"image": TENSOR | {"shape": [1, 4, *DISPLAY]}}, "image"),
        ({"aux_outputs": [TENSOR | {"name": "weight", "shape": [1, 2, *DISPLAY]}]}, "weight"),
        ({"aux_outputs": [TENSOR | {"name": "x"}]}, "aux_outputs 'x'"),
        ({"aux_outputs": [], "maps": {}}, "aux_outputs: none; want 'converged' too"),
        ({"maps": {"weight": {"output": "weight", "first": 0, "channels": 2}}}, "map 'weight'"),
        ({"maps": {"weight": {"output": "weight", "first": -1, "channels": 1}}}, "Expected `int` >= 0"),
        ({"maps": {"image": {"output": "weight", "first": 0, "channels": 1}}}, "map 'image'"),
        ({"files": []}, r"at `\$\.files`, is \[\]"),
        ({"files": {"step.onnx": "x"}}, "Expected `str` matching regex"),
        ({"files": {"../step.onnx": OK}}, r"files has '\.\./step\.onnx'; want plain names"),
        ({"files": {"/etc/passwd": OK}}, "plain names"),
        ({"files": {"a\\b": OK}}, "plain names"),
        ({"files": {"extrapolated/step.onnx": OK}}, "plain names"),
        ({"files": {"..": OK}}, "plain names"),
        ({"files": {"\0": OK}}, "plain names"),
        ({"only_extrapolated": 1}, r"at `\$\.only_extrapolated`, is 1"),
        ({"network": {"multiply_adds": -1}}, r"at `\$\.network\.multiply_adds`, is -1"),
        ({"attributions": "x"}, "attributions"),
        ({"versions": {"torch": 2}}, "versions"),
        ({"config": 1}, r"at `\$\.config`, is 1"),
        ({"contract": True}, r"at `\$\.contract`, is True"),
        ({"contract": 99}, "contract is 99; this runtime drives 4"),
    ],
)
def test_a_wrong_field_of_model_json_is_named(members: dict[str, Any], match: str, folder: Path) -> None:
    change(folder, **members)
    with pytest.raises(ModelError, match=rf"model\.json: .*{match}"):
        read_model_info(folder)


@pytest.mark.parametrize(
    ("content", "match"),
    [
        (b"[" * 100_000, "is not"),
        (b"[]", "Expected `object`, got `array`"),
        (b"\xff", "is not JSON"),
        (b'{"contract": NaN}', "is not JSON"),
        (b'{"contract": 1e999}', "out of range"),
        (b"9" * 5000, "out of range"),
        (b" " * (MAX_DESCRIPTION + 1), "larger than"),
        (b"", "is not JSON"),
    ],
)
def test_an_invalid_model_json_is_refused(content: bytes, match: str, folder: Path) -> None:
    (folder / "model.json").write_bytes(content)
    with pytest.raises(ModelError, match=match):
        read_model_info(folder)


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="no named pipes here")
def test_a_pipe_or_device_is_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "model.json")
    with pytest.raises(ShotError, match="is not a regular file"):
        read_json(tmp_path / "model.json", 10)


def test_a_link_out_of_the_folder_and_a_missing_or_changed_file_are_refused(
    folder: Path, tmp_path: Path
) -> None:
    content = (folder / "step.onnx").read_bytes()
    shutil.move(folder / "step.onnx", tmp_path / "step.onnx")
    with pytest.raises(ModelError, match=r"step\.onnx is missing"):
        read_model_info(folder)
    (folder / "step.onnx").symlink_to(tmp_path / "step.onnx")
    with pytest.raises(ModelError, match="a link out of the folder"):
        read_model_info(folder)
    (folder / "step.onnx").unlink()
    (folder / "step.onnx").write_bytes(content[:-1])
    with pytest.raises(ModelError, match="sha256"):
        Model.load(folder)
    (folder / "model.json").unlink()
    with pytest.raises(ModelError, match="neither one of"):
        Model.load(folder)


def test_a_folder_of_extrapolated_frames_with_another_history_is_refused(tmp_path: Path) -> None:
    folder = copied("extrapolate", tmp_path)
    inner = json.loads((folder / "extrapolated" / "model.json").read_text())
    inner["history"][0]["shape"] = [1, 4, *DISPLAY]
    content = json.dumps(inner).encode()
    (folder / "extrapolated" / "model.json").write_bytes(content)
    files = json.loads((folder / "model.json").read_text())["files"]
    change(folder, files={**files, "extrapolated/model.json": hashlib.sha256(content).hexdigest()})
    with pytest.raises(ModelError, match="only_extrapolated"):
        read_model_info(folder)


# --- constants of kernels ---


@pytest.mark.parametrize(
    ("method", "constants", "match"),
    [
        ("taau", {"sample_sigma": 0}, r"config\.sample_sigma is 0; want a number from 0\.001 to 1000"),
        ("taau", {"samples": "many"}, "config.samples"),
        ("taau", {"settled": None}, r"config\.settled is None; .* Export the model .*executor='onnx'"),
        ("taau", {"frame_sigma": 0.3}, r"config\.frame_sigma is 0\.3; want none, as in this version"),
        ("taa", {"alpha": 1e30}, "config.alpha"),
        ("classifier-small", {"rectified": -5}, "config.rectified is -5; want true or false"),
        ("classifier-small", {"network": None}, "config.network.levels is None"),
        ("classifier-small", {"network": {"levels": [16, 32, 64, 1 << 40]}}, "config.network.levels"),
        ("classifier-small", {"network": {"levels": [16, 32, 64, 128], "decoder": 64}}, "network.decoder"),
    ],
)
def test_unusable_constants_of_kernels_are_refused(
    method: str, constants: dict[str, Any], match: str, tmp_path: Path
) -> None:
    folder = copied(method, tmp_path)
    config = json.loads((folder / "model.json").read_text())["config"]
    change(folder, config={**config, **constants})
    with pytest.raises(ModelError, match=match):
        Model.load(folder)


@pytest.mark.parametrize("strides", [[-5], [1, 1 << 40], "1359", [1.5], [1] * 8])
def test_unsupported_rings_run_in_onnx_runtime(strides: object, tmp_path: Path) -> None:
    folder = copied("guided-warp", tmp_path)
    config = json.loads((folder / "model.json").read_text())["config"]
    change(folder, config={**config, "strides": strides})
    assert Extrapolator(folder, [CPU], 1).executor == "onnx"


def test_a_graph_of_another_method_is_refused(folder: Path) -> None:
    change(folder, method="taa")
    with pytest.raises(ModelError, match=r"step\.onnx: is a graph of 'taau'; model\.json says 'taa'"):
        Model.load(folder)


def test_kernels_leave_an_unknown_history_to_the_graph(folder: Path) -> None:
    history = json.loads((folder / "model.json").read_text())["history"]
    history[1]["shape"][1] = 7
    change(folder, history=history)
    with pytest.raises(ModelError, match=r"input 'history\.samples' is .*; model\.json says \(1, 7, "):
        Model.load(folder)


# --- network.npz ---


@pytest.fixture
def learned(tmp_path: Path) -> Path:
    return copied("classifier-small", tmp_path)


@pytest.mark.parametrize(
    ("changes", "match"),
    [
        ({"decoder.weights": np.zeros((1, 1, 32, 4), np.int8)}, r"'decoder\.weights' \(1, 1, 32, 4\) int8;"),
        ({"decoder.weights": np.zeros((1, 8, 32, 4), np.uint8)}, "decoder.weights"),
        ({"hidden.scale": np.zeros(31, np.float32)}, "hidden.scale"),
        ({"hidden.scale": np.full(32, np.nan, np.float32)}, "'hidden.scale' from nan"),
        ({"logits.first": np.array([60])}, "logits.first"),
        ({"blend.bias": None}, "without 'blend.bias'"),
        ({"more": np.zeros(1)}, "with 'more'"),
        ({"0.first.weights": np.array([None])}, "network.npz"),
        ({"0.first.bias": np.zeros(1 << 20, np.float32)}, "bytes"),
    ],
)
def test_an_array_of_another_layout_is_named(changes: dict[str, Any], match: str, learned: Path) -> None:
    with np.load(learned / "network.npz") as file:
        arrays = {**dict(file), **changes}
    stream = io.BytesIO()
    np.savez(stream, **{name: array for name, array in arrays.items() if array is not None})
    replace_file(learned, "network.npz", stream.getvalue())
    with pytest.raises(ModelError, match=match):
        Model.load(learned)


def test_kernels_read_no_weights_beyond_a_narrow_decoder_s() -> None:
    """They read 8 words of its features; `classifier-small` has 4."""
    info = read_model_info(find_model("classifier-small"))
    assert info.config["network"]["decoder"] == 16
    weights = read_network(info, Variant.of(info.config).outputs)["hidden.weights"]
    assert weights.shape == (1, INPUT_PLANES + 8, 32, 4)
    assert not weights[:, INPUT_PLANES + 4 :].any()


def test_claimed_sizes_allocate_no_memory(learned: Path) -> None:
    """A bomb of zeros, and a header of an array that is not there."""
    claims = np.lib.format.magic(1, 0) + (118).to_bytes(2, "little")
    claims += b"{'descr': '|i1', 'fortran_order': False, 'shape': (1099511627776,), }".ljust(117) + b"\n"
    bomb = b"\0" * (64 << 20), r"'0\.first\.weights' of 67108864 bytes"
    header = claims, "ValueError: cannot reshape"
    for name, (content, match) in (("0.first.weights", bomb), ("decoder.weights", header)):
        stream = io.BytesIO()
        with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED) as file:
            file.writestr(f"{name}.npy", content)
        replace_file(learned, "network.npz", stream.getvalue())
        with pytest.raises(ModelError, match=match):
            Model.load(learned)


# --- graphs ---


def model_of(*nodes: onnx.NodeProto, tensors: list[onnx.TensorProto] | None = None) -> onnx.ModelProto:
    color = helper.make_tensor_value_info("color", TensorProto.FLOAT, [1, 3, "h", "w"])
    image = helper.make_tensor_value_info("image", TensorProto.FLOAT, [1, 3, "H", "W"])
    graph = helper.make_graph(list(nodes), "g", [color], [image], tensors or [])
    return helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=8)


def refused(model: onnx.ModelProto) -> str | None:
    return refusal_of(model.SerializeToString())


IDENTITY = helper.make_node("Identity", ["color"], ["image"])


def external() -> onnx.TensorProto:
    tensor = helper.make_tensor("t", TensorProto.FLOAT, [1], [1.0])
    tensor.ClearField("float_data")
    tensor.data_location = TensorProto.EXTERNAL
    tensor.external_data.add(key="location", value="/etc/passwd")
    return tensor


def in_subgraph(node: onnx.NodeProto, depth: int) -> onnx.NodeProto:
    for _ in range(depth):
        node = helper.make_node("If", ["c"], ["image"], then_branch=helper.make_graph([node], "b", [], []))
    return node


@pytest.mark.parametrize("name", sorted(path.parent.name for path in SHIPPED.glob("*/model.json")))
def test_graphs_that_ship_are_plain(name: str) -> None:
    graphs = list(find_model(name).rglob("*.onnx"))
    assert graphs
    assert [refusal_of(path.read_bytes()) for path in graphs] == [None] * len(graphs)


def test_attributions_of_weights_that_ship_are_in_the_notice() -> None:
    notice = " ".join((Path(__file__).parents[2] / "NOTICE").read_text("utf-8").split())
    described = [json.loads(path.read_bytes()) for path in SHIPPED.glob("*/model.json")]
    texts = {text for content in described for text in content["attributions"]}
    assert len(texts) > 5
    assert {text for text in texts if text not in notice} == set()


def test_data_in_other_files_is_found_wherever_it_is() -> None:
    constant = helper.make_node("Constant", [], ["k"], value=external())
    text = "data in other files"
    assert text in str(refused(model_of(IDENTITY, tensors=[external()])))
    assert text in str(refused(model_of(constant)))
    assert text in str(refused(model_of(in_subgraph(constant, 3))))
    model = model_of(IDENTITY)
    sparse = model.graph.sparse_initializer.add()
    sparse.values.CopyFrom(external())
    assert text in str(refused(model))
    plain = helper.make_tensor("t", TensorProto.FLOAT, [1], [1.0])
    plain.data_location = TensorProto.DEFAULT
    assert refused(model_of(IDENTITY, tensors=[plain])) is None


def test_operators_that_are_not_onnx_s_are_found_wherever_they_are() -> None:
    custom = helper.make_node("Gelu", ["color"], ["image"], domain="com.microsoft")
    assert "'com.microsoft'" in str(refused(model_of(custom)))
    assert "'com.microsoft'" in str(refused(model_of(in_subgraph(custom, 2))))
    model = model_of(IDENTITY)
    model.opset_import.add(domain="evil", version=1)
    assert "'evil'" in str(refused(model))
    model = model_of(IDENTITY)
    model.functions.append(helper.make_function("", "F", ["color"], ["image"], [custom], []))
    assert "'com.microsoft'" in str(refused(model))
    assert refused(model_of(helper.make_node("Identity", ["color"], ["image"], domain="ai.onnx"))) is None


def test_other_files_damage_and_depth_are_refused() -> None:
    model = model_of(IDENTITY)
    model.training_info.add()
    assert "training information" in str(refused(model))
    assert "deep" in str(refused(model_of(in_subgraph(IDENTITY, 33))))
    assert refused(model_of(in_subgraph(IDENTITY, 30))) is None
    content = model_of(IDENTITY).SerializeToString()
    for size in range(1, len(content)):
        assert refusal_of(content[:size]) is None or "damaged" in str(refusal_of(content[:size])) or size < 8
    beyond = b"\x3a\x02\x0a\x04" + content  # a graph of two bytes, with a node of four
    assert refusal_of(beyond) == "is damaged: a field ends beyond its message"
    assert refusal_of(b"") == "holds no graph"
    assert "damaged" in str(refusal_of(b"\xff" * 20))
    assert "own format" in str(refusal_of(b"\x08\0\0\0ORTM" + content))


def test_a_foreign_graph_is_checked_before_onnx_runtime_loads_it(folder: Path) -> None:
    replace_file(folder, "step.onnx", model_of(IDENTITY, tensors=[external()]).SerializeToString())
    with pytest.raises(ModelError, match=r"step\.onnx: has data in other files"):
        Model.load(folder, executor="onnx")
    replace_file(folder, "step.onnx", model_of(IDENTITY).SerializeToString())
    with pytest.raises(ModelError, match=r"inputs are color; model\.json says adds_samples, color, depth"):
        Model.load(folder, executor="onnx")


def test_a_graph_that_fails_while_running_raises_a_typed_error_and_changes_nothing(tmp_path: Path) -> None:
    folder = copied("bilinear", tmp_path)
    model = model_of(IDENTITY)  # of the frame's size, not the display's
    for name, kind, shape in (
        ("jitter", "FLOAT", [1, 2]),
        ("pre_exposure", "FLOAT", [1]),
        ("display_size", "INT64", [2]),
    ):
        model.graph.input.append(helper.make_tensor_value_info(name, TensorProto.DataType.Value(kind), shape))
    replace_file(folder, "step.onnx", model.SerializeToString())
    upscaler = Upscaler(folder, scale=2.0, executor="onnx")
    with pytest.raises(ModelError, match=r"step\.onnx: ONNX Runtime cannot run it: "):
        upscaler.step(noise(0))
    assert upscaler.save_state().history is None


class TooLateError(Exception):
    """Raised by the program's signal handler."""


@pytest.mark.skipif(not hasattr(signal, "SIGUSR1"), reason="this system has few signals")
@pytest.mark.parametrize("name", ["get_outputs", "run_with_iobinding"])
def test_an_error_of_a_signal_handler_is_no_error_of_the_graph(
    name: str, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def late(*_: object) -> None:
        raise TooLateError

    upscaler = Upscaler(folder, scale=2.0, executor="onnx", validate="off")
    calls: dict[str, Callable[[], object]] = {
        "get_outputs": lambda: Model.load(folder, executor="onnx"),
        "run_with_iobinding": lambda: upscaler.step(noise(0)),
    }
    before = signal.signal(signal.SIGUSR1, late)
    try:
        with monkeypatch.context() as patch:
            patch.setattr(ort.InferenceSession, name, lambda *_: signal.raise_signal(signal.SIGUSR1))
            with pytest.raises(TooLateError):
                calls[name]()
    finally:
        signal.signal(signal.SIGUSR1, before)
    calls[name]()


def test_an_app_without_data_files_says_how_to_build_it(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(model_file, "_shipped", lambda: tmp_path / "app" / "models")
    monkeypatch.setattr(shot, "SHIPPED", tmp_path / "app" / "shots")
    for name in ("classifier", "taau"):
        with pytest.raises(ModelError, match=r"data files are missing: .*models has no .* --collect-all sup"):
            Upscaler(name, scale=2.0)
    with pytest.raises(ShotError, match=r"plaza: .*data files, .*shots, are missing\. .* --collect-all su"):
        Shot.open("plaza")
    assert find_model(folder) == folder  # own models are found
