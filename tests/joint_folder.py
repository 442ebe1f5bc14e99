"""A model folder with an inner folder for extrapolated frames, made from a shipped one without tracing."""

import hashlib
import json
import shutil
from pathlib import Path
from typing import Any

import onnx
from onnx import TensorProto, helper

from supersampler.methods.model_file import find_model
from supersampler.methods.model_info import EXTRAPOLATED

SURFACE = "gbuffer_base_color"


def joint_folder(folder: Path) -> Path:
    """Write `classifier` as a model that brightens extrapolated frames by their mean base colour."""
    shipped = find_model("classifier")
    described: dict[str, Any] = json.loads((shipped / "model.json").read_text("utf-8"))
    for there in (folder, folder / EXTRAPOLATED):
        there.mkdir(parents=True)
        shutil.copy(shipped / "aovs.onnx", there)
    shutil.copy(shipped / "step.onnx", folder)
    onnx.save(brightened(onnx.load(shipped / "step.onnx")), folder / EXTRAPOLATED / "step.onnx")
    surface = {"name": SURFACE, "type": "float32", "shape": [1, 3, "render_height", "render_width"]}
    inner = {"method": "joint-drawn", "only_extrapolated": True, "inputs": [*described["inputs"], surface]}
    written(folder / EXTRAPOLATED, {**described, **inner}, ["step.onnx", "aovs.onnx"])
    outer = {**described, "method": "joint"}
    written(folder, outer, ["step.onnx", "aovs.onnx", f"{EXTRAPOLATED}/model.json"])
    return folder


def written(folder: Path, described: dict[str, Any], files: list[str]) -> None:
    digests = {name: hashlib.sha256((folder / name).read_bytes()).hexdigest() for name in files}
    (folder / "model.json").write_text(json.dumps({**described, "files": digests}), encoding="utf-8")


def brightened(model: onnx.ModelProto) -> onnx.ModelProto:
    graph = model.graph
    for node in graph.node:
        for number, name in enumerate(node.output):
            if name == "image":
                node.output[number] = "plain"
        for number, name in enumerate(node.input):
            if name == "image":
                node.input[number] = "plain"
    shape = (1, 3, "render_height", "render_width")
    graph.input.append(helper.make_tensor_value_info(SURFACE, TensorProto.FLOAT, shape))
    graph.node.append(helper.make_node("ReduceMean", [SURFACE], ["mean"], keepdims=1))
    graph.node.append(helper.make_node("Add", ["plain", "mean"], ["image"]))
    return model
