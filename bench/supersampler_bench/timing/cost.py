"""Multiply-adds and parameters of networks, counted in their graphs."""

import math
from dataclasses import dataclass
from pathlib import Path

import onnx

from supersampler.conventions.jitter import only_ratio
from supersampler.errors import ArgumentError
from supersampler.frame import Size
from supersampler.methods.model_file import find_model, read_model_info
from supersampler_bench.markdown import size_text, table
from supersampler_bench.record import BenchRecord
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


@dataclass(frozen=True)
class CostRecord(BenchRecord):
    """Costs of networks at a display size."""

    display: Size
    networks: list[Cost]
    BENCH = "cost"

    def table(self) -> str:
        """Return the table as Markdown, with its caption."""
        rows = [
            [c.method, f"{c.multiply_adds:,.0f}", f"{c.parameters:,}", c.operators] for c in self.networks
        ]
        headings = ["method", "multiply-adds a display pixel:", "parameters:", "operators:"]
        return table(headings, rows, f"The network alone (`network.onnx`), at {size_text(self.display)}.")
