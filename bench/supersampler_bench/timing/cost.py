"""Multiply-adds and parameters of networks, from `model.json` and the graph."""

import math
from dataclasses import dataclass
from pathlib import Path

import onnx

from supersampler.errors import ArgumentError
from supersampler.methods.model_file import find_model, read_model_info
from supersampler_bench.markdown import table
from supersampler_bench.record import BenchRecord


@dataclass(frozen=True)
class Cost:
    """Cost of one run of `network.onnx`."""

    method: str
    multiply_adds: float  # of convolutions and matrix products, per display pixel
    parameters: int
    operators: int  # nodes of the graph


def cost_of(name_or_path: str) -> Cost:
    """Return the cost of a model's network.

    Raises:
        ArgumentError: the model has no network.
    """
    folder = find_model(name_or_path)
    path = folder / "network.onnx"
    if not path.is_file():
        raise ArgumentError("--methods", got=name_or_path, want="methods with a network")
    graph = onnx.load(path).graph
    parameters = sum(math.prod(tensor.dims) for tensor in graph.initializer)
    counted = read_model_info(folder).multiply_adds
    return Cost(Path(name_or_path).name, counted, parameters, len(graph.node))


@dataclass(frozen=True)
class CostRecord(BenchRecord):
    """Costs of networks."""

    networks: list[Cost]
    BENCH = "cost"

    def table(self) -> str:
        """Return the table of networks."""
        rows = [
            [c.method, f"{c.multiply_adds:,.0f}", f"{c.parameters:,}", c.operators] for c in self.networks
        ]
        headings = ["method", "multiply-adds a display pixel:", "parameters:", "operators:"]
        return table(headings, rows, "The network alone (`network.onnx`).")
