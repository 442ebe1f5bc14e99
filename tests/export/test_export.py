"""Exported folders and graphs, and parts of the exporter that need no tracing."""

import io
import json
from contextlib import nullcontext
from dataclasses import asdict
from functools import cache
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np
import onnx
import onnxruntime as ort
import pytest
import torch
from onnx import TensorProto, helper
from torch import Tensor, nn
from typer.testing import CliRunner

from gbuffer_method import Demodulated, exported
from supersampler import Frame, Model, StepResult, SupersamplerError, Upscaler
from supersampler.cli import app
from supersampler.methods.model_file import CONTRACT, find_model, read_model_info
from supersampler.methods.model_info import EXTRAPOLATED
from supersampler.methods.registry import methods
from supersampler.methods.spec import DISPLAY, HALF, PREVIOUS, RENDER, SHADED, MethodSpec, Shape
from supersampler_export import folder as folder_module
from supersampler_export import graph
from supersampler_export.count import multiply_adds_of
from supersampler_export.folder import describe, model_card, write_model_folder
from supersampler_export.graph import (
    ExportError,
    _declare,
    _strip,
    check_portable,
    example_arguments,
    example_inputs,
    export_graph,
    history_name,
    shape_of,
    traced_sizes,
)
from supersampler_export.parity import (
    SIZES,
    TOLERANCE,
    check_parity,
    check_subgraph,
    compare,
    sizes_of,
    tolerance_of_half,
)
from supersampler_export.quantize import cpu_network
from supersampler_model import ops
from supersampler_model.methods import load_method
from supersampler_model.methods.base import Method, NetworkSubgraph, Trained, save_trained
from supersampler_model.methods.classifier_paper import PaperClassifier
from supersampler_model.methods.spatial import Bilinear

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
    fresh = set(model_card(shipped, graph, []).splitlines())
    assert fresh <= set((folder / "MODEL_CARD.md").read_text(encoding="utf-8").splitlines())


@pytest.mark.parametrize("name", [pytest.param("classifier", marks=pytest.mark.long), "classifier-small"])
def test_the_int8_network_is_up_to_date(name: str) -> None:
    made = cpu_network(load_method(name))
    assert made is not None
    fresh, shipped = np.load(io.BytesIO(made)), np.load(find_model(name) / "network.npz")
    assert fresh.files == shipped.files
    for array in fresh.files:
        np.testing.assert_array_equal(fresh[array], shipped[array])


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
def test_a_shipped_graph_is_portable_and_describes_itself(name: str) -> None:
    model = onnx.load(find_model(name) / "step.onnx")
    check_portable(model)
    metadata = {entry.key: entry.value for entry in model.metadata_props}
    assert metadata == {"supersampler.contract": str(CONTRACT), "supersampler.method": name}


@pytest.mark.parametrize("name", SHIPPED)
def test_the_description_names_every_tensor_of_the_graph(name: str) -> None:
    info = read_model_info(find_model(name))
    graph = onnx.load(info.steps["fp32"]).graph
    inputs = [t.name for t in info.inputs] + [h.name for h in info.history]
    assert [value.name for value in graph.input] == inputs
    outputs = [info.image.name, *(h.output for h in info.history), *(t.name for t in info.aux_outputs)]
    assert [value.name for value in graph.output] == outputs
    assert {where.output for where in info.maps.values()} <= set(outputs)
    for value, tensor in zip(graph.input, [*info.inputs, *info.history], strict=True):
        dims = [dim.dim_param or dim.dim_value for dim in value.type.tensor_type.shape.dim]
        assert tuple(dims) == tensor.shape
        assert helper.tensor_dtype_to_np_dtype(value.type.tensor_type.elem_type) == np.dtype(tensor.type)


@pytest.mark.parametrize("name", LEARNED)
def test_the_shipped_network_is_the_learned_part_of_the_method(name: str) -> None:
    fused = load_method(name).subgraph()
    assert fused is not None
    path = find_model(name) / "network.onnx"
    check_portable(onnx.load(path))
    check_subgraph(fused, path.read_bytes())


@pytest.mark.parametrize("name", LEARNED)
def test_the_shipped_model_states_the_multiply_adds_that_torch_counts(name: str) -> None:
    fused = load_method(name).subgraph()
    assert fused is not None
    assert read_model_info(find_model(name)).multiply_adds == multiply_adds_of(fused)


@pytest.mark.long  # traces a network
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
    assert CliRunner().invoke(app, arguments).exit_code == 0
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


@pytest.mark.parametrize("arguments", [["classifier-paper"], ["taau", "--weights", "weights.safetensors"]])
def test_weights_go_with_methods_that_are_learned(arguments: list[str], tmp_path: Path) -> None:
    result = CliRunner().invoke(app, ["export", *arguments, "-o", str(tmp_path)])
    assert result.exit_code == 1
    assert "--weights" in result.output


class Wider(Bilinear):
    """Computes another image in torch than the graph of `Bilinear`."""

    @staticmethod
    def kernel(distance: Tensor) -> Tensor:
        return (1.01 - distance.abs()).clamp(min=0.0)


@pytest.mark.usefixtures("bilinear_traced_once")
def test_a_graph_with_another_image_is_not_written(tmp_path: Path) -> None:
    with pytest.raises(ExportError, match=r"bilinear at \(26, 18\) -> .* is off by .*; want 1e-04"):
        write_model_folder(Wider(), tmp_path / "model")
    assert not (tmp_path / "model").exists()


@pytest.mark.usefixtures("bilinear_traced_once")
def test_a_write_that_fails_leaves_no_description(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> str:
        raise OSError("disk full")

    monkeypatch.setattr(folder_module, "model_card", refuse)
    with pytest.raises(OSError, match="disk full"):
        write_model_folder(Bilinear(), tmp_path / "model")
    assert not (tmp_path / "model" / "model.json").exists()


@pytest.mark.parametrize("name", ["step.onnx", "MODEL_CARD.md", "model.json"])
def test_foreign_files_are_kept_and_those_of_an_earlier_export_replaced(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    described = json.dumps({"contract": 1, "files": {"step.onnx": ""}}).encode()
    made = {"step.onnx": b"graph", "MODEL_CARD.md": b"card", "model.json": described}
    monkeypatch.setattr(folder_module, "_folder_files", lambda *_: made)
    (tmp_path / name).write_text('{"mine": 1}')
    with pytest.raises(SupersamplerError, match=rf"{name}: is there already, and is not listed by a model"):
        write_model_folder(Bilinear(), tmp_path)
    assert [(path.name, path.read_text()) for path in tmp_path.iterdir()] == [(name, '{"mine": 1}')]
    (tmp_path / name).unlink()
    for _ in range(2):
        write_model_folder(Bilinear(), tmp_path)
    assert {path.name: path.read_bytes() for path in tmp_path.iterdir()} == made


@pytest.mark.usefixtures("bilinear_traced_once")
def test_an_exported_folder_is_a_model(tmp_path: Path) -> None:
    write_model_folder(Bilinear(), tmp_path / "mine")
    assert Model.load(tmp_path / "mine").info.method == "bilinear"
    assert (
        "| color | float32 | 1, 3, render_height, render_width |"
        in (tmp_path / "mine" / "MODEL_CARD.md").read_text()
    )


def test_an_inner_folder_is_listed_by_its_description_only(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
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


def test_the_gate_measures_in_both_directions() -> None:
    class Same(Method):
        """A step that returns its input."""

        spec: ClassVar = MethodSpec(name="same", source="a test", inputs=("color",))

        def compute(self, color: Tensor) -> tuple[Tensor]:
            return (color * 1.0,)

    node = helper.make_node("Identity", ["color"], ["image"])
    shape: list[str | int | None] = [1, 3, "h", "w"]
    value = [helper.make_tensor_value_info(n, onnx.TensorProto.FLOAT, shape) for n in ("color", "image")]
    graph = helper.make_graph([node], "same", [value[0]], [value[1]])
    same = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 17)], ir_version=10)
    assert all(p.largest == 0 for p in check_parity(Same(), same.SerializeToString()))
    assert ops.Size(26, 18) in [p.render for p in check_parity(Same(), same.SerializeToString())]


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


@pytest.mark.parametrize(("ratio", "renders"), [(4.0, 8), (1.5, 3), (1.0, 8)])
def test_sizes_of_the_gate_are_whole_at_any_one_ratio(ratio: float, renders: int) -> None:
    class Other(Demodulated):
        """At another ratio."""

        ratios = (ratio, ratio)

    sizes = sizes_of(Other())
    assert len(sizes) == renders
    assert all((w * ratio, h * ratio) == display for (w, h), display in sizes)
    assert sizes_of(Bilinear()) == SIZES


class Kept(Method):
    """A method of no use."""

    spec: ClassVar = MethodSpec(
        name="kept",
        source="a test",
        inputs=("color", "display_size", "aovs", "gbuffer_display_depth"),
        history={
            "color": (1, 3, *DISPLAY),
            "classes": (1, 6, *HALF),
            "depth": (1, 2, *PREVIOUS),
            "old": (1, 1, *SHADED),
            "jitter": (1, 2),
        },
    )

    def compute(
        self, color: Tensor, display_size: Tensor, aovs: Tensor, gbuffer_display_depth: Tensor,
        history_color: Tensor, history_classes: Tensor, history_depth: Tensor, history_old: Tensor,
        history_jitter: Tensor,
    ) -> tuple[Tensor, ...]:  # fmt: skip
        raise NotImplementedError


def test_example_arguments_have_the_shapes_of_the_contract_and_sizes_that_differ() -> None:
    arguments = example_arguments(Kept(), ops.Size(26, 18), ops.Size(53, 37), ops.Size(22, 15))
    color, display_size, aovs, depth, *history = arguments
    assert color.shape == (1, 3, 18, 26)
    assert display_size.tolist() == [53, 37]
    assert aovs.shape == (1, 3, 18, 26)
    assert depth.shape == (1, 1, 37, 53)
    shapes = [(1, 3, 37, 53), (1, 6, 19, 27), (1, 2, 15, 22), (1, 1, 17, 23), (1, 2)]
    assert [tuple(t.shape) for t in history] == shapes
    assert all(float(t.min()) >= 0.0 and float(t.max()) <= 1.0 for t in (color, aovs, depth, *history))


def test_names_and_shapes_of_history_tensors_are_those_of_the_method() -> None:
    assert history_name("history_classes") == "history.classes"
    assert history_name("history_history_x") == "history.history_x"
    assert shape_of(Kept(), "history_old") == (1, 1, *SHADED)
    assert shape_of(Kept(), "color") == (1, 3, *RENDER)


@pytest.mark.parametrize(
    ("ratios", "display"), [((1.0, 4.0), (52, 37)), ((2.0, 2.0), (52, 36)), ((1.0, 1.0), (26, 18))]
)
def test_a_graph_is_traced_at_no_whole_ratio_where_the_method_may_have_one(
    ratios: tuple[float, float], display: tuple[int, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Kept, "ratios", ratios)
    assert traced_sizes(Kept()) == (ops.Size(26, 18), ops.Size(*display))


def test_a_ratio_without_a_matching_size_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(Kept, "ratios", (1.3, 1.3))
    with pytest.raises(ExportError, match="kept"):
        traced_sizes(Kept())


@pytest.mark.parametrize("ratio", [2, 4])
def test_example_inputs_of_a_network_are_of_render_half_and_display_size(ratio: int) -> None:
    inputs: dict[str, Shape] = {"a": (1, 5, *RENDER), "b": (1, 2, *DISPLAY), "c": (1, 7, *HALF)}
    made = example_inputs(NetworkSubgraph(nn.Identity(), inputs, {}, ratio), ops.Size(21, 13))
    assert [tuple(t.shape) for t in made] == [(1, 5, 13, 21), (1, 2, 13 * ratio, 21 * ratio), (1, 7, 13, 21)]


def test_a_network_of_any_size_from_one_pixel_on_can_be_traced(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its display size is a whole multiple of its render size."""
    inputs: dict[str, Shape] = {"a": (1, 5, *RENDER), "b": (1, 2, *DISPLAY), "c": (1, 7, *HALF)}
    values = [helper.make_tensor_value_info(name, TensorProto.FLOAT, None) for name in inputs]
    free: list[Any] = []

    def traced(module: nn.Module, arguments: Any, inputs: Any, outputs: Any, dims: Any) -> onnx.ModelProto:
        free.extend(dims)
        return helper.make_model(helper.make_graph([], "g", values, []))

    monkeypatch.setattr(graph, "_traced", traced)
    graph.export_subgraph(NetworkSubgraph(nn.Identity(), inputs, {}, 4))
    render, display, half = free
    for axis in (2, 3):
        assert (render[axis].min, half[axis].min) == (1, 1)
        assert 8192 <= render[axis].max == half[axis].max <= 32768
        assert display[axis].root is render[axis]
        assert display[axis].fn(3) == 12
    assert len({dim.__name__ for dims in (render, half) for dim in dims.values()}) == 4


@pytest.mark.parametrize(("off", "refused"), [(0.5e-4, False), (2e-4, True)])
@pytest.mark.parametrize("largest", [0.5, 300.0])
def test_a_network_may_be_off_by_the_tolerance_of_its_largest_value_or_of_1(
    off: float, refused: bool, largest: float
) -> None:
    class Ramp(nn.Module):
        """Values from 0 to the largest, a little off."""

        def forward(self, image: Tensor) -> tuple[Tensor]:
            return (image * 0.0 + torch.tensor([0.0, largest]).reshape(1, 2, 1, 1) + off * max(largest, 1.0),)

    shape: Shape = (1, 2, *HALF)
    zero = helper.make_node("Sub", ["image", "image"], ["zero"])
    ramp = helper.make_tensor("ramp", TensorProto.FLOAT, (1, 2, 1, 1), [0.0, largest])
    add = helper.make_node("Add", ["zero", "ramp"], ["made"])
    values = [helper.make_tensor_value_info(n, TensorProto.FLOAT, shape) for n in ("image", "made")]
    exact = helper.make_model(
        helper.make_graph([zero, add], "ramp", values[:1], values[1:], [ramp]),
        opset_imports=[helper.make_opsetid("", 17)], ir_version=10,
    )  # fmt: skip
    fused = NetworkSubgraph(Ramp(), {"image": shape}, {"made": shape}, 1)
    with pytest.raises(ExportError, match="ONNX Runtime is off by") if refused else nullcontext():
        check_subgraph(fused, exact.SerializeToString())


def test_multiply_adds_are_counted_for_each_pixel_of_the_display() -> None:
    """A 3x3 convolution of 4 to 8 channels at render size: 288 a pixel there, 72 a pixel of the display."""
    inputs: dict[str, Shape] = {"image": (1, 4, *RENDER)}
    fused = NetworkSubgraph(nn.Conv2d(4, 8, 3, padding=1, bias=False), inputs, {}, 2)
    assert multiply_adds_of(fused) == pytest.approx(4 * 8 * 9 / 4)
    assert multiply_adds_of(fused, (64, 32)) == pytest.approx(4 * 8 * 9 / 4)
    half = NetworkSubgraph(fused.module, {"image": (1, 4, *HALF)}, {}, 1)
    assert multiply_adds_of(half) == pytest.approx(4 * 8 * 9 / 4)
    assert next(fused.module.parameters()).device == torch.device("cpu"), "the module is not moved"


def test_exporter_metadata_is_removed_and_shapes_are_the_contracts() -> None:
    value = [helper.make_tensor_value_info(name, TensorProto.FLOAT, [1, "s0"]) for name in ("x", "y")]
    node = helper.make_node("Relu", ["x"], ["y"])
    graph = helper.make_graph([node], "g", value[:1], value[1:], value_info=[value[0]])
    model = helper.make_model(graph)
    for holder in (model.graph, model.graph.node[0]):
        entry = holder.metadata_props.add()
        entry.key, entry.value = "namespace", "/home/me/src"
    _declare(model.graph.input, [(1, "width")])
    _strip(model)
    assert not model.graph.value_info
    assert not model.graph.metadata_props
    assert not model.graph.node[0].metadata_props
    [dimension] = [d.dim_param for d in model.graph.input[0].type.tensor_type.shape.dim if d.dim_param]
    assert dimension == "width"
    assert model.graph.input[0].type.tensor_type.elem_type == TensorProto.FLOAT
    onnx.checker.check_model(model)
