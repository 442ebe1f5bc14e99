"""Motions of a composition: functions of time in seconds."""

from dataclasses import dataclass

import numpy as np

from supersampler_model.data.scenes.gltf.scene import GltfScene
from supersampler_model.data.scenes.procedural.lighting import Pulse
from supersampler_model.data.scenes.procedural.transforms import placed
from supersampler_model.data.scenes.scene import Instance
from supersampler_model.data.values import Matrix, Values


def to_and_fro(time: float, duration: float) -> float:
    """Return a time in [0, duration] that runs forwards and backwards in turn."""
    if duration <= 0.0:
        return 0.0
    phase = time / duration % 2.0
    return duration * min(phase, 2.0 - phase)


@dataclass(frozen=True, slots=True, eq=False)
class Course:
    """A path to and fro between two positions (3,), slow at both, of `speed` metres a second on average."""

    start: Values
    end: Values
    speed: float
    phase: float = 0.0

    def at(self, time: float) -> Values:
        """Return the position (3,)."""
        length = max(float(np.linalg.norm(self.end - self.start)), 1e-3)
        return self.between(0.5 - 0.5 * np.cos(np.pi * (self.speed * time / length + self.phase)))

    def between(self, fraction: float) -> Values:
        """Return the position (3,) at a fraction of the path, 0 at `start` and 1 at `end`."""
        return np.asarray(self.start + fraction * (self.end - self.start))


def wave(depth: float, hertz: float, phase: float = 0.0, *, square: bool = False) -> Pulse:
    """Return a sine or square wave in [1 - depth, 1 + depth]; `phase` is in periods."""

    def factor(time: float) -> float:
        sine = float(np.sin(2.0 * np.pi * (hertz * time + phase)))
        return 1.0 + depth * (float(np.sign(sine)) if square else sine)

    return factor


@dataclass(frozen=True, slots=True, eq=False)
class Walk:
    """A hand-held camera that walks and looks at a target.

    Attributes:
        course: of the eye.
        target: (3,) metres.
        pan: angle of its turns to both sides, radians, and their frequency, hertz.
        sway: of the hand, metres.
        fov_y: degrees.
    """

    course: Course
    target: Values
    pan: tuple[float, float]
    sway: float
    fov_y: float

    def at(self, time: float) -> tuple[Values, Values]:
        """Return the eye's place (3,) and what it looks at (3,)."""
        waves = np.sin(time * np.array([[5.1, 6.7, 4.3], [3.7, 7.9, 5.9]]) + np.arange(3.0))
        eye, target = self.course.at(time) + self.sway * waves[0], self.target + self.sway * waves[1]
        angle = self.pan[0] * np.sin(2.0 * np.pi * self.pan[1] * time)
        x, y, z = target - eye
        cos, sin = np.cos(angle), np.sin(angle)
        return eye, eye + np.array([cos * x + sin * z, y, cos * z - sin * x])


@dataclass(frozen=True, slots=True, eq=False)
class Prop:
    """A prop: the content of a glTF file, with its motion over the ground.

    Attributes:
        size: scale factor.
        course: of the middle of its lower side.
        yaw: about the vertical at time 0, radians.
        spin: of the yaw, radians a second.
        hop: height of its jumps, one a second, metres.
        clip: index of the animation, which runs to and fro.
        glow: factor of its emission.
    """

    model: GltfScene
    size: float
    course: Course
    yaw: float
    spin: float
    hop: float
    clip: int
    glow: Pulse

    def instances(self, now: float, before: float) -> tuple[Instance, ...]:
        """Return the instances `now`, with their previous state, both in seconds."""
        clips = self.model.clips
        duration = clips[self.clip].duration if clips else 0.0
        return self.model.instances(
            to_and_fro(now, duration), to_and_fro(before, duration), self.placed(now), self.placed(before),
            clip=self.clip, emission=self.glow(now),
        )  # fmt: skip

    def placed(self, time: float) -> Matrix:
        """Return the matrix from the file's space to the world."""
        low, high = self.model.bounds
        angle = self.yaw + self.spin * time
        matrix = placed(yaw=angle, size=self.size)
        foot = np.array([(low[0] + high[0]) / 2.0, low[1], (low[2] + high[2]) / 2.0])
        hop = self.hop * abs(np.sin(np.pi * time))
        matrix[:3, 3] = self.course.at(time) + np.array([0.0, hop, 0.0]) - matrix[:3, :3] @ foot
        return matrix
