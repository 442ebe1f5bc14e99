"""Procedural meshes, in metres. Texture coordinates are metres times `repeat`, unless stated otherwise."""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from supersampler_model.data.scenes.scene import Matrix, Mesh, Rng, Skin, Values, tangents_of

Floats = NDArray[np.floating[Any]]
Point = Sequence[float] | Values
Part = Mesh | tuple[Mesh, Matrix]
"""A mesh, or a mesh moved by a matrix."""


def mesh_of(
    positions: Floats, normals: Floats, uv: Floats, faces: NDArray[np.integer[Any]], skin: Skin | None = None
) -> Mesh:
    """Return a mesh; triangles (m, 3) are turned to face in the direction of their vertices' normals."""
    positions, normals = positions.astype(np.float64), normals.astype(np.float64)
    a, b, c = (positions[faces[:, corner]] for corner in range(3))
    toward = (np.cross(b - a, c - a) * normals[faces].sum(axis=1)).sum(axis=1)
    faces = np.where((toward < 0.0)[:, None], faces[:, [0, 2, 1]], faces)
    p, n, t = (np.ascontiguousarray(array, np.float32) for array in (positions, normals, uv))
    indices = np.ascontiguousarray(faces, np.uint32)
    return Mesh(
        positions=p, normals=n, uv=t, tangents=tangents_of(p, n, t, indices), indices=indices, skin=skin
    )


def merged(parts: Iterable[Part]) -> Mesh:
    """Merge rigid meshes, which the renderer then draws in one call."""
    positions, normals, uv, faces, count = [], [], [], [], 0
    for part in parts:
        mesh, matrix = (part, np.eye(4)) if isinstance(part, Mesh) else part
        positions.append(mesh.positions @ matrix[:3, :3].T + matrix[:3, 3])
        turned = mesh.normals @ np.linalg.inv(matrix[:3, :3])
        normals.append(turned / np.linalg.norm(turned, axis=1, keepdims=True))
        uv.append(mesh.uv.astype(np.float64))
        faces.append(mesh.indices.astype(np.int64) + count)
        count += len(mesh.positions)
    return mesh_of(
        np.concatenate(positions), np.concatenate(normals), np.concatenate(uv), np.concatenate(faces)
    )


def plane(width: float, depth: float, repeat: float = 1.0) -> Mesh:
    """Return a level rectangle about the origin that faces up."""
    half = np.array([[-1, 0, -1], [1, 0, -1], [-1, 0, 1], [1, 0, 1]]) * (width / 2.0, 0.0, depth / 2.0)
    return mesh_of(half, np.tile([0.0, 1.0, 0.0], (4, 1)), half[:, [0, 2]] * repeat, _grid_faces(2, 2))


def wall(width: float, height: float, repeat: float = 1.0) -> Mesh:
    """Return an upright rectangle that stands on the origin and faces +z; v runs down from the top."""
    corners = np.array([[-1, 1, 0], [1, 1, 0], [-1, 0, 0], [1, 0, 0]]) * (width / 2.0, height, 0.0)
    uv = np.stack([corners[:, 0] + width / 2.0, height - corners[:, 1]], axis=1) * repeat
    return mesh_of(corners, np.tile([0.0, 0.0, 1.0], (4, 1)), uv, _grid_faces(2, 2))


def panel(width: float, height: float) -> Mesh:
    """Return a `wall` that shows its texture exactly once."""
    mesh = wall(width, height)
    return mesh_of(mesh.positions, mesh.normals, mesh.uv / np.array([width, height]), mesh.indices)


def box(width: float, height: float, depth: float, repeat: float = 1.0) -> Mesh:
    """Return a box that stands on the origin."""
    extent = np.array([width, height, depth])
    square = np.array([(-1, -1), (1, -1), (-1, 1), (1, 1)]) / 2.0
    sides = []  # positions, normals and texture coordinates of each
    for axis, (across, up) in enumerate(((2, 1), (0, 2), (0, 1))):
        for side in (-0.5, 0.5):
            corners = np.zeros((4, 3))
            corners[:, axis], corners[:, across], corners[:, up] = side, square[:, 0], square[:, 1]
            positions = corners * extent + (0.0, height / 2.0, 0.0)
            uv = (square + 0.5) * (extent[across], -extent[up]) * repeat
            sides.append((positions, np.tile(np.eye(3)[axis] * np.sign(side), (4, 1)), uv))
    faces = np.concatenate([_grid_faces(2, 2) + 4 * index for index in range(6)])
    p, n, t = (np.concatenate(arrays) for arrays in zip(*sides, strict=True))
    return mesh_of(p, n, t, faces)


def lathe(profile: Sequence[tuple[float, float]], sides: int = 24, *, smooth: bool = False) -> Mesh:
    """Return a surface of revolution about y.

    `profile` is a list of (radius, height); the outer side is to the right of its direction. If `smooth`, it
    is shaded as one curve, otherwise as straight pieces with edges.
    """
    points = np.asarray(profile, np.float64)
    steps = np.diff(points, axis=0)
    flat = np.stack([steps[:, 1], -steps[:, 0]], axis=1)
    flat /= np.maximum(np.linalg.norm(flat, axis=1, keepdims=True), 1e-9)
    if smooth:
        ends = np.concatenate([flat[:1], flat[:-1] + flat[1:], flat[-1:]])
        rings, slopes = points, ends / np.maximum(np.linalg.norm(ends, axis=1, keepdims=True), 1e-9)
        pieces = [slice(0, len(points))]
    else:
        rings, slopes = np.repeat(points, 2, axis=0)[1:-1], np.repeat(flat, 2, axis=0)
        pieces = [slice(2 * i, 2 * i + 2) for i in range(len(flat))]
    phi = np.linspace(0.0, 2.0 * np.pi, sides + 1)
    around, up = np.stack([np.sin(phi), 0.0 * phi, np.cos(phi)], axis=-1), np.array([0.0, 1.0, 0.0])
    radius = max(float(points[:, 0].max()), 1e-3)
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(rings, axis=0), axis=1))])
    positions = np.maximum(rings[:, :1, None], 1e-4) * around + rings[:, 1:, None] * up
    normals = slopes[:, :1, None] * around + slopes[:, 1:, None] * up
    uv = np.stack(np.meshgrid(phi * radius, -along), axis=-1)
    faces = np.concatenate([_grid_faces(p.stop - p.start, sides + 1) + p.start * (sides + 1) for p in pieces])
    return mesh_of(positions.reshape(-1, 3), normals.reshape(-1, 3), uv.reshape(-1, 2), faces)


def cylinder(radius: float, height: float, sides: int = 16) -> Mesh:
    """Return a closed cylinder that stands on the origin."""
    return lathe([(0.0, 0.0), (radius, 0.0), (radius, height), (0.0, height)], sides)


def ball(radius: float = 1.0, rings: int = 16) -> Mesh:
    """Return a sphere about the origin."""
    theta = np.linspace(-np.pi / 2.0, np.pi / 2.0, rings + 1)
    profile = [(radius * float(np.cos(a)), radius * float(np.sin(a))) for a in theta]
    return lathe(profile, 2 * rings, smooth=True)


def torus(radius: float, tube_radius: float, sides: int = 32) -> Mesh:
    """Return a ring about y."""
    theta = np.linspace(0.0, 2.0 * np.pi, 17)
    profile = [(radius + tube_radius * float(np.cos(a)), tube_radius * float(np.sin(a))) for a in theta]
    return lathe(profile, sides, smooth=True)


def tube(path: Values | Sequence[Sequence[float]], radius: float, sides: int = 8) -> Mesh:
    """Return an open tube along points (n, 3): a pole, a pipe, a wire."""
    points = np.asarray(path, np.float64)
    ahead = np.gradient(points, axis=0)
    ahead /= np.linalg.norm(ahead, axis=1, keepdims=True)
    reference = np.eye(3)[np.abs(ahead).max(axis=0).argmin()]  # the axis that the tube follows least
    right = np.cross(ahead, reference)
    right /= np.linalg.norm(right, axis=1, keepdims=True)
    other = np.cross(right, ahead)
    phi = np.linspace(0.0, 2.0 * np.pi, sides + 1)[:, None]
    normals = np.cos(phi) * right[:, None] + np.sin(phi) * other[:, None]
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))])
    uv = np.stack(np.meshgrid(phi[:, 0] * radius, along), axis=-1)
    positions = points[:, None] + radius * normals
    faces = _grid_faces(len(points), sides + 1)
    return mesh_of(positions.reshape(-1, 3), normals.reshape(-1, 3), uv.reshape(-1, 2), faces)


def knot(points: int, radius: float, swelling: float, height: float) -> Values:
    """Return points (n, 3) of a trefoil knot about y, for a `tube`; `radius` varies by `swelling`."""
    a = np.linspace(0.0, 2.0 * np.pi, points)
    swell = radius + swelling * np.cos(3.0 * a)
    return np.stack([swell * np.cos(2.0 * a), height * np.sin(3.0 * a), swell * np.sin(2.0 * a)], axis=1)


def wire(start: Point, end: Point, sag: float, radius: float) -> Mesh:
    """Return a thin `tube` between two points that sags by `sag`."""
    t = np.linspace(0.0, 1.0, 13)[:, None]
    path = (1.0 - t) * np.asarray(start, np.float64) + t * np.asarray(end, np.float64)
    path[:, 1:2] -= 4.0 * sag * t * (1.0 - t)
    return tube(path, radius, 5)


def rock(rng: Rng, radius: float, rings: int = 10) -> Mesh:
    """Return a lumpy ball, with the texture coordinates of a `ball`."""
    mesh = ball(1.0, rings)
    directions = mesh.positions.astype(np.float64)
    waves, phases = rng.normal(0.0, 2.0, (6, 3)), rng.uniform(0.0, 6.3, 6)
    size = radius * (1.0 + 0.08 * np.sin(directions @ waves.T + phases).sum(axis=1, keepdims=True))
    uv = mesh.uv.astype(np.float64) * radius
    return mesh_of(directions * size * (1.0, 0.75, 1.0), directions, uv, mesh.indices)


def blades(rng: Rng, roots: Values, groups: NDArray[np.int64], height: float, width: float) -> Mesh:
    """Return grass at roots (n, 3), about `height` metres tall and `width` metres wide at the root.

    A blade follows joint 1 + its group (n,), with the square of the height.
    """
    count, levels = len(roots), np.array([0.0, 0.35, 0.7, 1.0])
    yaw = rng.uniform(0.0, 2.0 * np.pi, count)
    across = np.stack([np.cos(yaw), 0.0 * yaw, np.sin(yaw)], axis=1)
    front = np.cross(across, (0.0, 1.0, 0.0))
    tall = height * rng.uniform(0.6, 1.4, (count, 1, 1, 1))
    lean = rng.normal(0.0, 0.35, (count, 1, 1, 1)) * levels[:, None, None] ** 2
    taper = width * (1.0 - 0.9 * levels[:, None, None]) * np.array([-0.5, 0.5])[:, None]
    upright = tall * (levels[:, None, None] * (0.0, 1.0, 0.0) + lean * front[:, None, None])
    positions = roots[:, None, None] + taper * across[:, None, None] + upright  # (n, 4, 2, 3)
    # Nearly vertical, as usual for grass, so that it is lit like the ground.
    normals = np.broadcast_to(np.array([0.0, 0.9, 0.0]) + 0.44 * front[:, None, None], positions.shape)
    uv = np.stack(np.broadcast_arrays([0.0, 1.0], (1.0 - levels)[:, None]), axis=-1)
    faces = (_grid_faces(4, 2) + 8 * np.arange(count)[:, None, None]).reshape(-1, 3)
    following = np.broadcast_to((levels**2)[:, None], positions.shape[:3]).reshape(-1)
    skin = _swayed(np.repeat(groups, 8), following)
    normals = normals.reshape(-1, 3) / np.linalg.norm(normals.reshape(-1, 3), axis=1, keepdims=True)
    return mesh_of(positions.reshape(-1, 3), normals, np.tile(uv.reshape(-1, 2), (count, 1)), faces, skin)


def cards(rng: Rng, centers: Values, groups: NDArray[np.int64], size: float, middle: Values) -> Mesh:
    """Return square leaf cards of about `size` metres at centers (n, 3), in random directions.

    Each follows joint 1 + its group (n,). Normals point away from the `middle` (3,) of the crown, so that it
    is lit as a whole.
    """
    count = len(centers)
    u = rng.normal(0.0, 1.0, (count, 3))
    u /= np.linalg.norm(u, axis=1, keepdims=True)
    v = np.cross(u, rng.normal(0.0, 1.0, (count, 3)))
    v /= np.linalg.norm(v, axis=1, keepdims=True)
    square = np.array([(-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0), (1.0, 1.0)])
    half = 0.5 * size * rng.uniform(0.7, 1.3, (count, 1, 1))
    positions = centers[:, None] + half * (square[:, :1] * u[:, None] + square[:, 1:] * v[:, None])
    outward = centers - middle + rng.normal(0.0, 0.2, (count, 3))
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    normals = np.repeat(outward, 4, axis=0)
    faces = (_grid_faces(2, 2) + 4 * np.arange(count)[:, None, None]).reshape(-1, 3)
    skin = _swayed(np.repeat(groups, 4), np.ones(4 * count))
    return mesh_of(positions.reshape(-1, 3), normals, np.tile((square + 1.0) / 2.0, (count, 1)), faces, skin)


def _swayed(groups: NDArray[np.int64], following: Values) -> Skin:
    """Bind vertices to joint 1 + group by `following`, and to the static joint 0 by the rest."""
    joints, weights = np.zeros((len(groups), 4), np.uint16), np.zeros((len(groups), 4), np.float32)
    joints[:, 1], weights[:, 1], weights[:, 0] = groups + 1, following, 1.0 - following
    return Skin(joints=joints, weights=weights)


def _grid_faces(rows: int, columns: int) -> NDArray[np.int64]:
    """Return two triangles for each cell of rows x columns vertices."""
    y, x = np.mgrid[: rows - 1, : columns - 1]
    a = (y * columns + x).ravel()
    b, c = a + 1, a + columns
    return np.concatenate([np.stack([a, c, b], 1), np.stack([b, c, c + 1], 1)]).astype(np.int64)
