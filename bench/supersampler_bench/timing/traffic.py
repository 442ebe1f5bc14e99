"""Bytes, multiply-adds and dispatches of a step: counted, the same on every machine.

ONNX: from the profile of a run. A run at 3840x2160 needs tens of gigabytes of memory, but all tensors of a
step have extents that are linear in the width or the height. So bytes and multiply-adds are a + b width + c
height + d width height: four small runs give the values at any size, and a fifth checks that this holds.

The CPU provider has no kernels for most operators on half floats: it adds casts, and computes in float32.
Types are therefore those of the graph itself, and casts that are not in it are not counted.
"""

import json
import math
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import onnx

from supersampler.backends.onnx.runtime import ort
from supersampler.backends.onnx.session import session_options
from supersampler.conventions.jitter import only_ratio
from supersampler.errors import ArgumentError, ModelError
from supersampler.frame import Size
from supersampler.methods.model_file import find_model, read_model_info
from supersampler.methods.model_info import ModelInfo
from supersampler_bench.markdown import size_text, table
from supersampler_bench.record import BenchRecord
from supersampler_bench.specs import parse_spec
from supersampler_export.count import multiply_adds


@dataclass(frozen=True)
class Traffic:
    """Cost of one step of a method on a backend.

    Attributes:
        backend: its name.
        method: the model's name.
        bytes: read and written by all dispatches.
        multiply_adds: of convolutions and matrix products.
        dispatches: operators of a graph, or shaders.
    """

    backend: str
    method: str
    bytes: int
    multiply_adds: int
    dispatches: int


@dataclass(frozen=True)
class SizeTraffic:
    """Costs of steps at one pair of sizes."""

    render: Size
    display: Size
    steps: list[Traffic]


@dataclass(frozen=True)
class TrafficRecord(BenchRecord):
    """Costs of steps at some sizes."""

    sizes: list[SizeTraffic]
    BENCH = "traffic"
    TABLES = ("", "roofline")

    def table(self) -> str:
        """Return the table as Markdown, with its caption."""
        rows = [
            [
                f"{size_text(size.render)} to {size_text(size.display)}",
                step.method,
                step.backend,
                f"{step.bytes / 1e9:.2f}",
                f"{step.multiply_adds / 1e9:.1f}",
                step.dispatches,
            ]
            for size in self.sizes
            for step in size.steps
        ]
        headings = ["size", "method", "backend", "GB moved:", "10^9 multiply-adds:", "dispatches:"]
        caption = (
            "One step. Moved are the inputs and outputs of every dispatch; multiply-adds are those of "
            "convolutions and matrix products."
        )
        return table(headings, rows, caption)

    def roofline_table(self) -> str:
        """Return the computed times on GPUS as Markdown, with their caption."""
        steps = [(size, step) for size in self.sizes for step in size.steps if step.backend == "gpu"]
        headings = [
            "GPU",
            *(f"{step.method}, {size_text(s.render)} to {size_text(s.display)}:" for s, step in steps),
        ]
        rows = [
            [gpu.name, *(f"{min_ms(gpu, step.bytes, step.multiply_adds):.2f}" for _, step in steps)]
            for gpu in GPUS
        ]
        caption = (
            "**Computed, not measured**: milliseconds of a step at the published bandwidth of the memory, or "
            "at the published arithmetic for the multiply-adds of the network, whichever is longer. No step "
            "is faster; arithmetic beside the network and dispatches come on top."
        )
        return table(headings, rows, caption)


class GpuFigures(NamedTuple):
    """Published figures of a GPU.

    Attributes:
        name: of the product.
        bandwidth: of its memory, GB/s.
        multiply_adds: in single precision, 10^12 a second: half its TFLOPS.
        dot4: whether it multiplies and adds four bytes at once, at four times that rate.
    """

    name: str
    bandwidth: float
    multiply_adds: float
    dot4: bool = True


GPUS = (
    GpuFigures("NVIDIA H200", 4800.0, 33.5),
    GpuFigures("NVIDIA H100 SXM", 3350.0, 33.5),
    GpuFigures("GeForce RTX 4090", 1008.0, 41.3),
    GpuFigures("GeForce RTX 3090", 936.0, 17.8),
    GpuFigures("GeForce RTX 3060", 360.0, 6.4),
    GpuFigures("Radeon RX 7900 XTX", 960.0, 30.7),
    GpuFigures("Radeon RX 6600", 224.0, 4.5),
    GpuFigures("Arc A770", 560.0, 9.8),
    GpuFigures("Apple M2", 100.0, 1.8, dot4=False),
)
"""Vendors' specifications, boost clocks."""


def min_ms(gpu: GpuFigures, moved: int, multiply_adds: int) -> float:
    """Return the time of a step at the GPU's full bandwidth or arithmetic, whichever is longer, milliseconds.

    Args:
        gpu: the GPU.
        moved: bytes.
        multiply_adds: of the network.
    """
    rate = gpu.multiply_adds * (4.0 if gpu.dot4 else 1.0)
    return max(moved / (gpu.bandwidth * 1e6), multiply_adds / (rate * 1e9))


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


ONNX = "onnx"
PERIOD = 32
"""Sizes of all runs have the remainders of the actual ones by it, as networks pad sizes to 32 or less."""
_BYTES = {"bool": 1, "float16": 2, "float": 4, "int32": 4, "int64": 8, "double": 8}
_KERNEL = "_kernel_time"
"""End of the name of an event that is the execution of one operator."""


def count_onnx(method: str, render: Size, display: Size) -> Traffic:
    """Count a step of `step.onnx`, or of `step.fp16.onnx`.

    Args:
        method: a shipped model or a model folder; "classifier:fp16" in half floats.
        render: (width, height) of the frame.
        display: (width, height) of the image.

    Returns:
        Bytes of the inputs and outputs of all operators, multiply-adds of convolutions and matrix products,
        and executed operators.

    Raises:
        ArgumentError: the model is for one other ratio, or has no such precision.
        ModelError: the model has tensors of other sizes, or its cost is of another form.
    """
    spec = parse_spec(method)
    info, precision = read_model_info(find_model(spec.model)), spec.precision
    path = info.steps.get("fp32" if precision == "auto" else precision)
    if path is None:
        raise ArgumentError("precision", got=precision, want=f"one of {', '.join(info.steps)}")
    ratio, only = display[0] / render[0], only_ratio(info.ratios)
    if only is not None and ratio != only:
        raise ArgumentError("ratio", got=f"{ratio:g}", want=f"{only:g}")
    widths, heights = (small_extents(*extents) for extents in zip(render, display, strict=True))

    places = [(0, 0), (1, 0), (0, 1), (1, 1), (2, 3)]
    counts = [_count_run(info, path, *zip(widths(x), heights(y), strict=True)) for x, y in places]
    x, y = (
        Fraction(extent - small(0)[0], small(1)[0] - small(0)[0])
        for extent, small in zip(render, (widths, heights), strict=True)
    )
    moved, products = (_bilinear([count[i] for count in counts], x, y) for i in range(2))
    named = str(replace(spec, model=Path(spec.model).name))
    return Traffic(ONNX, named, moved, products, counts[0][2])


def small_extents(render: int, display: int) -> Callable[[int], tuple[int, int]]:
    """Return a function from 0, 1, 2, ... to extents of the same ratio and the same remainders by PERIOD."""
    unit = math.gcd(render, display)
    step = PERIOD * render // unit

    def extents(index: int) -> tuple[int, int]:
        small = render % step + (index + 1) * step
        return small, small * display // render

    return extents


def _bilinear(values: Sequence[int], x: Fraction, y: Fraction) -> int:
    """Return a bilinear function at (x, y), from its values at (0, 0), (1, 0), (0, 1), (1, 1), (2, 3).

    Raises:
        ModelError: no bilinear function has these values.
    """
    a, b, c, d, check = values
    across, down, both = b - a, c - a, a - b - c + d
    if a + 2 * across + 3 * down + 6 * both != check:
        raise ModelError(f"the cost of a step is not linear in width and height: {values}")
    return int(a + x * across + y * down + x * y * both)


class _Types(NamedTuple):
    """Types of a node's inputs and outputs, as numbers of onnx.TensorProto."""

    inputs: list[int]
    outputs: list[int]


@cache
def _types_of(path: Path) -> Mapping[str, _Types]:
    """Return the types of each node of a graph, by the node's name."""
    graph = onnx.shape_inference.infer_shapes(onnx.load(path)).graph
    values = (*graph.value_info, *graph.input, *graph.output)
    kinds = {value.name: value.type.tensor_type.elem_type for value in values}
    kinds |= {tensor.name: tensor.data_type for tensor in graph.initializer}
    return {
        node.name: _Types([kinds[name] for name in node.input if name], [kinds[name] for name in node.output])
        for node in graph.node
    }


def _count_run(info: ModelInfo, path: Path, render: Size, display: Size) -> tuple[int, int, int]:
    """Return bytes, multiply-adds and operators of one run on constant images."""
    total = products = operators = 0
    known = _types_of(path)
    for event in _profile(info, path, render, display):
        arguments = event["args"]
        inputs, outputs = arguments["input_type_shape"], arguments["output_type_shape"]
        types = known.get(event["name"].removesuffix(_KERNEL))
        if types is None and arguments["op_name"] == "Cast":  # not of the graph
            continue
        kinds = [0] * len((*inputs, *outputs)) if types is None else [*types.inputs, *types.outputs]
        total += sum(map(_size_of, (*inputs, *outputs), kinds))
        products += _multiply_adds(arguments["op_name"], inputs, outputs)
        operators += 1
    return total, products, operators


def _size_of(tensor: Mapping[str, list[int]], kind: int = 0) -> int:
    """Return the bytes of a tensor, which a profile writes as {type: shape}; `kind` is the graph's type."""
    ((ran, shape),) = tensor.items()
    return _BYTES["float16" if kind == onnx.TensorProto.FLOAT16 else ran] * math.prod(shape)


def _multiply_adds(
    operator: str, inputs: Sequence[Mapping[str, list[int]]], outputs: Sequence[Mapping[str, list[int]]]
) -> int:
    """Return the multiply-adds of an operator; other operators than these have none."""
    if operator not in ("Conv", "ConvTranspose", "FusedConv", "MatMul"):
        return 0
    (out,), (first,) = outputs[0].values(), inputs[0].values()
    if operator == "MatMul":
        return math.prod(out) * first[-1]
    if operator == "ConvTranspose":  # of a stride as large as its kernel: a profile lacks its weights
        return math.prod(out) * first[1]
    (weights,) = inputs[1].values()
    return math.prod(out) * math.prod(weights[1:])


def _profile(info: ModelInfo, path: Path, render: Size, display: Size) -> Iterator[dict[str, Any]]:
    """Run a step and yield the events of its operators."""
    options = session_options(1)
    options.enable_profiling = True
    # of the graph itself: higher levels convert layouts for the processor
    options.graph_optimization_level = ort.GraphOptimizationLevel.ORT_ENABLE_BASIC
    with tempfile.TemporaryDirectory() as folder:
        options.profile_file_prefix = str(Path(folder) / "step")
        session = ort.InferenceSession(path, options, providers=["CPUExecutionProvider"])
        session.run(None, _inputs(info, render, display))
        events = json.loads(Path(session.end_profiling()).read_text(encoding="utf-8"))
    return (event for event in events if event["name"].endswith(_KERNEL))


def _inputs(info: ModelInfo, render: Size, display: Size) -> dict[str, np.ndarray[Any, Any]]:
    """Return constant images of all inputs and of the history."""
    tensors = [*info.inputs, *(entry.input for entry in info.history)]
    try:
        shapes = {t.name: t.shape_for(render=render, display=display, previous=render) for t in tensors}
    except KeyError as error:
        raise ModelError(f"{info.method}: reads tensors of another size, {error}") from error
    arrays = {t.name: np.full(shapes[t.name], 0.25, t.type) for t in tensors}
    return arrays | {"display_size": np.array(display, np.int64)}
