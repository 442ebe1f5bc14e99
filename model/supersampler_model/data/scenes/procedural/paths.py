"""Poses, and random motions of objects and cameras as smooth functions of time in seconds."""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from supersampler_model.data.scenes.scene import Camera, Matrices, Matrix, Rng, Values, Vector


def placed(
    x: float = 0.0, y: float = 0.0, z: float = 0.0, *, yaw: float = 0.0, size: float | Sequence[float] = 1.0
) -> Matrix:
    """Return the pose that scales by `size`, turns by `yaw` radians about y, and moves to (x, y, z)."""
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


Pose = Callable[[float], Matrix]
Place = Callable[[float], Values]
"""Seconds to (x, y, z), metres."""
Point3 = Sequence[float] | Values
"""(x, y, z), metres."""
MOTIONS = ("still", "orbit", "dolly", "truck", "crane", "pan")
_SHARES = (0.08, 0.22, 0.2, 0.22, 0.1, 0.18)
_BRISK_SHARES = (0.05, 0.2, 0.15, 0.22, 0.1, 0.28)


def vector(values: Values | Sequence[float]) -> Vector:
    """Return three floats."""
    x, y, z = (float(value) for value in values)
    return x, y, z


def place_of(place: Place | Point3) -> Place:
    """Return a place as a function of time; a point does not move."""
    if callable(place):
        return place
    fixed = np.asarray(place, np.float64)
    return lambda _: fixed


def drift(rng: Rng, amount: float, rate: float) -> Place:
    """Return a random path around the origin: about `amount` metres at about `rate` hertz."""
    waves = rng.normal(0.0, amount / 2.0, (4, 3))
    rates, phases = 2.0 * np.pi * rate * rng.uniform(0.4, 1.6, (4, 3)), rng.uniform(0.0, 6.3, (4, 3))
    return lambda t: np.asarray((waves * np.sin(rates * t + phases)).sum(axis=0))


def swing(rng: Rng, start: Sequence[float], end: Sequence[float], speed: float) -> Place:
    """Return a sinusoidal motion between two points, at most `speed` metres a second."""
    a, b = np.asarray(start, np.float64), np.asarray(end, np.float64)
    rate = 2.0 * speed / max(float(np.linalg.norm(b - a)), 1e-6)
    phase = float(rng.uniform(-1.2, 1.2) + rng.choice([0.0, np.pi]))  # often starts in the fast middle
    return lambda t: a + (b - a) * (0.5 + 0.5 * np.sin(rate * t + phase))


def pendulum(rng: Rng, pivot: Sequence[float], length: float, extent: float) -> Place:
    """Return the path of a pendulum `length` metres below `pivot` swinging up to about `extent` radians."""
    rates = np.sqrt(9.8 / length) * rng.uniform(0.95, 1.05, 2)  # x and z
    phases = rng.uniform(-1.0, 1.0, 2) + rng.choice([0.0, np.pi])
    extents = extent * np.array([1.0, 0.4])[:: int(rng.choice([-1, 1]))]

    def at(t: float) -> Values:
        x, z = np.sin(extents * np.sin(rates * t + phases))
        return np.asarray(pivot) + length * np.array([x, -np.sqrt(max(1.0 - x * x - z * z, 0.0)), z])

    return at


def circuit(rng: Rng, center: Sequence[float], extent: tuple[float, float], speed: float) -> Place:
    """Return a level ellipse with half axes `extent` in x and z, at about `speed` metres a second."""
    middle, turn = np.asarray(center, np.float64), rng.uniform(0.0, 6.3)
    rate = speed / max(extent) * float(rng.choice([-1.0, 1.0]))

    def at(t: float) -> Values:
        angle = rate * t + turn
        return np.asarray(middle + np.array([extent[0] * np.sin(angle), 0.0, extent[1] * np.cos(angle)]))

    return at


def bounces(rng: Rng, path: Place, height: float, radius: float) -> Place:
    """Return the path of a ball of this radius that follows `path` and bounces to `height` above it."""
    phase, period = rng.random(), 2.0 * float(np.sqrt(2.0 * height / 9.8))

    def at(t: float) -> Values:
        x = (t / period + phase) % 1.0
        return np.asarray(path(t) + np.array([0.0, radius + 4.0 * height * x * (1.0 - x), 0.0]))

    return at


def together(*parts: Place | Sequence[float]) -> Place:
    """Return the sum of places and fixed offsets."""
    fixed = np.sum([part for part in parts if not callable(part)] or [(0.0, 0.0, 0.0)], axis=0)
    moving = [part for part in parts if callable(part)]
    return lambda t: np.asarray(fixed + np.sum([part(t) for part in moving], axis=0))


def upright(path: Place) -> Pose:
    """Return a pose on the path that never turns."""

    def pose(t: float) -> Matrix:
        matrix = np.eye(4)
        matrix[:3, 3] = path(t)
        return matrix

    return pose


def attached(parent: Pose, local: Matrix | Pose) -> Pose:
    """Return the world pose of an object attached to a moving parent: parent @ local."""
    return lambda t: np.asarray(parent(t) @ (local(t) if callable(local) else local))


def point_of(pose: Pose, local: Sequence[float]) -> Place:
    """Return the world position of a local point of a moving object."""
    at = np.array([*local, 1.0])
    return lambda t: np.asarray((pose(t) @ at)[:3])


def headed(path: Place) -> Pose:
    """Return an upright pose on the path, with local +z ahead."""

    def pose(t: float) -> Matrix:
        ahead = path(t + 1e-3) - path(t - 1e-3)
        return placed(*vector(path(t)), yaw=float(np.arctan2(ahead[0], ahead[2])))

    return pose


def spinning(place: Place | Matrix, axis: Values | Sequence[float], rate: float) -> Pose:
    """Return a pose at `place` that turns about a local axis by `rate` radians a second."""
    k = np.asarray(axis, np.float64) / np.linalg.norm(axis)
    cross = np.array([[0.0, -k[2], k[1]], [k[2], 0.0, -k[0]], [-k[1], k[0], 0.0]])

    def pose(t: float) -> Matrix:
        angle = rate * t
        turn = np.eye(4)
        turn[:3, :3] += np.sin(angle) * cross + (1.0 - np.cos(angle)) * cross @ cross
        if not callable(place):
            return np.asarray(place @ turn)
        turn[:3, 3] = place(t)
        return turn

    return pose


def wind(rng: Rng, anchors: Values, strength: float) -> Callable[[float], Matrices]:
    """Return the palette of plants in gusts that move tips by about `strength` metres.

    Joint 0 does not move; joint 1 + i moves anchor i of at most 127 anchors (n, 3).
    """
    angle = rng.uniform(0.0, 6.3)
    ahead = np.array([np.cos(angle), 0.0, np.sin(angle)])
    speed, length = rng.uniform(2.0, 5.0), rng.uniform(3.0, 7.0)
    along = anchors @ ahead
    flutter, phases = rng.uniform(1.5, 4.0, (len(anchors), 3)), rng.uniform(0.0, 6.3, (len(anchors), 3))

    def palette(t: float) -> Matrices:
        gust = 0.55 + 0.45 * np.sin(2.0 * np.pi * (speed * t - along) / length)
        shake = 0.25 * np.sin(2.0 * np.pi * flutter * t + phases) * (0.3 + gust[:, None])
        joints = np.tile(np.eye(4), (len(anchors) + 1, 1, 1))
        joints[1:, :3, 3] = strength * (gust[:, None] * ahead + shake * (1.0, 0.4, 1.0))
        return joints

    return palette


class Vantage(NamedTuple):
    """A camera position of a scene; the camera may move up to `room` metres around it.

    A `brisk` camera is seldom still and pans fast.
    """

    position: Vector
    target: Vector
    room: float = 1.0
    brisk: bool = False


def camera_path(rng: Rng, vantage: Vantage, exposure: Callable[[float], float]) -> Callable[[float], Camera]:
    """Return one of the MOTIONS around a vantage; in half of the cases the camera shakes."""
    kind = str(rng.choice(MOTIONS, p=_BRISK_SHARES if vantage.brisk else _SHARES))
    eye, target = np.asarray(vantage.position), np.asarray(vantage.target)
    back = (eye - target) / np.linalg.norm(eye - target)
    right = np.cross((0.0, 1.0, 0.0), back)
    right /= np.linalg.norm(right)
    way = {"orbit": right, "dolly": back, "truck": right, "crane": np.array([0.0, 0.6, 0.0])}.get(kind)
    room = vantage.room * rng.uniform(0.5, 1.0)
    speed = float(np.exp(rng.uniform(-0.4 if vantage.brisk else -1.0, 1.2)))
    rate, phase = speed / room, float(rng.uniform(-0.9, 0.4) + rng.choice([0.0, np.pi]))
    sweep, sweep_rate, sweep_phase = rng.uniform(0.15, 0.5), rng.uniform(1.5, 5.0), phase  # radians a second
    if vantage.brisk:  # at constant speed, except for its ends
        sweep, sweep_speed = rng.uniform(0.3, 0.55), float(np.exp(rng.uniform(-1.0, 0.6)))
        sweep_rate = 0.5 * np.pi * sweep_speed / sweep
        sweep_phase = float(rng.uniform(-1.3, 0.2) + rng.choice([0.0, np.pi]))
    shaky = float(rng.random() < 0.5 and kind != "still")
    hand, gaze = drift(rng, 0.02 * shaky, 1.2), drift(rng, 0.03 * shaky, 1.5)
    fov = rng.uniform(45.0, 62.0)  # degrees

    def camera(t: float) -> Camera:
        offset = 0.0 if way is None else way * room * np.sin(rate * t + phase)
        aim = target + (offset if kind == "truck" else 0.0)
        if kind == "pan":
            turn = np.sin(sweep_rate * t + sweep_phase)
            turn = float(np.arcsin(0.97 * turn) / np.arcsin(0.97) if vantage.brisk else turn)
            aim = target + right * np.linalg.norm(eye - target) * sweep * turn
        position, gazed = vector(eye + offset + hand(t)), vector(aim + gaze(t))
        return Camera(position=position, target=gazed, fov_y=fov, exposure=exposure(t))

    return camera
