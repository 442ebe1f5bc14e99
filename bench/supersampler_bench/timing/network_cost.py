"""Multiply-adds and parameters of networks, counted in their graphs: the same on every machine."""

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import onnx

from supersampler.conventions.jitter import only_ratio
from supersampler.errors import ArgumentError
from supersampler.frame import Size
from supersampler.methods.model_file import find_model, read_model_info
from supersampler_bench.markdown_table import size_text, table
from supersampler_bench.record import Record
from supersampler_export.count import multiply_adds


@dataclass(frozen=True)
class Cost:
    """Cost of one pass of `network.onnx`.

    Attributes:
        method: the model's name.
        multiply_adds: of its convolutions and matrix products, per display pixel.
        parameters: numbers in its weights.
        operators: nodes of the graph.
    """

    method: str
    multiply_adds: float
    parameters: int
    operators: int


def measure_cost(name_or_path: str, display_size: Size) -> Cost:
    """Count the work of a model's network for one frame.

    Raises:
        ModelError: there is no such model.
        ArgumentError: the model has no network.
    """
    folder = find_model(name_or_path)
    path = folder / "network.onnx"
    if not path.is_file():
        raise ArgumentError("--methods", got=name_or_path, want="methods with a network")
    model = onnx.load(path)
    parameters = sum(math.prod(tensor.dims) for tensor in model.graph.initializer)
    ratio = only_ratio(read_model_info(folder).ratios)
    counted = multiply_adds(model, display_size, 2 if ratio is None else round(ratio))
    return Cost(Path(name_or_path).name, counted, parameters, len(model.graph.node))


def cost_record(costs: Sequence[Cost], display_size: Size) -> dict[str, Any]:
    """Return all values, ready for JSON."""
    return {"bench": "cost", "display": list(display_size), "networks": [asdict(c) for c in costs]}


def markdown_table(record: Record) -> str:
    """Return the table of a record as Markdown, with its caption."""
    costs = (Cost(**row) for row in record["networks"])
    rows = [[c.method, f"{c.multiply_adds:,.0f}", f"{c.parameters:,}", c.operators] for c in costs]
    headings = ["method", "multiply-adds a display pixel:", "parameters:", "operators:"]
    return table(headings, rows, f"The network alone (`network.onnx`), at {size_text(record['display'])}.")
