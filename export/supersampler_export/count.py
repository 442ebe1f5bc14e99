"""Multiply-adds of a network, counted from tensor shapes, without measuring time."""

import copy
import math
from collections.abc import Sequence

import numpy as np
import onnx
import torch
from torch.utils.flop_counter import FlopCounterMode

from supersampler.backends.onnx.runtime import ort
from supersampler.frame import Size
from supersampler.methods.model_info import extents
from supersampler.methods.spec import sized
from supersampler_model.methods.base import NetworkSubgraph

_COUNTED = ("Conv", "MatMul", "Gemm")
COUNTED_AT: Size = (960, 544)
"""Display size that is a multiple of the network's coarsest pixels."""


def multiply_adds(network: onnx.ModelProto, display_size: Size = COUNTED_AT, ratio: int = 2) -> float:
    """Count the multiply-adds of a network's convolutions and matrix products, per display pixel.

    Args:
        network: from `export_subgraph`.
        display_size: (width, height).
        ratio: of display to render size.
    """
    model = onnx.ModelProto()
    model.CopyFrom(network)
    weights = {tensor.name: list(tensor.dims) for tensor in model.graph.initializer}
    counted = [node for node in model.graph.node if node.op_type in _COUNTED]
    shapes = _shapes(model, [node.output[0] for node in counted], display_size, ratio)
    total = 0
    for node in counted:
        weight = weights[node.input[1]]
        inner = math.prod(weight[1:]) if node.op_type == "Conv" else weight[0]
        total += math.prod(shapes[node.output[0]]) * inner
    return total / (display_size[0] * display_size[1])


def multiply_adds_of(subgraph: NetworkSubgraph, display_size: Size = COUNTED_AT) -> float:
    """Count the same from the torch module, on meta tensors.

    Args:
        subgraph: the learned part of a method.
        display_size: (width, height).
    """
    render = (display_size[0] // subgraph.ratio, display_size[1] // subgraph.ratio)
    sizes = extents(render=render, display=display_size, previous=render)
    inputs = [torch.empty(sized(shape, sizes), device="meta") for shape in subgraph.inputs.values()]
    network = copy.deepcopy(subgraph.module).eval().to("meta")
    with torch.no_grad(), FlopCounterMode(display=False) as counter:
        network(*inputs)
    operations: int = counter.get_total_flops()  # a product and a sum per multiply-add
    return operations / 2 / (display_size[0] * display_size[1])


def _shapes(
    model: onnx.ModelProto, names: Sequence[str], display_size: Size, ratio: int
) -> dict[str, tuple[int, ...]]:
    """Run a graph on zeros and return the shapes of some of its tensors."""
    render = (display_size[0] // ratio, display_size[1] // ratio)
    sizes = extents(render=render, display=display_size, previous=render)
    zeros = {
        value.name: np.zeros(
            [d.dim_value or sizes[d.dim_param] for d in value.type.tensor_type.shape.dim], np.float32
        )
        for value in model.graph.input
    }
    del model.graph.output[:]
    model.graph.output.extend(onnx.ValueInfoProto(name=name) for name in names)
    session = ort.InferenceSession(model.SerializeToString(), providers=["CPUExecutionProvider"])
    return {name: array.shape for name, array in zip(names, session.run(names, zeros), strict=True)}
