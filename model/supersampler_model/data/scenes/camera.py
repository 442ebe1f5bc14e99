"""The camera and its matrices: infinite reversed depth, row 0 of the image on top."""

from dataclasses import dataclass

import numpy as np

from supersampler_model.data.checks import check, check_number
from supersampler_model.data.errors import SceneError
from supersampler_model.data.values import Matrix, Vector


@dataclass(frozen=True, slots=True, kw_only=True)
class Camera:
    """A pinhole camera.

    Attributes:
        fov_y: vertical field of view, degrees.
        near: metres; depth is near / view distance.
        exposure: what the frame's colour is multiplied by before the tone curve; the colour itself is not.
    """

    position: Vector
    target: Vector
    up: Vector = (0.0, 1.0, 0.0)
    fov_y: float = 60.0
    near: float = 0.1
    exposure: float = 1.0

    def __post_init__(self) -> None:
        for name in ("position", "target", "up"):
            check(f"camera.{name}", getattr(self, name), 3)
        for name, most in (("fov_y", 175.0), ("near", np.inf), ("exposure", np.inf)):
            check_number(f"camera.{name}", getattr(self, name), 0.0, most, open_below=True)
        if not np.linalg.norm(np.cross(np.subtract(self.target, self.position), self.up)) > 0.0:
            got = f"{self.target} from {self.position}, up {self.up}"
            raise SceneError("camera.target", got=got, want="a direction other than up, at some distance")

    def view(self) -> Matrix:
        """Return world to view: x right, y up, looking at -z."""
        return look_at(self.position, self.target, self.up)

    def projection(self, aspect: float) -> Matrix:
        """Return view to clip: reversed depth in [0, 1], infinite far, y downwards so that row 0 is on top.

        Args:
            aspect: width / height of the image.
        """
        f = 1.0 / np.tan(np.radians(self.fov_y) / 2.0)
        return np.array(
            [[f / aspect, 0, 0, 0], [0, -f, 0, 0], [0, 0, 0, self.near], [0, 0, -1, 0]], np.float64
        )


def look_at(position: Vector, target: Vector, up: Vector) -> Matrix:
    """Return world to view of an eye at `position`: x right, y up, looking at -z."""
    back = np.subtract(position, target) / np.linalg.norm(np.subtract(position, target))
    right = np.cross(up, back)
    right /= np.linalg.norm(right)
    matrix = np.eye(4)
    matrix[:3, :3] = right, np.cross(back, right), back
    matrix[:3, 3] = -matrix[:3, :3] @ position
    return matrix
