"""Export of a method to one ONNX graph of its whole recurrent step."""

import contextlib
import copy
import functools
import inspect
import io
import logging
import warnings
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from typing import Any

import onnx
import torch
from onnxscript import rewriter
from torch import Tensor, nn

from supersampler.conventions.jitter import only_ratio, scaled
from supersampler.errors import SupersamplerError
from supersampler.methods import spec as shapes
from supersampler.methods.model_info import extents
from supersampler.methods.spec import DISPLAY, HALF, LARGE_HALF, RENDER, TENSORS, Shape, sized
from supersampler_export.half import folded
from supersampler_export.simplify import joined_slices, simplified_gathers
from supersampler_model import ops
from supersampler_model.methods.base import Method, NetworkSubgraph

OPSET = 17
"""Last opset whose GridSample every provider implements alike (docs/contract.md)."""

PORTABLE_OPERATORS = frozenset({
    "Abs", "Add", "And", "Cast", "Clip", "Concat", "Conv", "ConvTranspose", "DepthToSpace", "Div", "Equal",
    "Exp", "Expand", "Floor", "Gather", "Greater", "GreaterOrEqual", "GridSample", "Identity", "Less",
    "LessOrEqual", "Log", "MatMul", "Max", "MaxPool", "Min", "Mul", "Neg", "Not", "Or", "Pow", "Range",
    "Reciprocal", "ReduceMax", "ReduceSum", "Relu", "Reshape", "Shape", "Sigmoid", "Slice", "Split", "Sqrt",
    "Squeeze", "Sub", "Transpose", "Unsqueeze", "Where"
})  # fmt: skip
"""Operators that CUDA, TensorRT, DirectML, WebGPU and CPU implement alike."""


class ExportError(SupersamplerError, RuntimeError):
    """The graph cannot be exported, or differs from torch."""


def graph_inputs(method: Method) -> dict[str, Shape]:
    """Return names and shapes of the inputs of a step's graph; the history's names are history.NAME."""
    inputs: dict[str, Shape] = {name: TENSORS[name] for name in method.inputs()}
    return inputs | {f"history.{name}": shape for name, shape in method.history.items()}


def export_graph(method: Method) -> onnx.ModelProto:
    """Trace `method` with free sizes, at opset 17, with portable operators only.

    Raises:
        ExportError: the exporter returned another opset, or an operator that is not portable.
    """
    arguments = example_arguments(method, *traced_sizes(method), ops.Size(22, 15))
    outputs: dict[str, Sequence[int | str]] = {"image": method.spec.image}
    # this frame's size is the next one's previous size
    previous = *shapes.PREVIOUS, *shapes.BLOCKS, shapes.PHASES
    current = dict(zip(previous, (*RENDER, *shapes.NEXT_BLOCKS, shapes.NEXT_PHASES), strict=True))
    for name, shape in method.history.items():
        outputs[f"next.{name}"] = [current.get(n, n) if isinstance(n, str) else n for n in shape]
    outputs |= {name: TENSORS[name] for name in method.spec.aux_outputs}
    return _traced(
        folded(copy.deepcopy(method).eval()), arguments, graph_inputs(method), outputs, _dims(method)
    )


def traced_sizes(method: Method) -> tuple[ops.Size, ops.Size]:
    """Return (render, display) to trace at; not a whole ratio unless the method requires one."""
    render, ratio = ops.Size(26, 18), only_ratio(method.ratios)
    display = (52, 37) if ratio is None else scaled(render, ratio)
    if display is None:
        raise ExportError(f"{method.name}: {tuple(render)} times {ratio:g} is not a whole size")
    return render, ops.Size(*display)


def _dims(method: Method) -> dict[str, Any]:
    """Return the Dim of each name in shapes. At one whole ratio, display sizes are multiples of render's."""
    sizes = extents(render=(1, 1), display=(1, 1), previous=(1, 1))
    names = *sizes, *shapes.SHADED, *shapes.EARLIER, *shapes.BETWEEN, shapes.CHANNELS
    dims: dict[str, Any] = {name: torch.export.Dim(name, min=1, max=1 << 15) for name in names}
    ratio = only_ratio(method.ratios)
    if ratio is not None and ratio.is_integer():
        for render, display, half in zip(RENDER, DISPLAY, HALF, strict=True):
            dims[display] = _times(dims[render], int(ratio))
            if ratio % 2 == 0:
                dims[half] = _times(dims[render], int(ratio) // 2)
    return dims


def _times(dim: Any, factor: int) -> Any:
    return dim if factor == 1 else factor * dim


def export_subgraph(subgraph: NetworkSubgraph) -> onnx.ModelProto:
    """Trace the network alone, with free sizes.

    Raises:
        ExportError: the exporter returned another opset, or an operator that is not portable.
    """
    dims = {n: torch.export.Dim(n, min=1, max=1 << 14) for n in (*HALF, *LARGE_HALF, *RENDER)}
    dims |= {d: _times(dims[r], subgraph.ratio) for d, r in zip(DISPLAY, RENDER, strict=True)}
    arguments = example_inputs(subgraph, ops.Size(21, 13))
    return _traced(subgraph.module, arguments, subgraph.inputs, subgraph.outputs, dims)


def example_inputs(subgraph: NetworkSubgraph, size: ops.Size) -> list[Tensor]:
    """Return random inputs of the network; `size` is half the size of its images, or the render size."""
    sizes: dict[str, int] = {}
    for names in (HALF, LARGE_HALF, RENDER):
        sizes |= zip(names, size[::-1], strict=True)
    sizes |= {d: subgraph.ratio * sizes[r] for d, r in zip(DISPLAY, RENDER, strict=True)}
    return [torch.rand(sized(shape, sizes)) for shape in subgraph.inputs.values()]


def _traced(
    module: nn.Module,
    arguments: Sequence[Tensor],
    inputs: Mapping[str, Shape],
    outputs: Mapping[str, Sequence[int | str]],
    dims: Mapping[str, Any],
) -> onnx.ModelProto:
    """Trace a module; inputs and outputs get the symbolic shapes of the contract, with `dims` for names."""
    dynamic = [{axis: dims[n] for axis, n in enumerate(s) if isinstance(n, str)} for s in inputs.values()]
    parameters = inspect.signature(module.forward).bind(*dynamic).arguments  # `*history` takes several
    with _quiet(), _fast_rewriting(), torch.no_grad():
        program = torch.onnx.export(
            module.eval(), tuple(arguments), dynamo=True, opset_version=OPSET, input_names=[*inputs],
            output_names=[*outputs], dynamic_shapes=parameters, verbose=False,
        )  # fmt: skip
    if program is None:
        raise ExportError("torch.onnx.export returned no program")
    model = simplified_gathers(joined_slices(program.model_proto))
    check_portable(model)
    onnx.checker.check_model(model, full_check=True)
    for values, shape_by_name in ((model.graph.input, inputs), (model.graph.output, outputs)):
        for value, shape in zip(values, shape_by_name.values(), strict=True):
            kind = value.type.tensor_type.elem_type
            value.CopyFrom(onnx.helper.make_tensor_value_info(value.name, kind, shape))
    del model.graph.value_info[:], model.graph.metadata_props[:]  # of the exporter
    for node in model.graph.node:
        del node.metadata_props[:]
    return model


def example_arguments(
    method: Method, render: ops.Size, display: ops.Size, previous: ops.Size
) -> list[Tensor]:
    """Return random inputs of the step, for tracing."""
    sizes = extents(render=render, display=display, previous=previous) | {shapes.CHANNELS: 3}
    for i, (height, width) in enumerate((shapes.SHADED, shapes.EARLIER, shapes.BETWEEN), 1):
        sizes |= {height: previous.height + 2 * i, width: previous.width + i}
    return [
        torch.tensor(display) if name == "display_size" else torch.rand(sized(shape, sizes))
        for name, shape in graph_inputs(method).items()
    ]


def check_portable(model: onnx.ModelProto, others: Collection[str] = ()) -> None:
    """Raise ExportError unless the opset is 17, and all operators are portable or among `others`."""
    opsets = {opset.domain: opset.version for opset in model.opset_import}
    if opsets.get("") != OPSET or set(opsets) - {""}:
        raise ExportError(f"the exporter returned opsets {opsets}; want {OPSET} and no other domain")
    unsupported = {node.op_type for node in model.graph.node} - PORTABLE_OPERATORS - {*others}
    if unsupported:
        raise ExportError(f"operators {sorted(unsupported)} are not portable; rewrite the step without them")
    for node in model.graph.node:
        for attribute in node.attribute:
            if node.op_type == "GridSample" and attribute.name == "mode" and attribute.s == b"bicubic":
                raise ExportError("GridSample bicubic differs between providers; use nine bilinear reads")


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Silence the exporter's progress and warnings, and the errors that it logs of strategies that fail.

    The exporter raises if all strategies fail. With smaller ranges of sizes the first one succeeds, but the
    graphs differ.
    """
    loggers = {
        logging.getLogger("torch.onnx"): logging.ERROR,
        logging.getLogger("torch._guards"): logging.CRITICAL,
    }
    levels = {logger: logger.level for logger in loggers}
    for logger, level in loggers.items():
        logger.setLevel(level)
    try:
        with (
            warnings.catch_warnings(),
            contextlib.redirect_stdout(io.StringIO()),
            contextlib.redirect_stderr(io.StringIO()),
        ):
            warnings.simplefilter("ignore")
            yield
    finally:
        for logger, level in levels.items():
            logger.setLevel(level)


@contextlib.contextmanager
def _fast_rewriting() -> Iterator[None]:
    """Apply the rewriting rule SlicesSplit to slices only.

    Otherwise it compares every node with every Slice, which takes a third of the time of a trace.
    """

    def on_slices(rewrite: Callable[..., Any], model: Any, graph: Any, node: Any, **options: Any) -> Any:
        return rewrite(model, graph, node, **options) if node.op_type == "Slice" else None

    rules = [rule for rule in getattr(rewriter, "_DEFAULT_REWRITE_RULES", ()) if rule.name == "SlicesSplit"]
    for rule in rules:
        rule.try_rewrite = functools.partial(on_slices, rule.try_rewrite)
    try:
        yield
    finally:
        for rule in rules:
            del rule.try_rewrite  # the class has its own
