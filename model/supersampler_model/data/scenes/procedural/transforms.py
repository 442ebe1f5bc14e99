"""Object-to-world matrices: world = placed @ local, y up."""

from collections.abc import Sequence

import numpy as np

from supersampler_model.data.values import Matrix, Values


def placed(
    x: float = 0.0, y: float = 0.0, z: float = 0.0, *, yaw: float = 0.0, size: float | Sequence[float] = 1.0
) -> Matrix:
    """Return: scale by `size`, turn by `yaw` radians about y, move to (x, y, z)."""
    matrix = turned_by(1, yaw)
    matrix[:3, :3] *= np.broadcast_to(np.asarray(size, np.float64), 3)
    matrix[:3, 3] = x, y, z
    return matrix


def turned_by(axis: int, angle: float) -> Matrix:
    """Return a rotation by `angle` radians about x (0), y (1) or z (2)."""
    matrix = np.eye(4)
    a, b = (axis + 1) % 3, (axis + 2) % 3
    matrix[[a, b], [a, b]] = np.cos(angle)
    matrix[a, b], matrix[b, a] = -np.sin(angle), np.sin(angle)
    return matrix


def facing(position: Sequence[float] | Values, heading: Sequence[float] | Values) -> Matrix:
    """Return the pose at `position` with its local +z along the level part of `heading`."""
    yaw = float(np.arctan2(heading[0], heading[2]))
    return placed(float(position[0]), float(position[1]), float(position[2]), yaw=yaw)


def along(origin: Sequence[float] | Values, toward: Sequence[float] | Values, roll: float = 0.0) -> Matrix:
    """Return the pose at `origin` with local +y along `toward`, turned about it by `roll` radians."""
    ahead = np.asarray(toward, np.float64) / np.linalg.norm(toward)
    beside = np.cross(ahead, np.eye(3)[np.abs(ahead).argmin()])
    beside /= np.linalg.norm(beside)
    across = np.cos(roll) * beside + np.sin(roll) * np.cross(ahead, beside)
    matrix = np.eye(4)
    matrix[:3, :3] = np.stack([across, ahead, np.cross(across, ahead)], axis=1)
    matrix[:3, 3] = origin
    return matrix
