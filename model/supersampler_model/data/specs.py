"""Base class of rendered sequences, and the spec that generates one."""

import re
from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from supersampler.io.files import SHOT_FRAMES
from supersampler_model.data.errors import SceneError, check_number
from supersampler_model.data.scenes.procedural.stage import Stage
from supersampler_model.data.scenes.scene import Camera, Scene

GLTF = "gltf"
"""Family of sequences composed of glTF files."""
SHOT = "shot"
"""Family of copies of shots, which are not generated."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SequenceSpec:
    """The parameters that generate a sequence; plain data for a JSON file."""

    family: str  # one of TRAIN_FAMILIES, TEST_FAMILIES or APART_FAMILIES; GLTF; SHOT
    seed: int  # >= 0, of layout, textures, colours, lights, camera, speeds, cuts and exposure
    frames: int  # number of frames, 1 to SHOT_FRAMES
    frame_rate: float = 30.0  # frames a second, > 0
    folder: str | None = None  # folder of the files of a GLTF sequence, else None
    files: tuple[tuple[str, str], ...] = ()
    """Name below `folder` and SHA-256 of each file of a GLTF sequence; name and digest of a shot."""

    def __post_init__(self) -> None:
        object.__setattr__(self, "files", tuple((name, digest) for name, digest in self.files))  # from JSON
        if not re.fullmatch(r"\w+", self.family):  # it names a folder
            raise SceneError("spec.family", got=repr(self.family), want="letters, digits and underscores")
        check_number("spec.seed", self.seed, 0, np.inf)
        check_number("spec.frames", self.frames, 1, SHOT_FRAMES)
        check_number("spec.frame_rate", self.frame_rate, 0.0, np.inf, open_below=True)
        needs, has = self.family == GLTF, self.folder is not None and len(self.files) > 0
        if needs != has or (self.files and self.family not in (GLTF, SHOT)):
            want = "both for a gltf sequence, only files for a shot, neither for others"
            raise SceneError("spec.folder, files", got=f"{self.folder!r}, {len(self.files)} files", want=want)


class Sequence(ABC):
    """Frames 0 to spec.frames - 1, each a pure function of the spec and its index."""

    spec: SequenceSpec
    stage: Stage  # content of the scenes
    starts: tuple[int, ...] = (0,)  # first frames of the shots

    def scene(self, index: int) -> Scene:
        """Return the scene of a frame, with its state in the previous frame.

        After a cut, the previous camera is the camera itself.

        Raises:
            SceneError: there is no such frame.
        """
        self.check_index(index)
        camera = self.camera(index)
        before = camera if self.cut(index) else self.camera(index - 1)
        return self.stage.scene(self.time(index), self.time(index - 1), camera, before)

    def cut(self, index: int) -> bool:
        """Return whether frame `index` starts a new shot; frame 0 does."""
        return index in self.starts

    def exposure(self, index: int) -> float | None:
        """Return the exposure that the engine gives for frame `index`; None: it is to be measured."""
        return self.camera(index).exposure

    def time(self, index: int) -> float:
        """Return the time of frame `index`, seconds; it may be negative for the frame before the first."""
        return index / self.spec.frame_rate

    @abstractmethod
    def camera(self, index: int) -> Camera:
        """Return the camera of frame `index`."""

    def check_index(self, index: int) -> None:
        """Raise SceneError if there is no frame `index`."""
        if not 0 <= index < self.spec.frames:
            raise SceneError("index", got=index, want=f"0 to {self.spec.frames - 1}")
