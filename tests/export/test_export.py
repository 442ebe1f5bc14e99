"""Exported folders and graphs, and parts of the exporter that need no tracing."""

import io
import json
import os
from dataclasses import asdict
from functools import cache
from pathlib import Path
from typing import Any, Literal

import numpy as np
import onnx
import onnxruntime as ort
import pytest
import torch
from onnx import helper
from torch import Tensor

from gbuffer_method import Demodulated, exported
from supersampler import Frame, StepResult, SupersamplerError, Upscaler
from supersampler.methods.model_file import CONTRACT, find_model, read_model_info
from supersampler.methods.model_info import EXTRAPOLATED
from supersampler.methods.registry import methods
from supersampler_export import folder as folder_module
from supersampler_export.folder import describe, model_card, multiply_adds_of, write_model_folder
from supersampler_export.graph import ExportError, check_portable, export_graph
from supersampler_export.parity import TOLERANCE, check_subgraph, compare, sizes_of, tolerance_of_half
from supersampler_export.quantize import cpu_network
from supersampler_model import ops
from supersampler_model.methods import load_method
from supersampler_model.methods.base import Trained, save_trained
from supersampler_model.methods.classifier_paper import PaperClassifier
from supersampler_model.methods.spatial import Bilinear
from upscale_runs import run

SHIPPED = [name for name, spec in methods().items() if spec.ships]
LEARNED = [name for name in SHIPPED if methods()[name].task]


@pytest.fixture(autouse=True)
def _shipped_aovs_graph(monkeypatch: pytest.MonkeyPatch) -> None:
    """It is the same in all folders, and test_export_traced traces it."""
    monkeypatch.setattr(folder_module, "aovs_graph", (find_model("bilinear") / "aovs.onnx").read_bytes)


@cache
def _bilinear_graph() -> bytes:
    return bytes(export_graph(Bilinear()).SerializeToString())


@pytest.fixture
def bilinear_traced_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Folders of `Bilinear` take the graph of one trace."""
    monkeypatch.setattr(folder_module, "export_graph", lambda _: onnx.load_from_string(_bilinear_graph()))


@pytest.mark.parametrize("name", SHIPPED)
def test_the_shipped_folder_is_up_to_date(name: str) -> None:
    folder, method = find_model(name), load_method(name)
    inner = method.on_extrapolated()
    described = {folder: method} | ({} if inner is None else {folder / EXTRAPOLATED: inner})
    for place, one in described.items():
        written = (place / "model.json").read_text()
        measured = {key: json.loads(written)[key] for key in ("versions", "files", "parity")}
        made = json.dumps(describe(one) | measured, indent=1) + "\n"
        assert made == written, f"run: supersampler export {name} -o {folder}"


@pytest.mark.parametrize("name", SHIPPED)
def test_the_shipped_card_is_up_to_date(name: str) -> None:
    folder = find_model(name)
    shipped, graph = json.loads((folder / "model.json").read_text()), onnx.load(folder / "step.onnx")
    fresh = set(model_card(shipped, graph).splitlines())
    assert fresh <= set((folder / "MODEL_CARD.md").read_text(encoding="utf-8").splitlines())


# `make traces` also takes the larger one, which the same code quantizes.
@pytest.mark.long  # quantizes a network
@pytest.mark.parametrize(
    "name", ["classifier-small", "classifier"][: 1 + ("SUPERSAMPLER_TRACES" in os.environ)]
)
def test_the_int8_network_is_up_to_date(name: str) -> None:
    made = cpu_network(load_method(name))
    assert made is not None
    fresh, shipped = np.load(io.BytesIO(made)), np.load(find_model(name) / "network.npz")
    assert fresh.files == shipped.files
    for array in fresh.files:
        np.testing.assert_array_equal(fresh[array], shipped[array])


@pytest.mark.long  # every method at every size
@pytest.mark.parametrize(
    ("name", "precision"),
    [
        *((name, "fp32") for name in SHIPPED),
        *(pytest.param(name, "fp16", marks=pytest.mark.long) for name in LEARNED),  # seconds each
    ],
)
def test_the_shipped_graph_computes_what_torch_computes_at_sizes_not_traced(
    name: str, precision: Literal["fp32", "fp16"]
) -> None:
    path, method = read_model_info(find_model(name)).steps[precision], load_method(name)
    check_portable(onnx.load(path))
    session = ort.InferenceSession(path, providers=["CPUExecutionProvider"])
    tolerance = TOLERANCE if precision == "fp32" else tolerance_of_half(method)
    for render, display in sizes_of(method)[2:7:2]:
        assert compare(method, session, render, display).difference <= tolerance


@pytest.mark.parametrize("name", SHIPPED)
def test_the_description_names_every_tensor_of_the_graph(name: str) -> None:
    info = read_model_info(find_model(name))
    model = onnx.load(info.steps["fp32"])
    metadata = {entry.key: entry.value for entry in model.metadata_props}
    assert metadata == {"supersampler.contract": str(CONTRACT), "supersampler.method": name}
    outputs = [tensor.name for tensor in info.graph_outputs]
    assert [value.name for value in model.graph.output] == outputs
    assert {where.output for where in info.maps.values()} <= set(outputs)
    for value, tensor in zip(model.graph.input, info.graph_inputs, strict=True):
        assert value.name == tensor.name
        dims = [dim.dim_param or dim.dim_value for dim in value.type.tensor_type.shape.dim]
        assert tuple(dims) == tensor.shape
        assert helper.tensor_dtype_to_np_dtype(value.type.tensor_type.elem_type) == np.dtype(tensor.type)


@pytest.mark.parametrize("name", LEARNED)
def test_the_shipped_network_is_the_learned_part_of_the_method_with_its_multiply_adds(name: str) -> None:
    learned = load_method(name).subgraph()
    assert learned is not None
    path = find_model(name) / "network.onnx"
    check_portable(onnx.load(path))
    check_subgraph(learned, path.read_bytes())
    assert read_model_info(find_model(name)).multiply_adds == multiply_adds_of(learned)


@pytest.mark.skipif("SUPERSAMPLER_TRACES" not in os.environ, reason="minutes: `make traces` runs it")
def test_a_learned_method_is_exported_from_its_weights(tmp_path: Path) -> None:
    torch.manual_seed(1)
    name, method = PaperClassifier.name, PaperClassifier()
    for parameter in method.parameters():
        torch.nn.init.normal_(parameter, std=0.3)
    facts: dict[str, Any] = {"steps": 7, "data": "0" * 64, "assets": ["a.glb"], "commit": "abc"}
    facts |= {"validation": {"psnr": 30.0}, "mean_of": 3}
    weights = tmp_path / "weights.safetensors"
    save_trained(weights, Trained(name, asdict(method.config), facts, method.state_dict()))
    arguments = ["export", name, "--weights", str(weights), "-o", str(tmp_path / "model")]
    assert run(*arguments).exit_code == 0
    card = (tmp_path / "model" / "MODEL_CARD.md").read_text()
    assert "the mean of 3 runs, the last of 7 updates" in card
    assert "a.glb" in card
    upscaler = Upscaler(tmp_path / "model", display_size=(41, 27), validate="off")
    random = np.random.default_rng(0)
    for _ in range(3):
        frame = Frame(
            color=random.random((14, 21, 3), np.float32), depth=random.random((14, 21), np.float32),
            motion=random.normal(size=(14, 21, 2)).astype(np.float32), jitter=(0.1, -0.2),
        )  # fmt: skip
        result = upscaler.step(frame, outputs=("class_map", "weight", "count"))
        assert isinstance(result, StepResult)
        assert np.isfinite(result.image).all()
        assert (result.image >= 0.0).all()
        assert result.class_map is not None
        np.testing.assert_allclose(result.class_map[..., :3].sum(axis=-1), 1.0, atol=1e-3)


@pytest.mark.parametrize(
    ("name", "options", "want"),
    [
        ("classifier-paper", [], "a file, as none ship"),
        ("taau", ["--weights", "weights.safetensors"], "none, as nothing in it is learned"),
        ("all", ["--weights", "weights.safetensors"], "none with `all`"),
    ],
)
def test_weights_go_with_a_method_that_is_learned(
    name: str, options: list[str], want: str, tmp_path: Path
) -> None:
    result = run("export", name, *options, "-o", tmp_path)
    assert result.exit_code == 2
    assert f"want {want}" in result.stderr


class Wider(Bilinear):
    """Computes another image in torch than the graph of `Bilinear`."""

    @staticmethod
    def kernel(distance: Tensor) -> Tensor:
        return (1.01 - distance.abs()).clamp(min=0.0)


@pytest.mark.long  # traces a graph
@pytest.mark.usefixtures("bilinear_traced_once")
def test_a_graph_with_another_image_is_not_written(tmp_path: Path) -> None:
    with pytest.raises(ExportError, match=r"bilinear at \(26, 18\) -> .* is off by .*; want 1e-04"):
        write_model_folder(Wider(), tmp_path / "model")
    assert not (tmp_path / "model").exists()


@pytest.mark.parametrize("name", ["step.onnx", "MODEL_CARD.md", "model.json"])
def test_foreign_files_are_kept_and_those_of_an_earlier_export_replaced(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    described = json.dumps({"contract": 1, "files": {"step.onnx": ""}}).encode()
    made = {"step.onnx": b"graph", "MODEL_CARD.md": b"card", "model.json": described}
    monkeypatch.setattr(folder_module, "_folder_files", lambda *_: made)
    (tmp_path / name).write_text('{"mine": 1}')
    with pytest.raises(SupersamplerError, match=rf"{name}: already exists, and is not listed by a model"):
        write_model_folder(Bilinear(), tmp_path)
    assert [(path.name, path.read_text()) for path in tmp_path.iterdir()] == [(name, '{"mine": 1}')]
    (tmp_path / name).unlink()
    earlier = {"contract": 1, "files": {"step.onnx": "", "network.onnx": ""}}
    mine = {"network.npz": b"not listed"}
    for file, content in {**made, **mine, "network.onnx": b"of another method"}.items():
        (tmp_path / file).write_bytes(content)
    (tmp_path / "model.json").write_text(json.dumps(earlier))
    for _ in range(2):
        write_model_folder(Bilinear(), tmp_path)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == made | mine


def test_a_folder_that_cannot_be_written_is_refused_before_the_trace(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    for options in ([], ["--target", "wgsl"]):
        result = run("export", "taau", "-o", tmp_path / "file", *options)
        assert "file is not a folder. Choose another name." in result.stderr


def test_an_inner_folder_is_listed_by_its_description_only(monkeypatch: pytest.MonkeyPatch) -> None:
    """It lists the files beside it by itself."""
    graph = onnx.load(find_model("bilinear") / "step.onnx")
    monkeypatch.setattr(folder_module, "export_graph", lambda _: graph)
    inner = {f"{EXTRAPOLATED}/{name}": name.encode() for name in ("step.onnx", "model.json")}
    described = json.loads(folder_module._folder_files(Bilinear(), inner)["model.json"])
    assert set(described["files"]) == {"step.onnx", "aovs.onnx", f"{EXTRAPOLATED}/model.json"}


@pytest.mark.parametrize(
    ("operators", "opset", "message"),
    [(["Add"], 18, "opsets"), (["Add", "NonMaxSuppression"], 17, r"\['NonMaxSuppression'\] are not")],
)
def test_an_unportable_graph_is_refused(operators: list[str], opset: int, message: str) -> None:
    nodes = [helper.make_node(name, ["a"], ["b"]) for name in operators]
    model = helper.make_model(
        helper.make_graph(nodes, "graph", [], []), opset_imports=[helper.make_opsetid("", opset)]
    )
    with pytest.raises(ExportError, match=message):
        check_portable(model)
    assert issubclass(ExportError, SupersamplerError)


@pytest.fixture(scope="module")
def gbuffer_model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return exported(tmp_path_factory)


class Darker(Demodulated):
    """Reads another base colour than was exported."""

    def compute(self, *inputs: Tensor) -> Any:
        color, jitter, low, high, *others = inputs
        return super().compute(color, jitter, low, 0.9 * high, *others)

    @classmethod
    def inputs(cls) -> list[str]:
        return Demodulated.inputs()


def test_a_method_of_one_ratio_is_held_against_torch_at_sizes_of_it(gbuffer_model: Path) -> None:
    described = json.loads((gbuffer_model / "model.json").read_text())
    gate = [(tuple(s["render"]), tuple(s["display"])) for s in described["parity"]["sizes"]]
    assert {(1, 1), (1, 9), (33, 17)} <= {render for render, _ in gate}
    assert all(display == (2 * render[0], 2 * render[1]) for render, display in gate)
    session = ort.InferenceSession(gbuffer_model / "step.onnx", providers=["CPUExecutionProvider"])
    sizes = ops.Size(5, 3), ops.Size(10, 6)
    assert compare(Demodulated(), session, *sizes).difference <= TOLERANCE
    assert compare(Darker(), session, *sizes).median > TOLERANCE
    card = (gbuffer_model / "MODEL_CARD.md").read_text()
    assert "exactly 2, on both axes" in card
    assert "| gbuffer_display_normal | float32 | 1, 3, display_height, display_width |" in card


def test_a_network_with_other_weights_is_refused() -> None:
    subgraph = load_method("classifier-small").subgraph()
    assert subgraph is not None
    with torch.no_grad():
        subgraph.module.get_parameter("blend.bias").add_(1e-2)
    with pytest.raises(ExportError, match=r"blend_parameters at .*: ONNX Runtime is off by"):
        check_subgraph(subgraph, (find_model("classifier-small") / "network.onnx").read_bytes())
