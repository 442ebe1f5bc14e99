"""Count what a step of the ONNX backend moves, from ONNX Runtime's profile of a run.

A run at 3840x2160 needs tens of gigabytes of memory. All tensors of a step have extents that are linear in
the width or the height, so bytes and multiply-adds are a + b width + c height + d width height: four small
runs give the values at any size, and a fifth checks that this holds.
"""

import json
import math
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from supersampler.backends.onnx.runtime import ort
from supersampler.backends.onnx.session import session_options
from supersampler.conventions.ratios import only_ratio
from supersampler.errors import ArgumentError, ModelError
from supersampler.frame import Size
from supersampler.methods.model_file import find_model, read_model_info
from supersampler.methods.model_info import ModelInfo
from supersampler_bench.timing.traffic import Traffic

BACKEND = "onnx"
PERIOD = 32
"""Sizes of all runs have the remainders of the actual ones by it, as networks pad sizes to 32 or less."""
_BYTES = {"bool": 1, "float16": 2, "float": 4, "int32": 4, "int64": 8, "double": 8}
_KERNEL = "_kernel_time"
"""End of the name of an event that is the execution of one operator."""


def count_onnx(method: str, render: Size, display: Size) -> Traffic:
    """Count a step of `step.onnx`.

    Args:
        method: a shipped model or a model folder.
        render: (width, height) of the frame.
        display: (width, height) of the image.

    Returns:
        Bytes of the inputs and outputs of all operators, multiply-adds of convolutions and matrix products,
        and executed operators.

    Raises:
        ArgumentError: the model is for one other ratio.
        ModelError: the model has tensors of other sizes, or its cost is of another form.
    """
    info = read_model_info(find_model(method))
    ratio, only = display[0] / render[0], only_ratio(info.ratios)
    if only is not None and ratio != only:
        raise ArgumentError("ratio", got=f"{ratio:g}", want=f"{only:g}")
    widths, heights = (small_extents(*extents) for extents in zip(render, display, strict=True))

    places = [(0, 0), (1, 0), (0, 1), (1, 1), (2, 3)]
    counts = [_count_run(info, *zip(widths(x), heights(y), strict=True)) for x, y in places]
    x, y = (
        Fraction(extent - small(0)[0], small(1)[0] - small(0)[0])
        for extent, small in zip(render, (widths, heights), strict=True)
    )
    moved, products = (_bilinear([count[i] for count in counts], x, y) for i in range(2))
    return Traffic(BACKEND, Path(method).name, moved, products, counts[0][2])


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


def _count_run(info: ModelInfo, render: Size, display: Size) -> tuple[int, int, int]:
    """Return bytes, multiply-adds and operators of one run on constant images."""
    total = products = operators = 0
    for event in _profile(info, render, display):
        arguments = event["args"]
        inputs, outputs = arguments["input_type_shape"], arguments["output_type_shape"]
        total += sum(_size_of(tensor) for tensor in (*inputs, *outputs))
        products += _multiply_adds(arguments["op_name"], inputs, outputs)
        operators += 1
    return total, products, operators


def _size_of(tensor: Mapping[str, list[int]]) -> int:
    """Return the bytes of a tensor, which a profile writes as {type: shape}."""
    return sum(_BYTES[kind] * math.prod(shape) for kind, shape in tensor.items())


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


def _profile(info: ModelInfo, render: Size, display: Size) -> Iterator[dict[str, Any]]:
    """Run a step and yield the events of its operators."""
    options = session_options(1)
    options.enable_profiling = True
    # of the graph itself: higher levels convert layouts for the processor
    options.graph_optimization_level = ort.GraphOptimizationLevel.ORT_ENABLE_BASIC
    with tempfile.TemporaryDirectory() as folder:
        options.profile_file_prefix = str(Path(folder) / "step")
        path = info.folder / "step.onnx"
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
