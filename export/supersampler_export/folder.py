"""Writing of a model folder (step.onnx, model.json, a model card), after the check against torch."""

import copy
import dataclasses
import hashlib
import json
from collections import Counter
from collections.abc import Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any

import msgspec
import onnx
import torch
from torch.utils.flop_counter import FlopCounterMode

from supersampler import ShotError, __version__
from supersampler.io.files import check_ours, write_bytes
from supersampler.io.json_files import read_json
from supersampler.methods.model_file import CONTRACT
from supersampler.methods.model_info import EXTRAPOLATED, extents
from supersampler.methods.spec import RENDER, TENSORS, Shape, dtype_of, sized
from supersampler_export.graph import OPSET, export_graph, export_subgraph
from supersampler_export.half import to_half
from supersampler_export.parity import check_half, check_parity, check_subgraph, recorded, tolerance_of_half
from supersampler_export.quantize import cpu_network
from supersampler_export.quantized_graph import quantized_network
from supersampler_export.simplify import without_detours
from supersampler_model.methods.aovs import BlendAovs
from supersampler_model.methods.base import Method, NetworkSubgraph

_FILES = {
    "aovs.onnx": "blends AOVs (alpha, any channels) by the step's `weight` output.",
    "network.onnx": "is the network alone.",
    "network.int8.onnx": "is the network in int8 (QDQ), with the inputs and outputs of `network.onnx`.",
    "step.fp16.onnx": "is the step in half precision (docs/explanation/precision.md).",
    "network.npz": "is the int8 network, for the CPU backend.",
    f"{EXTRAPOLATED}/model.json": "describes the step for extrapolated frames, on the same history.",
}
"""Description of each optional file in the model card."""
_LISTED = "listed by a model.json next to it"


def write_model_folder(method: Method, folder: Path) -> None:
    """Export `method`, check it against torch, and write the folder, model.json last.

    A separate method for extrapolated frames goes to a subfolder. Files that an earlier export wrote, and
    this one does not, are deleted.

    Raises:
        ExportError: opset, operators or parity fail; nothing is written.
        ShotError: existing files were not written by an export; nothing is written.
    """
    check_ours(folder / "model.json", _is_listed, _LISTED)  # before the trace, which takes minutes
    inner: dict[str, bytes] = {}
    if (extrapolated := method.on_extrapolated()) is not None:
        inner = {f"{EXTRAPOLATED}/{name}": made for name, made in _folder_files(extrapolated, {}).items()}
    content = {**inner, **_folder_files(method, inner)}
    for name in content:
        check_ours(folder / name, _is_listed, _LISTED)
    outdated = [folder / name for name in _FILES if name not in content and _is_listed(folder / name)]
    for name, made in content.items():
        write_bytes(folder / name, made)
    for path in outdated:
        path.unlink(missing_ok=True)


def _is_listed(path: Path) -> bool:
    try:
        described = read_json(path.with_name("model.json"))
    except ShotError:
        return False
    if not isinstance(described, dict) or "contract" not in described:
        return False
    return path.name in ("model.json", "MODEL_CARD.md", *described.get("files", ()))


def _folder_files(method: Method, inner: Mapping[str, bytes]) -> dict[str, bytes]:
    """Return all files of a folder by name, model.json last. It also lists the model.json in `inner`."""
    described = describe(method)
    graph = _labelled(export_graph(method), described)
    files = {"step.onnx": _serialized(graph)}
    parity = recorded(check_parity(method, files["step.onnx"]))
    if not method.extrapolates():  # upscalers blend AOVs
        files["aovs.onnx"] = aovs_graph()
    subgraph, network, half = method.subgraph(), cpu_network(method), to_half(method)
    if subgraph is not None:
        alone = export_subgraph(subgraph)
        files["network.onnx"] = _serialized(alone)
        check_subgraph(subgraph, files["network.onnx"])
        if network is not None:
            files["network.int8.onnx"] = _serialized(quantized_network(alone, network))
    if half is not None:
        check_half(method, half)
        files["step.fp16.onnx"] = _serialized(_labelled(without_detours(export_graph(half)), described))
        check_parity(method, files["step.fp16.onnx"], tolerance_of_half(method))
    if network is not None:
        files["network.npz"] = network
    known = files | {name: content for name, content in inner.items() if name == f"{EXTRAPOLATED}/model.json"}
    described["files"] = {name: hashlib.sha256(content).hexdigest() for name, content in known.items()}
    described["parity"] = parity
    files["MODEL_CARD.md"] = model_card(described, graph).encode()
    files["model.json"] = (json.dumps(described, indent=1) + "\n").encode()
    return files


@cache
def aovs_graph() -> bytes:
    """Return the graph that blends AOVs, which is the same in every folder.

    Raises:
        ExportError: see `write_model_folder`.
    """
    graph = _serialized(export_graph(BlendAovs()))
    check_parity(BlendAovs(), graph)
    return graph


def _labelled(graph: onnx.ModelProto, described: Mapping[str, Any]) -> onnx.ModelProto:
    """Add contract and method to the metadata of the graph."""
    for key in ("contract", "method"):
        entry = graph.metadata_props.add()
        entry.key, entry.value = f"supersampler.{key}", str(described[key])
    return graph


def _serialized(graph: onnx.ModelProto) -> bytes:
    return bytes(graph.SerializeToString(deterministic=True))


def describe(method: Method) -> dict[str, Any]:
    """Return the content of model.json without files and parity."""
    spec, subgraph = method.spec, method.subgraph()
    config = getattr(method, "config", spec.config())
    return {
        "contract": CONTRACT,
        "method": spec.name,
        "source": spec.source,
        "ratios": list(spec.ratios),
        "opset": OPSET,
        "inputs": [_tensor(name, TENSORS[name]) for name in spec.inputs],
        **({"only_extrapolated": True} if spec.only_extrapolated else {}),
        "history": [
            {**_tensor(f"history.{name}", shape), "output": f"next.{name}"}
            for name, shape in spec.history.items()
        ],
        "image": _tensor("image", spec.image),
        **({} if subgraph is None else {"network": _network(subgraph)}),
        "aux_outputs": [_tensor(name, TENSORS[name]) for name in spec.aux_outputs],
        "maps": {name: msgspec.structs.asdict(where) for name, where in spec.maps.items()},
        "config": dataclasses.asdict(config),
        **({"learned": dict(method.provenance)} if method.provenance else {}),
        "licence": "Apache-2.0",
        "attributions": list(method.provenance.get("attributions", ())),
        "versions": {
            "supersampler": __version__,
            "torch": torch.__version__.split("+")[0],
            "onnx": onnx.__version__,
        },
    }


def model_card(described: Mapping[str, Any], graph: onnx.ModelProto) -> str:
    """Return MODEL_CARD.md, from the content of model.json."""
    parity = described["parity"]
    tensors = [*described["inputs"], *described["history"], described["image"], *described["aux_outputs"]]
    operators = Counter(node.op_type for node in graph.graph.node)
    lines = [
        f"# {described['method']}",
        "",
        f"Source: {described['source']}. Licence: {described['licence']}.",
        _origin(described.get("learned")),
        "",
        f"`step.onnx` is one whole recurrent step at opset {OPSET}, contract {described['contract']} "
        "(docs/contract.md). Each frame's `next.*` goes back in as `history.*`; all zeros mean no history."
        + "".join(f" `{name}` {text}" for name, text in _FILES.items() if name in described["files"]),
        _purpose(described),
        "",
        "| tensor | type | shape |",
        "|---|---|---|",
        *(f"| {t['name']} | {t['type']} | {', '.join(map(str, t['shape']))} |" for t in tensors),
        "",
        f"Against torch over {parity['frames']} recurrent frames of noise, on toned images in [0, 1): "
        f"difference at {100 * parity['share']:g} % of the values (tolerance {parity['tolerance']:g}), "
        "and the median.",
        "",
        "| render | display | difference | median |",
        "|---|---|---|---|",
        *(
            f"| {_x(at['render'])} | {_x(at['display'])} | {at['difference']:.1e} | {at['median']:.1e} |"
            for at in parity["sizes"]
        ),
        "",
        f"Operators: {', '.join(f'{name} {n}' for name, n in sorted(operators.items()))}.",
        "",
        f"Constants: `{json.dumps(described['config'])}`." if described["config"] else "No constants.",
    ]
    return "\n".join(lines) + "\n"


def _purpose(described: Mapping[str, Any]) -> str:
    """Return the model card's text about purpose and sizes."""
    low, high = described["ratios"]
    if described["image"]["shape"][2:] == list(RENDER):
        return (
            "Computes the colour of unshaded frames at render size, for an upscaler to step on. "
            "After a shaded frame the history is that frame."
        )
    if described.get("only_extrapolated"):
        return "Steps only on extrapolated frames, on the history of the model in the parent folder."
    if low == high:
        return f"A ratio of display to render size of exactly {low:g}, on both axes."
    return f"Any ratio of display to render size from {low} to {high}, per axis."


def _origin(learned: Mapping[str, Any] | None) -> str:
    """Return the provenance of the weights."""
    if learned is None:
        return "No learned weights, no training data."
    scores = ", ".join(f"{name} {value:.3f}" for name, value in learned.get("validation", {}).items())
    assets = "; ".join(learned.get("attributions") or learned.get("assets", [])) or "none"
    init = learned.get("init")
    runs = f"the mean of {learned['mean_of']} runs, the last of " if "mean_of" in learned else ""
    begun = f", begun with those of {init['steps']} updates at commit {init['commit']}" if init else ""
    return (
        f"Weights: {runs}{learned['steps']} updates at commit {learned['commit']}{begun}, on training data "
        f"{learned['data'][:16]}. Validation: {scores or 'none'}. Files of others in that data: {assets}."
    )


def multiply_adds_of(subgraph: NetworkSubgraph) -> float:
    """Count the multiply-adds of convolutions and matrix products, per display pixel, on meta tensors."""
    width, height = display = 960, 544  # multiples of the network's coarsest pixels
    render = width // subgraph.ratio, height // subgraph.ratio
    sizes = extents(render=render, display=display, previous=render)
    inputs = [torch.empty(sized(shape, sizes), device="meta") for shape in subgraph.inputs.values()]
    network = copy.deepcopy(subgraph.module).eval().to("meta")
    with torch.no_grad(), FlopCounterMode(display=False) as counter:
        network(*inputs)
    operations: int = counter.get_total_flops()  # a product and a sum per multiply-add
    return operations / 2 / (width * height)


def _network(subgraph: NetworkSubgraph) -> dict[str, Any]:
    return {
        "inputs": [_tensor(*item) for item in subgraph.inputs.items()],
        "outputs": [_tensor(*item) for item in subgraph.outputs.items()],
        "multiply_adds": multiply_adds_of(subgraph),
    }


def _tensor(name: str, shape: Shape) -> dict[str, Any]:
    return {"name": name, "type": dtype_of(name), "shape": list(shape)}


def _x(size: Sequence[int]) -> str:
    return f"{size[0]}x{size[1]}"
