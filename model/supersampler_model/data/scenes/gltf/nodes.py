"""The node hierarchy of a scene, and the nodes' matrices."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from supersampler_model.data.scenes.gltf.animation import Clip
from supersampler_model.data.scenes.gltf.document import Document, Json
from supersampler_model.data.scenes.gltf.errors import MalformedError, at
from supersampler_model.data.values import Matrix, Values

_REST = {"translation": (0.0, 0.0, 0.0), "rotation": (0.0, 0.0, 0.0, 1.0), "scale": (1.0, 1.0, 1.0)}


@dataclass(frozen=True, slots=True, eq=False)
class Node:
    """A node at rest.

    Attributes:
        index: in the file.
        parent: index in the file; None of a root.
        matrix: of a node that is placed by one, else None.
        rest: translation (3,), rotation (4,) as x, y, z, w, and scale (3,), by name.
    """

    index: int
    parent: int | None
    matrix: Matrix | None
    rest: dict[str, Values]


def nodes_of(document: Document) -> tuple[Node, ...]:
    """Return the nodes of the file's scene, parents before their children."""
    content = document.content
    if "scenes" in content:
        roots = document.item("scenes", content.get("scene", 0)).get("nodes", [])
    else:
        children = {child for node in content.get("nodes", []) for child in node.get("children", [])}
        roots = [index for index in range(len(content.get("nodes", []))) if index not in children]
    nodes: dict[int, Node] = {}
    waiting: list[tuple[int, int | None]] = [(root, None) for root in roots]
    while waiting:
        index, parent = waiting.pop(0)
        item = document.item("nodes", index)
        with at(document.name("nodes", index)):
            if index in nodes:
                raise MalformedError("it hangs on two nodes, or on itself")
            nodes[index] = _node(item, index, parent)
            waiting += [(child, index) for child in item.get("children", [])]
    return tuple(nodes.values())


def places(nodes: tuple[Node, ...], clip: Clip | None, time: float) -> dict[int, Matrix]:
    """Return the matrix of each node to the scene's space, `time` seconds into a clip, or at rest."""
    moved: dict[int, dict[str, Values]] = {}
    for channel in clip.channels if clip else ():
        moved.setdefault(channel.node, {})[channel.path] = channel.at(time)
    found: dict[int, Matrix] = {}
    for node in nodes:
        local = (
            node.matrix
            if node.matrix is not None
            else matrix_of(**{**node.rest, **moved.get(node.index, {})})
        )
        found[node.index] = local if node.parent is None else found[node.parent] @ local
    return found


def matrix_of(translation: Values, rotation: Values, scale: Values) -> Matrix:
    """Return translation @ rotation @ scale; the rotation is a unit quaternion x, y, z, w."""
    x, y, z, w = (float(value) for value in rotation)
    turn = np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ])  # fmt: skip
    matrix = np.eye(4)
    matrix[:3, :3] = turn * np.asarray(scale)
    matrix[:3, 3] = translation
    return matrix


def _node(item: Json, index: int, parent: int | None) -> Node:
    matrix = _numbers(item, "matrix", 16).reshape(4, 4).T if "matrix" in item else None  # column by column
    if matrix is not None and not np.allclose(matrix[3], (0.0, 0.0, 0.0, 1.0)):
        raise MalformedError(f"its matrix ends in the row {matrix[3].tolist()}; want [0, 0, 0, 1]")
    rest = {name: _numbers(item, name, len(value), value) for name, value in _REST.items()}
    length = float(np.linalg.norm(rest["rotation"]))
    if length < 1e-3:
        raise MalformedError("its rotation is 0")
    rest["rotation"] = rest["rotation"] / length
    return Node(index, parent, matrix, rest)


def _numbers(item: Json, name: str, count: int, default: Any = None) -> Values:
    values = np.asarray(item.get(name, default), np.float64)
    if values.shape != (count,) or not np.isfinite(values).all():
        raise MalformedError(f"its {name} is {item.get(name)!r}; want {count} finite numbers")
    return values
