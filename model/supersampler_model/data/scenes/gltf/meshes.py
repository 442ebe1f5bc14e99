"""Primitives of a glTF file as meshes."""

from typing import Any, NamedTuple

import numpy as np

from supersampler_model.data.scenes.gltf.accessors import Integers, floats, integers
from supersampler_model.data.scenes.gltf.document import Document, Json
from supersampler_model.data.scenes.gltf.errors import MalformedError
from supersampler_model.data.scenes.gltf.materials import Coordinates
from supersampler_model.data.scenes.mesh import Mesh, Skin, tangents_of
from supersampler_model.data.values import Values

_TRIANGLES, _STRIP, _FAN = 4, 5, 6
_MODES = {0: "points", 1: "lines", 2: "a line loop", 3: "a line strip"}


class Primitive(NamedTuple):
    """A mesh, and the skin's joints (n,) that its palette consists of; None if it is rigid."""

    mesh: Mesh
    joints: Integers | None


def primitive_of(
    document: Document, content: Json, coordinates: Coordinates | None, joints: int | None
) -> Primitive:
    """Read a primitive.

    Args:
        document: the file.
        content: the primitive's JSON.
        coordinates: of its material's textures.
        joints: how many the skin has; None for a rigid mesh, though it may have weights.
    """
    if content.get("targets"):
        raise MalformedError("it has morph targets, which are not supported")
    attributes = content["attributes"]
    vertices: dict[str, Any] = {"position": floats(document, attributes["POSITION"], "VEC3")}
    count = len(vertices["position"])
    if "NORMAL" in attributes:
        vertices["normal"] = floats(document, attributes["NORMAL"], "VEC3")
    if "TANGENT" in attributes and "NORMAL" in attributes:  # to other normals they would not fit
        vertices["tangent"] = floats(document, attributes["TANGENT"], "VEC4")
    vertices["uv"] = _uv(document, attributes, coordinates, count)
    palette = None
    if joints is not None:
        palette, vertices["joints"], vertices["weights"] = _skin(document, attributes, joints)
    for name, values in vertices.items():
        if len(values) != count:
            raise MalformedError(f"it has {count} positions and {len(values)} of {name}")
    return Primitive(_mesh(vertices, _triangles(document, content, count)), palette)


def _mesh(vertices: dict[str, Any], indices: Integers) -> Mesh:
    if "normal" not in vertices:  # glTF: such triangles are flat
        vertices = {name: values[indices.ravel()] for name, values in vertices.items()}
        indices = np.arange(indices.size).reshape(-1, 3)
        vertices["normal"] = np.repeat(_face_normals(vertices["position"], indices), 3, axis=0)
    positions, uv = (np.ascontiguousarray(vertices[name], np.float32) for name in ("position", "uv"))
    normals = _unit(vertices["normal"], vertices["position"], indices).astype(np.float32)
    faces = np.ascontiguousarray(indices, np.uint32)
    tangents = _tangents(vertices.get("tangent"), lambda: tangents_of(positions, normals, uv, faces))
    skin = None
    if "joints" in vertices:
        weights = np.ascontiguousarray(vertices["weights"], np.float32)
        skin = Skin(joints=np.ascontiguousarray(vertices["joints"], np.uint16), weights=weights)
    return Mesh(positions=positions, normals=normals, uv=uv, tangents=tangents, indices=faces, skin=skin)


def _triangles(document: Document, content: Json, count: int) -> Integers:
    """Return (m, 3) vertices of triangles."""
    mode = content.get("mode", _TRIANGLES)
    if mode not in (_TRIANGLES, _STRIP, _FAN):
        raise MalformedError(
            f"it is made of {_MODES.get(mode, f'mode {mode!r}')}; only triangles are supported"
        )
    given = "indices" in content
    corners = integers(document, content["indices"], "SCALAR")[:, 0] if given else np.arange(count)
    if corners.max() >= count:
        raise MalformedError(f"its indices refer to vertex {int(corners.max())} of {count}")
    if mode == _TRIANGLES:
        if len(corners) % 3:
            raise MalformedError(f"it has {len(corners)} corners, which are no whole triangles")
        return corners.reshape(-1, 3)
    if len(corners) < 3:
        raise MalformedError(f"it has {len(corners)} corners, which are no triangle")
    a, b, c = corners[:-2], corners[1:-1], corners[2:]
    if mode == _FAN:
        return np.stack([b, c, np.full_like(b, corners[0])], axis=1)
    odd = np.arange(len(a)) % 2 == 1  # every other triangle of a strip runs the other way
    return np.stack([a, np.where(odd, c, b), np.where(odd, b, c)], axis=1)


def _uv(document: Document, attributes: Json, coordinates: Coordinates | None, count: int) -> Values:
    name = f"TEXCOORD_{coordinates.of if coordinates else 0}"
    if name not in attributes:
        if coordinates is not None:
            raise MalformedError(f"its material has textures, and it has no {name}")
        return np.zeros((count, 2))
    uv = floats(document, attributes[name], "VEC2")
    return uv if coordinates is None else uv * coordinates.scale + coordinates.offset


def _skin(document: Document, attributes: Json, joints: int) -> tuple[Integers, Integers, Values]:
    """Return the skin's joints in use, and for each vertex four indices into these with their weights."""
    moved_by = integers(document, attributes["JOINTS_0"], "VEC4")
    weights = floats(document, attributes["WEIGHTS_0"], "VEC4")
    if len(weights) != len(moved_by):
        raise MalformedError(f"it has {len(moved_by)} JOINTS_0 and {len(weights)} WEIGHTS_0")
    sums = weights.sum(axis=1, keepdims=True)
    if weights.min() < 0.0 or sums.min() < 1e-3:
        raise MalformedError(
            f"its WEIGHTS_0 are negative or all 0 at vertex {int(weights.min(axis=1).argmin())}"
        )
    moved_by = np.where(
        weights > 0.0, moved_by, moved_by[np.arange(len(weights)), weights.argmax(axis=1)][:, None]
    )
    if moved_by.max() >= joints:
        raise MalformedError(f"its JOINTS_0 refer to joint {int(moved_by.max())} of {joints}")
    used, renumbered = np.unique(moved_by, return_inverse=True)
    return used, renumbered.reshape(moved_by.shape), weights / sums


def _face_normals(positions: Values, indices: Integers) -> Values:
    """Return (m, 3) normals of triangles, as long as twice their area."""
    a, b, c = (positions[corner] for corner in indices.T)
    return np.asarray(np.cross(b - a, c - a))


def _unit(normals: Values, positions: Values, indices: Integers) -> Values:
    """Return normals of unit length; where there is none, that of the triangles around, or else up."""
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    if lengths.min() < 1e-6:
        around = np.zeros_like(positions)
        np.add.at(around, indices.ravel(), np.repeat(_face_normals(positions, indices), 3, axis=0))
        normals = np.where(lengths < 1e-6, around, normals)
        lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    return np.where(lengths > 0.0, normals / np.where(lengths > 0.0, lengths, 1.0), (0.0, 1.0, 0.0))


def _tangents(given: Values | None, derived: Any) -> Any:
    """Return (n, 4) float32 tangents: those of the file, and derived ones where it has none."""
    if given is None:
        return derived()
    lengths = np.linalg.norm(given[:, :3], axis=1, keepdims=True)
    usable = (lengths > 1e-6) & (np.abs(given[:, 3:]) > 0.5)
    tangents = np.concatenate([given[:, :3] / np.where(usable, lengths, 1.0), np.sign(given[:, 3:])], axis=1)
    return (tangents if usable.all() else np.where(usable, tangents, derived())).astype(np.float32)
