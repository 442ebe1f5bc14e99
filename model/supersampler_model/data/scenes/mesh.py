"""Triangle meshes with normals, tangents, texture coordinates and skins."""

from dataclasses import dataclass

import numpy as np

from supersampler_model.data.checks import check_array
from supersampler_model.data.errors import SceneError
from supersampler_model.data.values import Indices, Joints, Points


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Skin:
    """The joints that move each vertex.

    Attributes:
        joints: (n, 4) uint16, indices into the instance's palette.
        weights: (n, 4) float32 that sum to 1.
    """

    joints: Joints
    weights: Points

    def __post_init__(self) -> None:
        check_array("skin.joints", self.joints, (None, 4), np.uint16)
        check_array("skin.weights", self.weights, (len(self.joints), 4), np.float32)
        if np.abs(self.weights.sum(axis=1) - 1.0).max() > 1e-3:
            raise SceneError("skin.weights", got="of another sum in places", want="a sum of 1 at each vertex")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False, weakref_slot=True)
class Mesh:
    """Triangles; counter-clockwise ones face the viewer.

    Attributes:
        positions: (n, 3) float32, local.
        normals: (n, 3) float32, unit length.
        uv: (n, 2) float32, v downwards in the texture.
        tangents: (n, 4) float32: direction of u, unit length, and the sign of the bitangent
            cross(normal, tangent) w, which points to decreasing v. `tangents_of` derives them.
        indices: (m, 3) uint32.
        skin: None for a rigid mesh.
    """

    positions: Points
    normals: Points
    uv: Points
    tangents: Points
    indices: Indices
    skin: Skin | None = None

    def __post_init__(self) -> None:
        count = len(self.positions)
        check_array("mesh.positions", self.positions, (None, 3), np.float32)
        check_array("mesh.normals", self.normals, (count, 3), np.float32)
        check_array("mesh.uv", self.uv, (count, 2), np.float32)
        check_array("mesh.tangents", self.tangents, (count, 4), np.float32)
        check_array("mesh.indices", self.indices, (None, 3), np.uint32)
        if int(self.indices.max()) >= count:
            raise SceneError("mesh.indices", got=int(self.indices.max()), want=f"vertices below {count}")
        if self.skin is not None and len(self.skin.joints) != count:
            raise SceneError("mesh.skin", got=f"{len(self.skin.joints)} vertices", want=f"{count}")

    def center(self) -> Points:
        """Return the middle of the bounding box (3,), local."""
        return np.asarray((self.positions.min(axis=0) + self.positions.max(axis=0)) / 2.0)


def tangents_of(positions: Points, normals: Points, uv: Points, indices: Indices) -> Points:
    """Return (n, 4) tangents: the direction of u averaged over each vertex's triangles, and handedness.

    Where u does not vary, any direction along the surface is taken.
    """
    a, b, c = indices.T
    edge, other = positions[b] - positions[a], positions[c] - positions[a]
    along, beside = uv[b] - uv[a], uv[c] - uv[a]
    area = along[:, :1] * beside[:, 1:] - along[:, 1:] * beside[:, :1]
    flip = np.where(area < 0.0, -1.0, 1.0)  # weighted by area in the texture, which may be 0: no division
    of_u = flip * (edge * beside[:, 1:] - other * along[:, 1:])
    of_v = flip * (other * along[:, :1] - edge * beside[:, :1])
    u, v = np.zeros((2, *positions.shape), np.float64)
    for corner in (a, b, c):
        np.add.at(u, corner, of_u)
        np.add.at(v, corner, of_v)
    axis = np.eye(3)[np.abs(normals).argmin(axis=1)]  # far from the normal, used where u is degenerate
    u = np.where(np.linalg.norm(u, axis=1, keepdims=True) > 1e-12, u, np.cross(normals, axis))
    u -= normals * (u * normals).sum(axis=1, keepdims=True)
    u /= np.maximum(np.linalg.norm(u, axis=1, keepdims=True), 1e-12)
    # v grows downwards in the image while a normal map's green points up it: the bitangent opposes v.
    sign = np.where((np.cross(normals, u) * v).sum(axis=1, keepdims=True) > 0.0, -1.0, 1.0)
    return np.concatenate([u, sign], axis=1).astype(np.float32)
