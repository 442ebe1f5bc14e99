"""Loads a glTF file as instances for scenes."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from supersampler_model.data.checks import check_matrices
from supersampler_model.data.errors import SceneError
from supersampler_model.data.scenes.gltf.accessors import Integers, floats
from supersampler_model.data.scenes.gltf.animation import clips_of
from supersampler_model.data.scenes.gltf.document import Document, open_document
from supersampler_model.data.scenes.gltf.errors import MalformedError, at, reading
from supersampler_model.data.scenes.gltf.materials import Materials
from supersampler_model.data.scenes.gltf.meshes import Primitive, primitive_of
from supersampler_model.data.scenes.gltf.nodes import Node, nodes_of, places
from supersampler_model.data.scenes.mesh import Mesh
from supersampler_model.data.scenes.scene import MAX_JOINTS, Instance, Material
from supersampler_model.data.values import Matrices, Matrix, Values

MAX_PARTS = 1 << 16  # primitives on nodes


@dataclass(frozen=True, slots=True, eq=False)
class Part:
    """One primitive of one node.

    Attributes:
        node: that it hangs on.
        joints: (j,) nodes that move it; None of a rigid one.
        inverse_bind: (j, 4, 4) mesh to joint, in the pose in which it was bound.
    """

    mesh: Mesh
    material: Material
    node: int
    joints: Integers | None
    inverse_bind: Matrices | None

    def palette(self, found: dict[int, Matrix]) -> Matrices | None:
        """Return mesh to posed, in the scene's space, for each joint."""
        if self.joints is None or self.inverse_bind is None:
            return None
        return np.stack([found[int(joint)] for joint in self.joints]) @ self.inverse_bind


class GltfScene:
    """The content of a .glb or .gltf file.

    Lights, cameras, vertex colours and wrap modes (textures repeat) are ignored. Meshes, materials and
    textures are loaded once and shared by frames.

    >>> model = GltfScene("chair.glb")
    >>> model.instances(0.5, 0.5 - 1 / 30, np.eye(4))

    Attributes:
        path: the file.
        clips: its animations.
        bounds: (2, 3) least and greatest corner of a box around it at rest.
        digest: SHA-256, in hexadecimal, of the file and of those beside it that it refers to.
    """

    def __init__(self, path: Path | str) -> None:
        """Read all of the file.

        Raises:
            GltfError: it is broken or not supported; names the file, the primitive and the reason.
        """
        self.path = Path(path)
        with reading(self.path):
            document = open_document(self.path)
            self._nodes = nodes_of(document)
            self._parts = tuple(islice(_parts(document, self._nodes), MAX_PARTS + 1))
            if len(self._parts) > MAX_PARTS:
                raise MalformedError(f"its nodes show more than {MAX_PARTS} primitives")
            if not self._parts:
                raise MalformedError("nothing in it is to be seen")
            self.clips = clips_of(document)
            self.bounds = self._bounds()
            self.digest = document.digest()

    def instances(
        self,
        time: float,
        time_before: float,
        transform: Matrix,
        transform_before: Matrix | None = None,
        *,
        clip: int = 0,
        emission: float = 1.0,
    ) -> tuple[Instance, ...]:
        """Return the instances of the file at a time.

        Args:
            time: seconds into the clip; before its start and after its end it stands still.
            time_before: the same one frame ago.
            transform: (4, 4) the file's space to the world.
            transform_before: the same one frame ago; None: no motion.
            clip: index in `clips`; a file without any stays as it is.
            emission: multiplies what its materials emit.

        Raises:
            SceneError: there is no such clip, or a transform is no matrix.
        """
        if self.clips and not 0 <= clip < len(self.clips):
            raise SceneError("clip", got=clip, want=f"0 to {len(self.clips) - 1}, as {self.path} has")
        transforms = transform, transform if transform_before is None else transform_before
        for matrix in transforms:
            check_matrices("transform", matrix, (4, 4))
        chosen = self.clips[clip] if self.clips else None
        now = places(self._nodes, chosen, time)
        before = now if time_before == time else places(self._nodes, chosen, time_before)
        return tuple(_instance(part, (now, before), transforms, emission) for part in self._parts)

    def _bounds(self) -> Values:
        found = places(self._nodes, None, 0.0)
        points = np.concatenate([_vertices(part, found) for part in self._parts])
        return np.stack([points.min(axis=0), points.max(axis=0)])


def _instance(
    part: Part,
    found: tuple[dict[int, Matrix], dict[int, Matrix]],
    transforms: tuple[Matrix, Matrix],
    emission: float,
) -> Instance:
    models = transforms
    if part.joints is None:
        models = transforms[0] @ found[0][part.node], transforms[1] @ found[1][part.node]
    return Instance(
        mesh=part.mesh,
        material=part.material,
        model=models[0],
        model_before=models[1],
        palette=part.palette(found[0]),
        palette_before=part.palette(found[1]),
        emission=emission,
    )


def _vertices(part: Part, found: dict[int, Matrix]) -> Values:
    """Return (n, 3) vertices in the scene's space."""
    local = np.concatenate([part.mesh.positions, np.ones((len(part.mesh.positions), 1))], axis=1)
    palette, skin = part.palette(found), part.mesh.skin
    if palette is None or skin is None:
        return np.asarray((local @ found[part.node].T)[:, :3])
    moved = np.einsum("nk,nkij,nj->ni", skin.weights, palette[skin.joints], local, optimize=True)
    return np.asarray(moved[:, :3])


def _parts(document: Document, nodes: tuple[Node, ...]) -> Iterator[Part]:
    materials = Materials(document)
    made: dict[Any, Primitive] = {}
    for node in nodes:
        item = document.item("nodes", node.index)
        if "mesh" not in item:
            continue
        skin = item.get("skin")
        joints, inverse_bind = (None, None) if skin is None else _skin(document, skin, nodes)
        mesh = item["mesh"]
        for number, content in enumerate(document.item("meshes", mesh)["primitives"]):
            with at(f"{document.name('meshes', mesh)}, primitive {number}"):
                surface = materials.surface(content.get("material"))
                if surface.material is None:
                    continue
                key = mesh, number, skin
                if key not in made:
                    count = None if joints is None else len(joints)
                    made[key] = primitive_of(document, content, surface.coordinates, count)
                used = made[key].joints
                if joints is None or inverse_bind is None or used is None:
                    yield Part(made[key].mesh, surface.material, node.index, None, None)
                    continue
                if len(used) > MAX_JOINTS:
                    raise MalformedError(f"{len(used)} joints move it; at most {MAX_JOINTS} are supported")
                yield Part(made[key].mesh, surface.material, node.index, joints[used], inverse_bind[used])


def _skin(document: Document, index: Any, nodes: tuple[Node, ...]) -> tuple[Integers, Matrices]:
    """Return a skin's joints (j,), as nodes, and their inverse bind matrices (j, 4, 4)."""
    content = document.item("skins", index)
    with at(document.name("skins", index)):
        joints = np.asarray(content["joints"], np.int64)
        missing = set(joints.tolist()) - {node.index for node in nodes}
        if joints.ndim != 1 or len(joints) == 0 or missing:
            raise MalformedError(f"its joints {sorted(missing)} are not in the scene")
        if "inverseBindMatrices" not in content:
            return joints, np.tile(np.eye(4), (len(joints), 1, 1))
        flat = floats(document, content["inverseBindMatrices"], "MAT4")
        if len(flat) < len(joints):
            raise MalformedError(f"it has {len(joints)} joints and {len(flat)} inverse bind matrices")
        matrices = flat[: len(joints)].reshape(-1, 4, 4).transpose(0, 2, 1).copy()  # stored column by column
        check_matrices("inverse bind matrix", matrices, (len(joints), 4, 4))
        return joints, matrices
