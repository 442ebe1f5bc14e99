"""What the learned part of a model costs, counted in its graph: no clock, so the same on every machine."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import onnx
import onnxruntime as ort

from supersampler.errors import ArgumentError
from supersampler.frame import Size
from supersampler.model_info import find_model

_COUNTED = ("Conv", "MatMul", "Gemm")


@dataclass(frozen=True)
class Cost:
    """Of one pass of `network.onnx`.

    Attributes:
        method: the model's name.
        multiply_adds: of its convolutions and matrix products, per pixel of the display.
        parameters: numbers in them.
        operators: nodes of the graph.
    """

    method: str
    multiply_adds: float
    parameters: int
    operators: int


def measure_cost(name_or_path: str, display_size: Size) -> Cost:
    """Count what a model's network does for one frame.

    Raises:
        ModelError: there is no such model.
        ArgumentError: the model has no network.
    """
    path = find_model(name_or_path) / "network.onnx"
    if not path.is_file():
        raise ArgumentError("--methods", got=name_or_path, want="methods with a network")
    model = onnx.load(path)
    weights = {tensor.name: list(tensor.dims) for tensor in model.graph.initializer}
    shapes = _shapes(
        model, [node.output[0] for node in model.graph.node if node.op_type in _COUNTED], display_size
    )
    total = 0
    for node in model.graph.node:
        if node.op_type in _COUNTED:
            weight = weights[node.input[1]]
            inner = math.prod(weight[1:]) if node.op_type == "Conv" else weight[0]
            total += math.prod(shapes[node.output[0]]) * inner
    pixels = display_size[0] * display_size[1]
    parameters = sum(math.prod(dims) for dims in weights.values())
    return Cost(Path(name_or_path).name, total / pixels, parameters, len(model.graph.node))


def markdown_table(costs: Sequence[Cost], display_size: Size) -> str:
    """Return the table as Markdown, with its caption."""
    rows = [
        "| method | multiply-adds a display pixel | parameters | operators |",
        "| --- | ---: | ---: | ---: |",
        *(f"| {c.method} | {c.multiply_adds:,.0f} | {c.parameters:,} | {c.operators} |" for c in costs),
        "",
        f"The network alone (`network.onnx`), at {display_size[0]}x{display_size[1]}.",
    ]
    return "\n".join(rows)


def _shapes(model: onnx.ModelProto, names: Sequence[str], display_size: Size) -> dict[str, tuple[int, ...]]:
    """Run a graph on zeros, and return the shapes of some of its tensors."""
    half = {"half_width": (display_size[0] + 1) // 2, "half_height": (display_size[1] + 1) // 2}
    zeros = {
        value.name: np.zeros(
            [d.dim_value or half[d.dim_param] for d in value.type.tensor_type.shape.dim], np.float32
        )
        for value in model.graph.input
    }
    del model.graph.output[:]
    model.graph.output.extend(onnx.ValueInfoProto(name=name) for name in names)
    session = ort.InferenceSession(model.SerializeToString(), providers=["CPUExecutionProvider"])
    return {name: array.shape for name, array in zip(names, session.run(names, zeros), strict=True)}
