"""Join slices of two axes, which the exporter writes one after the other, into one operator."""

from collections import Counter
from itertools import count

import numpy as np
import onnx
from numpy.typing import NDArray
from onnx import helper, numpy_helper

AXIS, STEP = 3, 4
"""Inputs of a Slice, after the image, starts and ends."""
Constants = dict[str, NDArray[np.generic]]


def joined_slices(model: onnx.ModelProto) -> onnx.ModelProto:
    """Join each Slice that only another Slice reads with that one; in place. Both have a step of 1.

    Constants that nothing reads then remain; `simplified_gathers` removes them.
    """
    graph = model.graph
    constants = {tensor.name: numpy_helper.to_array(tensor) for tensor in graph.initializer}
    readers = Counter(name for node in graph.node for name in node.input)
    readers.update(value.name for value in graph.output)
    makers = {node.output[0]: node for node in graph.node if node.op_type == "Slice"}
    joint = _Joint(graph, constants)
    nodes: list[onnx.NodeProto] = []
    for node in graph.node:
        first = makers.get(node.input[0]) if node.op_type == "Slice" else None
        if first is not None and readers[first.output[0]] == 1 and _independent(first, node, constants):
            nodes.remove(first)
            parts = [joint.of(a, b) for a, b in zip(first.input[1:], node.input[1:], strict=True)]
            nodes += joint.taken()
            del node.input[:]
            node.input.extend([first.input[0], *parts])
        nodes.append(node)
    del graph.node[:]
    graph.node.extend(nodes)
    return model


def _independent(first: onnx.NodeProto, second: onnx.NodeProto, constants: Constants) -> bool:
    """Whether two slices have steps of 1 and constant axes that differ."""
    names = [node.input[place] for node in (first, second) for place in (AXIS, STEP)]
    if not all(name in constants for name in names):
        return False
    axis, step, other_axis, other_step = (constants[name] for name in names)
    return bool((step == 1).all() and (other_step == 1).all() and not np.intersect1d(axis, other_axis).size)


class _Joint:
    """Makes joint inputs: constants of constants, else the result of a Concat; each once."""

    def __init__(self, graph: onnx.GraphProto, constants: Constants) -> None:
        self._graph, self._constants = graph, constants
        self._made: dict[tuple[str, str], str] = {}
        self._nodes: list[onnx.NodeProto] = []
        self._numbers = count()

    def of(self, first: str, second: str) -> str:
        """Return the name of both one after the other."""
        if (first, second) not in self._made:
            self._made[first, second] = self._make(first, second)
        return self._made[first, second]

    def taken(self) -> list[onnx.NodeProto]:
        """Return the nodes that were made since the last call."""
        nodes, self._nodes = self._nodes, []
        return nodes

    def _make(self, first: str, second: str) -> str:
        name = f"slices_{next(self._numbers)}"
        if first in self._constants and second in self._constants:
            both = np.concatenate([self._constants[first], self._constants[second]])
            self._graph.initializer.append(numpy_helper.from_array(both, name))
        else:
            self._nodes.append(
                helper.make_node("Concat", [first, second], [name], name=f"node_{name}", axis=0)
            )
        return name
