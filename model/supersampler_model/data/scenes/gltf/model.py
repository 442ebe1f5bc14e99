"""Loads a glTF file as instances for scenes: nodes, keyframe animation, primitives and skins."""

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from supersampler_model.data.scenes import scene as scenes
from supersampler_model.data.scenes.gltf.document import Document, Integers, Json, MalformedError, at, reading
from supersampler_model.data.scenes.gltf.materials import Coordinates, Materials

MAX_NODES = 1 << 18
MAX_PARTS = 1 << 16  # primitives on nodes
MAX_VERTICES = 1 << 28  # of all primitives on nodes: nodes may share a mesh
_REST = {"translation": (0.0, 0.0, 0.0), "rotation": (0.0, 0.0, 0.0, 1.0), "scale": (1.0, 1.0, 1.0)}
_INTERPOLATIONS = ("LINEAR", "STEP", "CUBICSPLINE")
_TRIANGLES, _STRIP, _FAN = 4, 5, 6
_MODES = {0: "points", 1: "lines", 2: "a line loop", 3: "a line strip"}


@dataclass(frozen=True, slots=True, eq=False)
class Channel:
    """Keyframes of one property of one node.

    For CUBICSPLINE, `values` are the tangent towards each keyframe, its value, and the tangent from it, per
    second. Other interpolations have tangents of 0.
    """

    node: int  # index in the file
    path: str  # "translation", "rotation" or "scale"
    interpolation: str  # LINEAR, STEP or CUBICSPLINE
    times: scenes.Values  # (k,) seconds, ascending
    values: scenes.Values  # (k, 3, width)

    def at(self, time: float) -> scenes.Values:
        """Return the property (width,); outside the keyframes, the value of the nearest keyframe."""
        before = int(np.searchsorted(self.times, time, side="right")) - 1
        if before < 0 or before + 1 == len(self.times):
            return self._normalized(self.values[max(before, 0), 1])
        start, end = self.values[before, 1], self.values[before + 1, 1]
        span = self.times[before + 1] - self.times[before]
        s = (time - self.times[before]) / span
        if self.interpolation == "STEP":
            return self._normalized(start)
        if self.interpolation == "CUBICSPLINE":
            leaving, arriving = span * self.values[before, 2], span * self.values[before + 1, 0]
            a, b = 2 * s**3 - 3 * s**2 + 1, s**3 - 2 * s**2 + s
            c, d = s**3 - s**2, 3 * s**2 - 2 * s**3
            return self._normalized(np.asarray(a * start + b * leaving + c * arriving + d * end))
        return _slerp(start, end, s) if self.path == "rotation" else np.asarray((1.0 - s) * start + s * end)

    def _normalized(self, value: scenes.Values) -> scenes.Values:
        return value / np.linalg.norm(value) if self.path == "rotation" else value


def _slerp(start: scenes.Values, end: scenes.Values, fraction: float) -> scenes.Values:
    """Interpolate two rotations spherically, along the shorter arc."""
    start, end = start / np.linalg.norm(start), end / np.linalg.norm(end)
    cosine = float(start @ end)
    if cosine < 0.0:
        end, cosine = -end, -cosine
    if cosine > 0.9999:  # the angle is too small to divide by; linear interpolation is exact enough
        mixed = (1.0 - fraction) * start + fraction * end
        return np.asarray(mixed / np.linalg.norm(mixed))
    angle = np.arccos(cosine)
    mixed = np.sin((1.0 - fraction) * angle) * start + np.sin(fraction * angle) * end
    return np.asarray(mixed / np.sin(angle))


class AnimationClip(NamedTuple):
    """One animation of a file."""

    duration: float  # time of the last keyframe, seconds
    channels: tuple[Channel, ...]


class Node(NamedTuple):
    """A node at rest, placed by a matrix or by translation (3,), rotation (4,) x, y, z, w and scale (3,)."""

    number: int  # index in the file
    parent: int | None  # None for a root
    matrix: scenes.Matrix | None
    rest: dict[str, scenes.Values]


class Binding(NamedTuple):
    """The joints that move a skinned mesh."""

    joints: Integers  # (j,) nodes
    inverse_bind: scenes.Matrices  # (j, 4, 4) mesh to joint, in the bind pose


class PlacedPrimitive(NamedTuple):
    """One primitive of one node."""

    mesh: scenes.Mesh
    material: scenes.Material
    node: int
    binding: Binding | None  # None for a rigid mesh

    def palette(self, found: dict[int, scenes.Matrix]) -> scenes.Matrices | None:
        """Return the matrix of each joint: bind pose to posed, in the scene's space."""
        if self.binding is None:
            return None
        return np.stack([found[int(joint)] for joint in self.binding.joints]) @ self.binding.inverse_bind

    def vertices(self, found: dict[int, scenes.Matrix]) -> scenes.Values:
        """Return (n, 3) vertices in the scene's space."""
        local = np.concatenate([self.mesh.positions, np.ones((len(self.mesh.positions), 1))], axis=1)
        palette, skin = self.palette(found), self.mesh.skin
        if palette is None or skin is None:
            return np.asarray((local @ found[self.node].T)[:, :3])
        moved = np.einsum("nk,nkij,nj->ni", skin.weights, palette[skin.joints], local, optimize=True)
        return np.asarray(moved[:, :3])

    def box(self, found: dict[int, scenes.Matrix]) -> tuple[scenes.Values, scenes.Values]:
        """Return the lowest and the highest corner of the vertices, (3,) each."""
        points = self.vertices(found)
        return points.min(axis=0), points.max(axis=0)


class GltfScene:
    """The content of a .glb or .gltf file.

    Lights, cameras, vertex colours and wrap modes (textures repeat) are ignored. Meshes, materials and
    textures are loaded once and shared by frames.

    Attributes:
        path: the file.
        clips: its animations.
        bounds: (2, 3) lowest and highest corner of the bounding box at rest.
        digest: SHA-256, in hexadecimal, of the file and of the files beside it that it refers to.
    """

    def __init__(self, path: Path | str) -> None:
        """Read the whole file.

        Raises:
            GltfError: it is broken or not supported; names the file, the primitive and the reason.
        """
        self.path = Path(path)
        with reading(self.path):
            document = Document(self.path)
            self._nodes = _nodes(document)
            self._parts = tuple(islice(_parts(document, self._nodes), MAX_PARTS + 1))
            if len(self._parts) > MAX_PARTS:
                raise MalformedError(f"its nodes show more than {MAX_PARTS} primitives")
            if not self._parts:
                raise MalformedError("it shows no object")
            self.clips = _clips(document)
            found = _matrices(self._nodes, None, 0.0)
            if (count := sum(len(part.mesh.positions) for part in self._parts)) > MAX_VERTICES:
                raise MalformedError(f"its nodes show {count} vertices; want at most {MAX_VERTICES}")
            # one at a time: few bytes may show many vertices
            boxes = [part.box(found) for part in self._parts]
            low, high = zip(*boxes, strict=True)
            self.bounds: scenes.Values = np.stack([np.min(low, axis=0), np.max(high, axis=0)])
            self.digest = document.digest()

    def instances(
        self,
        time: float,
        time_before: float,
        transform: scenes.Matrix,
        transform_before: scenes.Matrix | None = None,
        *,
        clip: int = 0,
        emission: float = 1.0,
    ) -> tuple[scenes.Instance, ...]:
        """Return the instances of the file at a time in seconds into a clip, clamped to its length.

        `transform` (4, 4) maps the file's space to the world; `transform_before` None means no motion.
        `emission` multiplies the light of emissive materials. A file without clips does not change.
        """
        transforms = transform, transform if transform_before is None else transform_before
        chosen = self.clips[clip] if self.clips else None
        now = _matrices(self._nodes, chosen, time)
        before = now if time_before == time else _matrices(self._nodes, chosen, time_before)
        instances = []
        for part in self._parts:
            models = transforms
            if part.binding is None:
                models = transforms[0] @ now[part.node], transforms[1] @ before[part.node]
            instances.append(
                scenes.Instance(
                    mesh=part.mesh, material=part.material, model=models[0], model_before=models[1],
                    palette=part.palette(now), palette_before=part.palette(before), emission=emission,
                )
            )  # fmt: skip
        return tuple(instances)


def _clips(document: Document) -> tuple[AnimationClip, ...]:
    """Read the animations of a file."""
    clips = []
    for index in range(len(document.content.get("animations", []))):
        with at(document.name("animations", index)):
            content = document.item("animations", index)
            read = [_channel(document, content, number) for number in range(len(content["channels"]))]
            channels = tuple(channel for channel in read if channel is not None)
            duration = max((float(channel.times[-1]) for channel in channels), default=0.0)
            clips.append(AnimationClip(duration, channels))
    return tuple(clips)


def _channel(document: Document, content: Json, number: int) -> Channel | None:
    """Read a channel; None if it moves no node, or the weights of morph targets, which are not supported."""
    channel = content["channels"][number]
    target, sampler = channel["target"], content["samplers"][channel["sampler"]]
    path = target["path"]
    if "node" not in target or path == "weights":
        return None
    with at(f"channel {number}"):
        node, interpolation = target["node"], sampler.get("interpolation", "LINEAR")
        if "matrix" in document.item("nodes", node):
            raise MalformedError(f"it moves {document.name('nodes', node)}, which is placed by a matrix")
        if path not in _REST or interpolation not in _INTERPOLATIONS:
            kinds = f"one of {', '.join(_INTERPOLATIONS)} of {', '.join(_REST)}"
            raise MalformedError(f"it is {interpolation!r} of {path!r}; want {kinds}")
        times = document.floats(sampler["input"], "SCALAR")[:, 0]
        if (np.diff(times) <= 0.0).any():
            raise MalformedError("its times do not ascend")
        count, width = len(times), len(_REST[path])
        values = document.floats(sampler["output"], f"VEC{width}")
        cubic = interpolation == "CUBICSPLINE"
        if len(values) != (3 * count if cubic else count):
            raise MalformedError(f"it has {count} times and {len(values)} values")
        if cubic:
            triples = values.reshape(count, 3, width)
        else:
            triples = np.stack([np.zeros_like(values), values, np.zeros_like(values)], axis=1)
        if path == "rotation" and np.linalg.norm(triples[:, 1], axis=1).min() < 1e-3:
            raise MalformedError("one of its rotations is 0")
        return Channel(node, path, interpolation, times, triples)


def _nodes(document: Document) -> tuple[Node, ...]:
    """Return the nodes of the file's scene, parents before their children."""
    content = document.content
    if "scenes" in content:
        roots = document.item("scenes", content.get("scene", 0)).get("nodes", [])
    else:
        children = {child for node in content.get("nodes", []) for child in node.get("children", [])}
        roots = [index for index in range(len(content.get("nodes", []))) if index not in children]
    nodes: dict[int, Node] = {}
    waiting: deque[tuple[int, int | None]] = deque((root, None) for root in roots)
    while waiting:
        index, parent = waiting.popleft()
        if len(nodes) == MAX_NODES:
            raise MalformedError(f"its scene has more than {MAX_NODES} nodes")
        item = document.item("nodes", index)
        with at(document.name("nodes", index)):
            if index in nodes:
                raise MalformedError("it is a child of two nodes, or of itself")
            nodes[index] = _node(item, index, parent)
            waiting += [(child, index) for child in item.get("children", [])]
    return tuple(nodes.values())


def _node(item: Json, index: int, parent: int | None) -> Node:
    matrix = _numbers(item, "matrix", 16).reshape(4, 4).T if "matrix" in item else None  # column by column
    if matrix is not None and not np.allclose(matrix[3], (0.0, 0.0, 0.0, 1.0)):
        raise MalformedError(f"its matrix ends in the row {matrix[3].tolist()}; want [0, 0, 0, 1]")
    rest = {name: _numbers(item, name, len(value), value) for name, value in _REST.items()}
    length = float(np.linalg.norm(rest["rotation"]))
    if length < 1e-3:
        raise MalformedError("its rotation is 0")
    return Node(index, parent, matrix, {**rest, "rotation": rest["rotation"] / length})


def _numbers(item: Json, name: str, count: int, default: Any = None) -> scenes.Values:
    values = np.asarray(item.get(name, default), np.float64)
    if values.shape != (count,) or not np.isfinite(values).all():
        raise MalformedError(f"its {name} is {item.get(name)!r}; want {count} finite numbers")
    return values


def _matrices(nodes: tuple[Node, ...], clip: AnimationClip | None, time: float) -> dict[int, scenes.Matrix]:
    """Return the matrix from each node to the scene's space, `time` seconds into a clip, or at rest."""
    moved: dict[int, dict[str, scenes.Values]] = {}
    for channel in clip.channels if clip else ():
        moved.setdefault(channel.node, {})[channel.path] = channel.at(time)
    found: dict[int, scenes.Matrix] = {}
    for node in nodes:
        local = node.matrix
        if local is None:
            local = _matrix_of(**{**node.rest, **moved.get(node.number, {})})
        found[node.number] = local if node.parent is None else found[node.parent] @ local
    return found


def _matrix_of(translation: scenes.Values, rotation: scenes.Values, scale: scenes.Values) -> scenes.Matrix:
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


def _parts(document: Document, nodes: tuple[Node, ...]) -> Iterator[PlacedPrimitive]:
    """Yield the visible primitives of all nodes; a mesh shared by several nodes is read once."""
    materials = Materials(document)
    read: dict[Any, tuple[scenes.Mesh, Integers | None]] = {}
    bindings: dict[Any, Binding] = {}
    for node in nodes:
        item = document.item("nodes", node.number)
        if "mesh" not in item:
            continue
        mesh, skin = item["mesh"], item.get("skin")
        if skin is not None and skin not in bindings:
            bindings[skin] = _skin(document, skin, nodes)
        binding = None if skin is None else bindings[skin]
        for number, content in enumerate(document.item("meshes", mesh)["primitives"]):
            with at(f"{document.name('meshes', mesh)}, primitive {number}"):
                surface = materials.surface(content.get("material"))
                if surface.material is None:
                    continue
                key = mesh, number, skin
                if key not in read:
                    count = None if binding is None else len(binding.joints)
                    read[key] = _primitive(document, content, surface.coordinates, count)
                shape, used = read[key]
                if used is not None and len(used) > scenes.MAX_JOINTS:
                    raise MalformedError(
                        f"{len(used)} joints move it; at most {scenes.MAX_JOINTS} are supported"
                    )
                own = binding and Binding(binding.joints[used], binding.inverse_bind[used])
                yield PlacedPrimitive(shape, surface.material, node.number, own)


def _skin(document: Document, index: Any, nodes: tuple[Node, ...]) -> Binding:
    content = document.item("skins", index)
    with at(document.name("skins", index)):
        joints = np.asarray(content["joints"], np.int64)
        missing = set(joints.tolist()) - {node.number for node in nodes}
        if joints.ndim != 1 or len(joints) == 0 or missing:
            raise MalformedError(f"its joints {sorted(missing)} are not in the scene")
        if "inverseBindMatrices" not in content:
            return Binding(joints, np.tile(np.eye(4), (len(joints), 1, 1)))
        flat = document.floats(content["inverseBindMatrices"], "MAT4")
        if len(flat) < len(joints):
            raise MalformedError(f"it has {len(joints)} joints and {len(flat)} inverse bind matrices")
        matrices = flat[: len(joints)].reshape(-1, 4, 4).transpose(0, 2, 1).copy()  # stored column by column
        if not np.allclose(matrices[:, 3], (0.0, 0.0, 0.0, 1.0)):
            raise MalformedError("the last row of an inverse bind matrix is not [0, 0, 0, 1]")
        return Binding(joints, matrices)


def _primitive(
    document: Document, content: Json, coordinates: Coordinates | None, joints: int | None
) -> tuple[scenes.Mesh, Integers | None]:
    """Return a primitive's mesh, and the skin's joints that move it; None if it is rigid.

    `coordinates` belong to the material's textures; `joints` is the number of joints of the skin.
    """
    if content.get("targets"):
        raise MalformedError("it has morph targets, which are not supported")
    attributes = content["attributes"]
    vertices: dict[str, Any] = {"position": document.floats(attributes["POSITION"], "VEC3")}
    count = len(vertices["position"])
    if "NORMAL" in attributes:
        vertices["normal"] = document.floats(attributes["NORMAL"], "VEC3")
    if "TANGENT" in attributes and "NORMAL" in attributes:  # tangents fit the file's own normals only
        vertices["tangent"] = document.floats(attributes["TANGENT"], "VEC4")
    vertices["uv"] = _uv(document, attributes, coordinates, count)
    palette = None
    if joints is not None:
        palette, vertices["joints"], vertices["weights"] = _weights(document, attributes, joints)
    for name, values in vertices.items():
        if len(values) != count:
            raise MalformedError(f"it has {count} positions and {len(values)} of {name}")
    return _mesh(vertices, _triangles(document, content, count)), palette


def _triangles(document: Document, content: Json, count: int) -> Integers:
    """Return (m, 3) vertices of triangles."""
    mode = content.get("mode", _TRIANGLES)
    if mode not in (_TRIANGLES, _STRIP, _FAN):
        kind = _MODES.get(mode, f"mode {mode!r}")
        raise MalformedError(f"it is made of {kind}; only triangles are supported")
    indexed = "indices" in content
    corners = document.integers(content["indices"], "SCALAR")[:, 0] if indexed else np.arange(count)
    if corners.max() >= count:
        raise MalformedError(f"its indices refer to vertex {int(corners.max())} of {count}")
    if mode == _TRIANGLES:
        if len(corners) % 3:
            raise MalformedError(f"it has {len(corners)} corners, not a multiple of 3")
        return corners.reshape(-1, 3)
    if len(corners) < 3:
        raise MalformedError(f"it has {len(corners)} corners, too few for a triangle")
    a, b, c = corners[:-2], corners[1:-1], corners[2:]
    if mode == _FAN:
        return np.stack([b, c, np.full_like(b, corners[0])], axis=1)
    odd = np.arange(len(a)) % 2 == 1  # every other triangle of a strip runs the other way
    return np.stack([a, np.where(odd, c, b), np.where(odd, b, c)], axis=1)


def _uv(document: Document, attributes: Json, coordinates: Coordinates | None, count: int) -> scenes.Values:
    name = f"TEXCOORD_{coordinates.of if coordinates else 0}"
    if name not in attributes:
        if coordinates is not None:
            raise MalformedError(f"its material has textures, and it has no {name}")
        return np.zeros((count, 2))
    uv = document.floats(attributes[name], "VEC2")
    return uv if coordinates is None else uv * coordinates.scale + coordinates.offset


def _weights(document: Document, attributes: Json, joints: int) -> tuple[Integers, Integers, scenes.Values]:
    """Return the skin's joints in use, and each vertex's four indices into these, with their weights."""
    moved_by = document.integers(attributes["JOINTS_0"], "VEC4")
    weights = document.floats(attributes["WEIGHTS_0"], "VEC4")
    if len(weights) != len(moved_by):
        raise MalformedError(f"it has {len(moved_by)} JOINTS_0 and {len(weights)} WEIGHTS_0")
    sums = weights.sum(axis=1, keepdims=True)
    if weights.min() < 0.0 or sums.min() < 1e-3:
        vertex = int(weights.min(axis=1).argmin())
        raise MalformedError(f"its WEIGHTS_0 are negative or all 0 at vertex {vertex}")
    heaviest = moved_by[np.arange(len(weights)), weights.argmax(axis=1)][:, None]
    moved_by = np.where(weights > 0.0, moved_by, heaviest)
    if moved_by.max() >= joints:
        raise MalformedError(f"its JOINTS_0 refer to joint {int(moved_by.max())} of {joints}")
    used, renumbered = np.unique(moved_by, return_inverse=True)
    return used, renumbered.reshape(moved_by.shape), weights / sums


def _mesh(vertices: dict[str, Any], indices: Integers) -> scenes.Mesh:
    if "normal" not in vertices:  # flat shading, by the specification
        vertices = {name: values[indices.ravel()] for name, values in vertices.items()}
        indices = np.arange(indices.size).reshape(-1, 3)
        vertices["normal"] = np.repeat(_face_normals(vertices["position"], indices), 3, axis=0)
    positions, uv = (np.ascontiguousarray(vertices[name], np.float32) for name in ("position", "uv"))
    normals = _unit(vertices["normal"], vertices["position"], indices).astype(np.float32)
    faces = np.ascontiguousarray(indices, np.uint32)
    tangents = scenes.tangents_of(positions, normals, uv, faces)
    if "tangent" in vertices:  # the file's own, except where they are 0
        stored = vertices["tangent"]
        lengths = np.linalg.norm(stored[:, :3], axis=1, keepdims=True)
        usable = (lengths > 1e-6) & (np.abs(stored[:, 3:]) > 0.5)
        unit = stored[:, :3] / np.where(usable, lengths, 1.0)
        own = np.concatenate([unit, np.sign(stored[:, 3:])], axis=1)
        tangents = np.where(usable, own, tangents).astype(np.float32)
    skin = None
    if "joints" in vertices:
        joints = np.ascontiguousarray(vertices["joints"], np.uint16)
        skin = scenes.Skin(joints=joints, weights=np.ascontiguousarray(vertices["weights"], np.float32))
    return scenes.Mesh(
        positions=positions, normals=normals, uv=uv, tangents=tangents, indices=faces, skin=skin
    )


def _face_normals(positions: scenes.Values, indices: Integers) -> scenes.Values:
    """Return (m, 3) normals of triangles, as long as twice their area."""
    a, b, c = (positions[corner] for corner in indices.T)
    return np.asarray(np.cross(b - a, c - a))


def _unit(normals: scenes.Values, positions: scenes.Values, indices: Integers) -> scenes.Values:
    """Return normals of unit length; normals of 0 are derived from the triangles around, or point up."""
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    if lengths.min() < 1e-6:
        around = np.zeros_like(positions)
        np.add.at(around, indices.ravel(), np.repeat(_face_normals(positions, indices), 3, axis=0))
        normals = np.where(lengths < 1e-6, around, normals)
        lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    return np.where(lengths > 0.0, normals / np.where(lengths > 0.0, lengths, 1.0), (0.0, 1.0, 0.0))
