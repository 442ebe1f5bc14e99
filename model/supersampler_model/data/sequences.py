"""Sequences: a scene for each frame index, reproduced exactly from a few numbers."""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from zlib import crc32

import numpy as np

from supersampler_model.data.camera import Camera
from supersampler_model.data.checks import check_number
from supersampler_model.data.errors import SceneError
from supersampler_model.data.procedural import TEST, TRAIN
from supersampler_model.data.procedural.paths import camera_path
from supersampler_model.data.scene import Scene

TRAIN_FAMILIES: tuple[str, ...] = tuple(TRAIN)
"""Families of scenes to learn from, each built around a hard case."""
TEST_FAMILIES: tuple[str, ...] = tuple(TEST)
"""Families for test shots alone, of other content and look."""
_SHORTEST_SHOT = 6  # frames between cuts


@dataclass(frozen=True, slots=True, kw_only=True)
class SequenceSpec:
    """All that a sequence is made from; plain numbers, for a JSON file.

    Attributes:
        family: one of TRAIN_FAMILIES or TEST_FAMILIES.
        seed: >= 0, of layout, textures, colours, lights, camera, speeds, cuts and exposure.
        frames: how many, >= 1.
        frame_rate: frames a second, > 0.
    """

    family: str
    seed: int
    frames: int
    frame_rate: float = 30.0

    def __post_init__(self) -> None:
        check_number("spec.seed", self.seed, 0, np.inf)
        check_number("spec.frames", self.frames, 1, np.inf)
        check_number("spec.frame_rate", self.frame_rate, 0.0, np.inf, open_below=True)


class Sequence(ABC):
    """Frames 0 to spec.frames - 1, each a pure function of the spec and its index."""

    spec: SequenceSpec

    @abstractmethod
    def scene(self, index: int) -> Scene:
        """Return a frame; what it says of the moment before is what the frame before shows.

        On a cut the camera before is the camera itself.

        Raises:
            SceneError: there is no such frame.
        """

    @abstractmethod
    def cut(self, index: int) -> bool:
        """Return whether frame `index` has nothing to do with the one before: 0 is one."""

    @abstractmethod
    def exposure(self, index: int) -> float | None:
        """Return the engine's exposure of frame `index`, its camera's; None where it is to be measured."""


def make_sequence(spec: SequenceSpec) -> Sequence:
    """Return the sequence of a spec.

    Raises:
        SceneError: there is no such family.
    """
    if spec.family not in (*TRAIN, *TEST):
        known = ", ".join((*TRAIN_FAMILIES, *TEST_FAMILIES))
        raise SceneError("spec.family", got=repr(spec.family), want=f"one of {known}")
    return StagedSequence(spec)


class StagedSequence(Sequence):
    """A stage that a family has built, seen in one or more shots."""

    def __init__(self, spec: SequenceSpec) -> None:
        self.spec = spec
        # Apart, so that a change to a family leaves the cuts and the exposure of its seeds as they are.
        content, direction = (
            np.random.default_rng([spec.seed, crc32(spec.family.encode()), i]) for i in (0, 1)
        )
        self._stage = {**TRAIN, **TEST}[spec.family](content)
        self._starts = _shot_starts(direction, spec.frames)
        self._metered = direction.random() < 0.25
        exposure = _exposure_path(direction, self._stage.exposure, spec.frames / spec.frame_rate)
        order = direction.permutation(len(self._stage.vantages))
        self._cameras = [
            camera_path(direction, self._stage.vantages[order[shot % len(order)]], exposure)
            for shot in range(len(self._starts))
        ]

    def scene(self, index: int) -> Scene:
        """See `Sequence.scene`."""
        if not 0 <= index < self.spec.frames:
            raise SceneError("index", got=index, want=f"0 to {self.spec.frames - 1}")
        now, before = index / self.spec.frame_rate, (index - 1) / self.spec.frame_rate
        camera, stage = self._camera(index), self._stage
        return Scene(
            camera=camera,
            camera_before=camera if self.cut(index) else self._camera(index - 1),
            environment=stage.environment,
            instances=tuple(prop.instance(now, before) for prop in stage.props),
            sun=None if stage.sun is None else stage.sun(now),
            spot=None if stage.spot is None else stage.spot(now),
            points=tuple(point(now) for point in stage.points),
            particles=tuple(cloud(now) for cloud in stage.particles),
        )

    def cut(self, index: int) -> bool:
        """See `Sequence.cut`."""
        return index in self._starts

    def exposure(self, index: int) -> float | None:
        """See `Sequence.exposure`."""
        return None if self._metered else self._camera(index).exposure

    def _camera(self, index: int) -> Camera:
        shot = sum(start <= index for start in self._starts) - 1
        return self._cameras[shot](index / self.spec.frame_rate)


def _shot_starts(random: np.random.Generator, frames: int) -> tuple[int, ...]:
    """Return the first frames of the shots: one shot mostly, sometimes two or three."""
    starts, cuts = [0], int(random.choice(3, p=(0.6, 0.28, 0.12)))
    for place in sorted(random.uniform(0.2, 0.85, cuts)):
        starts.append(int(place * frames))
    apart = [after for before, after in pairwise(starts) if after - before >= _SHORTEST_SHOT]
    return (0, *apart)


def _exposure_path(random: np.random.Generator, level: float, seconds: float) -> Callable[[float], float]:
    """Return the exposure over time: constant mostly, else an eye that gets used to another light."""
    bias = 2.0 ** float(random.uniform(-0.4, 0.4))
    stops = float(random.uniform(0.5, 1.5) * random.choice([-1.0, 1.0]) * (random.random() < 0.35))
    middle, width = float(random.uniform(0.2, 0.8)) * seconds, float(random.uniform(0.1, 0.5))
    return lambda t: float(level * bias * 2.0 ** (0.5 * stops * np.tanh((t - middle) / width)))
