"""Sun, spot and point lights; colours are linear RGB in the environment's radiance unit times steradian."""

from dataclasses import dataclass

import numpy as np

from supersampler_model.data.checks import check, check_number
from supersampler_model.data.errors import SceneError
from supersampler_model.data.scenes.camera import look_at
from supersampler_model.data.values import Color, Matrix, Vector

MAX_POINTS = 16


@dataclass(frozen=True, slots=True, kw_only=True)
class Sun:
    """Parallel light with a shadow inside a sphere.

    Attributes:
        direction: from the light to the scene; its length does not matter.
        color: irradiance on a surface that faces it.
        center, radius: of the sphere that the shadow map covers, metres; there is no shadow outside.
    """

    direction: Vector
    color: Color
    center: Vector = (0.0, 0.0, 0.0)
    radius: float = 20.0

    def __post_init__(self) -> None:
        _check_direction("sun.direction", self.direction)
        check("sun.center", self.center, 3)
        _check_color("sun.color", self.color)
        check_number("sun.radius", self.radius, 0.0, np.inf, open_below=True)

    def matrix(self) -> Matrix:
        """Return world to the shadow map's clip space: x, y in [-1, 1], depth in [0, 1], 0 at the light."""
        to_light = -np.array(self.direction) / np.linalg.norm(self.direction)
        eye = np.array(self.center) + to_light * self.radius
        scale = np.diag([1.0 / self.radius, 1.0 / self.radius, -0.5 / self.radius, 1.0])
        return scale @ look_at(_vector(eye), self.center, _up_for(to_light))


@dataclass(frozen=True, slots=True, kw_only=True)
class Spot:
    """A cone of light with a shadow.

    Attributes:
        color: radiant intensity on the axis: irradiance at 1 m.
        inner, outer: half angles, degrees, between which it fades.
        reach: distance at which it has faded to 0, metres, > 0.1.
    """

    position: Vector
    target: Vector
    color: Color
    inner: float = 15.0
    outer: float = 25.0
    reach: float = 20.0

    def __post_init__(self) -> None:
        check("spot.position", self.position, 3)
        check("spot.target", self.target, 3)
        _check_direction("spot.target - position", _vector(np.subtract(self.target, self.position)))
        _check_color("spot.color", self.color)
        check_number("spot.outer", self.outer, 0.0, 80.0, open_below=True)
        check_number("spot.inner", self.inner, 0.0, self.outer)
        check_number("spot.reach", self.reach, 0.1, np.inf, open_below=True)

    def matrix(self) -> Matrix:
        """Return world to the shadow map's clip space: depth in [0, 1], 0 is 0.1 m from the light."""
        axis = np.subtract(self.target, self.position)
        f, near, far = 1.0 / np.tan(np.radians(self.outer)), 0.1, self.reach
        project = np.zeros((4, 4))
        project[0, 0] = project[1, 1] = f
        project[2, 2:], project[3, 2] = (far / (near - far), near * far / (near - far)), -1.0
        return project @ look_at(self.position, self.target, _up_for(axis / np.linalg.norm(axis)))


@dataclass(frozen=True, slots=True, kw_only=True)
class Point:
    """Light into all directions, without a shadow.

    Attributes:
        color: radiant intensity: irradiance at 1 m.
        reach: distance at which it has faded to 0, metres.
    """

    position: Vector
    color: Color
    reach: float = 10.0

    def __post_init__(self) -> None:
        check("point.position", self.position, 3)
        _check_color("point.color", self.color)
        check_number("point.reach", self.reach, 0.0, np.inf, open_below=True)


def _vector(values: Matrix) -> Vector:
    x, y, z = (float(value) for value in values)
    return x, y, z


def _up_for(direction: Matrix) -> Vector:
    return (0.0, 0.0, 1.0) if abs(direction[1]) > 0.99 else (0.0, 1.0, 0.0)


def _check_direction(name: str, direction: Vector) -> None:
    if not np.linalg.norm(check(name, direction, 3)) > 0.0:
        raise SceneError(name, got=direction, want="a direction")


def _check_color(name: str, color: Color) -> None:
    for value in check(name, color, 3):
        check_number(name, value, 0.0, np.inf)
