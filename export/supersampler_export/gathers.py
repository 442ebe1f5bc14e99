"""Simplify what the exporter writes around a Gather: flattened indices, and the reshaped result."""

from collections import Counter

import numpy as np
import onnx
from onnx import numpy_helper

Extents = list[object]


def simplified_gathers(model: onnx.ModelProto) -> onnx.ModelProto:
    """Read rows by indices of two axes in one operator; in place.

    `index_select` has indices of one axis. The exporter reshapes them to one axis, also where they have one,
    and a result of two axes is reshaped once more. A Gather takes indices of any rank.
    """
    graph = model.graph
    shapes = {v.name: _extents(v) for v in (*graph.value_info, *graph.input, *graph.output)}
    flattened = _flattened(graph)
    readers = Counter(name for node in graph.node for name in node.input)
    readers.update(value.name for value in graph.output)
    gathers = {node.output[0]: node for node in graph.node if node.op_type == "Gather"}
    for node in graph.node:
        indices = flattened.get(node.input[1]) if node.op_type == "Gather" else None
        if indices is not None and len(shapes.get(indices, [])) == 1:
            node.input[1] = indices
    removed = []
    for node in graph.node:
        gather = gathers.get(node.input[0]) if node.op_type == "Reshape" else None
        if gather is None or readers[gather.output[0]] != 1:
            continue
        indices = flattened.get(gather.input[1])
        if indices is not None and shapes.get(node.output[0]) == _result(gather, indices, shapes):
            gather.input[1], gather.output[0] = indices, node.output[0]
            removed.append(node)
    for node in removed:
        graph.node.remove(node)
    _remove_unread(graph)
    return model


def _extents(value: onnx.ValueInfoProto) -> Extents:
    """Return numbers, names, and for what is unknown an object that equals no other."""
    extents = value.type.tensor_type.shape.dim
    return [getattr(extent, extent.WhichOneof("value") or "", object()) for extent in extents]


def _flattened(graph: onnx.GraphProto) -> dict[str, str]:
    """Return the input of each Reshape to one axis, by the name of its result."""
    to_one_axis = {t.name for t in graph.initializer if np.array_equal(numpy_helper.to_array(t), [-1])}
    return {
        node.output[0]: node.input[0]
        for node in graph.node
        if node.op_type == "Reshape" and node.input[1] in to_one_axis
    }


def _result(gather: onnx.NodeProto, indices: str, shapes: dict[str, Extents]) -> Extents | None:
    """Return the shape that a Gather would have with these indices; None where it is not known."""
    image, rows = shapes.get(gather.input[0]), shapes.get(indices)
    if image is None or rows is None:
        return None
    axis = next((attribute.i for attribute in gather.attribute if attribute.name == "axis"), 0)
    return [*image[:axis], *rows, *image[axis + 1 :]]


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
