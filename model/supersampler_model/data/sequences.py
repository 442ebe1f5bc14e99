"""Sequences of all scene families, generated from a `SequenceSpec`."""

from collections.abc import Callable
from itertools import pairwise
from zlib import crc32

import numpy as np

from supersampler_model.data.errors import SceneError
from supersampler_model.data.scenes.gltf.compose import Composition
from supersampler_model.data.scenes.procedural import APART, TEST, TRAIN
from supersampler_model.data.scenes.procedural.paths import camera_path
from supersampler_model.data.scenes.scene import Camera
from supersampler_model.data.specs import GLTF, Sequence, SequenceSpec

__all__ = ["APART_FAMILIES", "TEST_FAMILIES", "TRAIN_FAMILIES", "Sequence", "SequenceSpec", "make_sequence"]

TRAIN_FAMILIES: tuple[str, ...] = tuple(TRAIN)
"""Families of scenes for training, each built around a hard case."""
TEST_FAMILIES: tuple[str, ...] = tuple(TEST)
"""Families of test shots, with other content; published means are over these."""
APART_FAMILIES: tuple[str, ...] = tuple(APART)
"""Families of test shots that published means exclude, each about one difficulty."""
_FAMILIES = {**TRAIN, **TEST, **APART}
_SHORTEST_SHOT = 6  # frames between cuts


def make_sequence(spec: SequenceSpec) -> Sequence:
    """Return the sequence of a spec.

    Raises:
        SceneError: there is no such family.
        GltfError: a file of a GLTF sequence is broken, or is not the one that the spec names.
    """
    if spec.family == GLTF:
        return Composition(spec)
    if spec.family not in _FAMILIES:
        known = ", ".join((*_FAMILIES, GLTF))
        raise SceneError("spec.family", got=repr(spec.family), want=f"one of {known}")
    return StagedSequence(spec)


class StagedSequence(Sequence):
    """A stage of a procedural family, seen in one or more shots."""

    def __init__(self, spec: SequenceSpec) -> None:
        self.spec = spec
        # With separate generators, a change to a family does not change the cuts and exposure of its seeds.
        content, direction = (
            np.random.default_rng([spec.seed, crc32(spec.family.encode()), i]) for i in (0, 1)
        )
        self.stage = stage = _FAMILIES[spec.family](content)
        self.starts = _shot_starts(direction, spec.frames)
        self._metered = direction.random() < 0.25
        exposure = _exposure_path(direction, stage.exposure, spec.frames / spec.frame_rate)
        order = direction.permutation(len(stage.vantages))
        self._cameras = [
            camera_path(direction, stage.vantages[order[shot % len(order)]], exposure)
            for shot in range(len(self.starts))
        ]

    def exposure(self, index: int) -> float | None:
        """Return the camera's exposure; None in sequences whose exposure is to be measured."""
        return None if self._metered else self.camera(index).exposure

    def camera(self, index: int) -> Camera:
        """Return the camera of the current shot."""
        shot = sum(start <= index for start in self.starts) - 1
        return self._cameras[shot](self.time(index))


class HeldSequence(StagedSequence):
    """A staged sequence with the camera and exposure of one frame throughout, and perhaps its time."""

    _time: float | None = None  # of all frames; None: time passes

    def __init__(self, spec: SequenceSpec, at: int, *, time_stands: bool) -> None:
        super().__init__(spec)
        self.check_index(at)
        self._held, self._time = super().camera(at), super().time(at) if time_stands else None
        self.starts = (0,)

    def exposure(self, index: int) -> float | None:
        """Return the camera's exposure."""
        return self.camera(index).exposure

    def camera(self, index: int) -> Camera:  # noqa: ARG002  # always the same
        """Return the camera of all frames."""
        return self._held

    def time(self, index: int) -> float:
        """Return the time of frame `index`, or of all frames."""
        return super().time(index) if self._time is None else self._time


def _shot_starts(random: np.random.Generator, frames: int) -> tuple[int, ...]:
    """Return the first frames of the shots: one shot mostly, sometimes two or three."""
    starts, cuts = [0], int(random.choice(3, p=(0.6, 0.28, 0.12)))
    for place in sorted(random.uniform(0.2, 0.85, cuts)):
        starts.append(int(place * frames))
    long_enough = [after for before, after in pairwise(starts) if after - before >= _SHORTEST_SHOT]
    return (0, *long_enough)


def _exposure_path(random: np.random.Generator, level: float, seconds: float) -> Callable[[float], float]:
    """Return the exposure over time: mostly constant; sometimes it adapts to another level."""
    bias = 2.0 ** random.uniform(-0.4, 0.4)
    stops = float(random.uniform(0.5, 1.5) * random.choice([-1.0, 1.0]) * (random.random() < 0.35))
    middle, width = random.uniform(0.2, 0.8) * seconds, random.uniform(0.1, 0.5)
    return lambda t: float(level * bias * 2.0 ** (0.5 * stops * np.tanh((t - middle) / width)))
