"""Simplifications of the exporter's slices, gathers and casts of half floats; results stay bit-equal."""

from collections import Counter

import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import helper, numpy_helper

HALF, FLOAT = onnx.TensorProto.FLOAT16, onnx.TensorProto.FLOAT
DETOURS = ("Abs", "ReduceMax", "ReduceSum")
"""Operators that the exporter computes in float32 if their input is half floats."""
AXIS, STEP = 3, 4
"""Indices of inputs of a Slice, after the image, starts and ends."""
Constants = dict[str, NDArray[np.generic]]
Extents = list[object]


def joined_slices(model: onnx.ModelProto) -> onnx.ModelProto:
    """Join a Slice with the Slice of another axis that is its only reader; in place.

    The exporter writes slices of two axes as two nodes. Only steps of 1 are joined.
    """
    graph = model.graph
    constants = {tensor.name: numpy_helper.to_array(tensor) for tensor in graph.initializer}
    readers = _readers(graph)
    makers = {node.output[0]: node for node in graph.node if node.op_type == "Slice"}
    nodes: list[onnx.NodeProto] = []
    made: dict[tuple[str, str], str] = {}

    def joint(first: str, second: str) -> str:
        """Return the name of both inputs concatenated: a constant, or the output of a Concat."""
        if (first, second) not in made:
            name = made[first, second] = f"slices_{len(made)}"
            if first in constants and second in constants:
                both = np.concatenate([constants[first], constants[second]])
                graph.initializer.append(numpy_helper.from_array(both, name))
            else:
                nodes.append(helper.make_node("Concat", [first, second], [name], name=f"node_{name}", axis=0))
        return made[first, second]

    for node in graph.node:
        first = makers.get(node.input[0]) if node.op_type == "Slice" else None
        if first is not None and readers[first.output[0]] == 1 and _independent(first, node, constants):
            nodes.remove(first)
            inputs = [joint(a, b) for a, b in zip(first.input[1:], node.input[1:], strict=True)]
            del node.input[:]
            node.input.extend([first.input[0], *inputs])
        nodes.append(node)
    del graph.node[:]
    graph.node.extend(nodes)
    _remove_unread(graph)
    return model


def _independent(first: onnx.NodeProto, second: onnx.NodeProto, constants: Constants) -> bool:
    """Return whether two slices have steps of 1, and different constant axes."""
    names = [node.input[place] for node in (first, second) for place in (AXIS, STEP)]
    if not all(name in constants for name in names):
        return False
    axis, step, other_axis, other_step = (constants[name] for name in names)
    return bool((step == 1).all() and (other_step == 1).all() and not np.intersect1d(axis, other_axis).size)


def simplified_gathers(model: onnx.ModelProto) -> onnx.ModelProto:
    """Read rows by indices of one or two axes without a Reshape; in place.

    The exporter reshapes the indices of `index_select` to one axis, even if they have one, and reshapes the
    result for two axes. But a Gather takes indices of any rank.
    """
    graph = model.graph
    shapes = {v.name: _extents(v) for v in (*graph.value_info, *graph.input, *graph.output)}
    to_one_axis = {t.name for t in graph.initializer if np.array_equal(numpy_helper.to_array(t), [-1])}
    reshapes = [node for node in graph.node if node.op_type == "Reshape"]
    flattened = {node.output[0]: node.input[0] for node in reshapes if node.input[1] in to_one_axis}
    readers = _readers(graph)
    gathers = {node.output[0]: node for node in graph.node if node.op_type == "Gather"}
    for node in gathers.values():
        indices = flattened.get(node.input[1])
        if indices is not None and len(shapes.get(indices, [])) == 1:
            node.input[1] = indices
    for node in reshapes:
        gather = gathers.get(node.input[0])
        if gather is None or readers[gather.output[0]] != 1:
            continue
        indices = flattened.get(gather.input[1])
        if indices is not None and shapes.get(node.output[0]) == _result(gather, indices, shapes):
            gather.input[1], gather.output[0] = indices, node.output[0]
            graph.node.remove(node)
    _remove_unread(graph)
    return model


def _extents(value: onnx.ValueInfoProto) -> Extents:
    """Return numbers and names of extents, and for each unknown extent an object that equals no other."""
    extents = value.type.tensor_type.shape.dim
    return [getattr(extent, extent.WhichOneof("value") or "", object()) for extent in extents]


def _result(gather: onnx.NodeProto, indices: str, shapes: dict[str, Extents]) -> Extents | None:
    """Return the shape that a Gather would have with these indices; None if it is unknown."""
    image, rows = shapes.get(gather.input[0]), shapes.get(indices)
    if image is None or rows is None:
        return None
    axis = next((attribute.i for attribute in gather.attribute if attribute.name == "axis"), 0)
    return [*image[:axis], *rows, *image[axis + 1 :]]


def without_detours(model: onnx.ModelProto) -> onnx.ModelProto:
    """Remove the casts to float32 and back that the exporter adds around DETOURS; in place.

    Providers that compute such an operator in float32 convert on their own.
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
                renamed = [node.output[0] if name == back.output[0] else name for name in reader.input]
                reader.input[:] = renamed
    _remove_unread(graph)
    return model


def _casts_to(node: onnx.NodeProto, kind: int) -> bool:
    return node.op_type == "Cast" and node.attribute[0].i == kind


def _readers(graph: onnx.GraphProto) -> Counter[str]:
    """Return the number of readers of each value: nodes and graph outputs."""
    readers = Counter(name for node in graph.node for name in node.input)
    readers.update(value.name for value in graph.output)
    return readers


def _remove_unread(graph: onnx.GraphProto) -> None:
    """Remove nodes and constants that nothing reads."""
    read = {value.name for value in graph.output}
    kept = []
    for node in reversed(graph.node):
        if read.intersection(node.output):
            read.update(node.input)
            kept.append(node)
    del graph.node[:]
    graph.node.extend(reversed(kept))
    for tensor in [tensor for tensor in graph.initializer if tensor.name not in read]:
        graph.initializer.remove(tensor)
