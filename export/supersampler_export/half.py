"""Convert a method to half precision, for providers that move and compute it fast."""

import copy
from collections.abc import MutableSequence
from typing import TypeVar

import onnx
from torch import Tensor, nn
from torch.nn.utils.fusion import fuse_conv_bn_eval

from supersampler_model.methods.base import Method
from supersampler_model.methods.learned import LearnedMethod

HALF, FLOAT = onnx.TensorProto.FLOAT16, onnx.TensorProto.FLOAT
DETOURS = ("Abs", "ReduceMax", "ReduceSum")
"""Operators that the exporter computes in float32 where their input is half floats."""

Folded = TypeVar("Folded", bound=nn.Module)


class HalfNetwork(nn.Module):
    """A network in half precision with float32 inputs and outputs.

    Batch normalisation is folded into the preceding convolution in float32, as its means and variances may
    exceed the range of half floats.

    Args:
        network: of (tensor, ...) to (tensor, ...); not changed.
    """

    def __init__(self, network: nn.Module) -> None:
        super().__init__()
        self.network = folded(copy.deepcopy(network).eval()).half()

    def forward(self, *inputs: Tensor) -> tuple[Tensor, ...]:
        """Run the network."""
        return tuple(output.float() for output in self.network(*(value.half() for value in inputs)))


def folded(network: Folded) -> Folded:
    """Fold each batch normalisation into the convolution that it follows in a `Sequential`; in place."""
    for module in network.modules():
        if not isinstance(module, nn.Sequential):
            continue
        for i, (first, second) in enumerate(zip(list(module)[:-1], list(module)[1:], strict=True)):
            if isinstance(first, nn.Conv2d) and isinstance(second, nn.BatchNorm2d):
                module[i], module[i + 1] = fuse_conv_bn_eval(first, second), nn.Identity()
    return network


def without_detours(model: onnx.ModelProto) -> onnx.ModelProto:
    """Remove the casts to float32 and back that the exporter adds around DETOURS; in place.

    Providers convert by themselves where they compute such an operator in float32.
    """
    graph = model.graph
    outputs = {value.name for value in graph.output}
    makers = {name: node for node in graph.node for name in node.output}
    readers: dict[str, list[onnx.NodeProto]] = {}
    for node in graph.node:
        for name in node.input:
            readers.setdefault(name, []).append(node)
    for node in graph.node:
        before = makers.get(node.input[0]) if node.op_type in DETOURS else None
        after = readers.get(node.output[0], [])
        if before is None or not _casts_to(before, FLOAT) or node.output[0] in outputs:
            continue
        if not all(_casts_to(cast, HALF) and cast.output[0] not in outputs for cast in after):
            continue
        node.input[0] = before.input[0]
        for back in after:
            for reader in readers[back.output[0]]:
                _rename(reader.input, back.output[0], node.output[0])
    _drop_unread(graph)
    return model


def _casts_to(node: onnx.NodeProto, kind: int) -> bool:
    return node.op_type == "Cast" and node.attribute[0].i == kind


def _rename(names: MutableSequence[str], old: str, new: str) -> None:
    for place, name in enumerate(names):
        if name == old:
            names[place] = new


def _drop_unread(graph: onnx.GraphProto) -> None:
    """Remove casts whose result nothing reads."""
    read = {name for node in graph.node for name in node.input} | {value.name for value in graph.output}
    unread = [node for node in graph.node if node.op_type == "Cast" and node.output[0] not in read]
    for node in unread:
        graph.node.remove(node)


def to_half(method: Method) -> Method | None:
    """Return `method` in half precision; None without a network.

    With `LearnedMethod.in_half` all stages compute in half floats (docs/explanation/precision.md), otherwise
    only the network does.
    """
    if method.fused() is None or not isinstance(method, LearnedMethod):
        return None
    made = copy.deepcopy(method).eval()
    made.net = folded(made.net).half() if method.in_half else HalfNetwork(made.net)
    return made.eval()
