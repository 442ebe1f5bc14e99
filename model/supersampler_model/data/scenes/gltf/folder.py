"""The glTF files of a folder: read once, sorted by use, chosen by seeds."""

import hashlib
from dataclasses import dataclass
from pathlib import Path
from zlib import crc32

import numpy as np

from supersampler_model.data.errors import SceneError
from supersampler_model.data.scenes.gltf.errors import GltfError
from supersampler_model.data.scenes.gltf.ground import Ground, triangles_of
from supersampler_model.data.scenes.gltf.lighting import panorama
from supersampler_model.data.scenes.gltf.scene import GltfScene
from supersampler_model.data.scenes.scene import Instance
from supersampler_model.data.specs import GLTF, SequenceSpec
from supersampler_model.data.values import Matrix

STAGE = 8.0  # metres along the ground from which on a file is a stage
PROPS = 3  # files of props in one composition, at most
PANORAMA = ".hdr"
_BARE = 0.15  # probability of a bare floor as stage, if there are others
_HELD_OUT = 4  # one file in so many of each kind is kept for validation
_STILL: Matrix = np.eye(4)

File = tuple[str, str]
"""A name below the folder, with forward slashes, and the SHA-256 of its content."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Folder:
    """Files to compose sequences of.

    Attributes:
        path: absolute.
        stages: files of a room's size or larger, with a floor that one can stand on.
        props: smaller files.
        panoramas: of the surroundings (.hdr).
    """

    path: str
    stages: tuple[File, ...]
    props: tuple[File, ...]
    panoramas: tuple[File, ...]

    def spec(self, seed: int, frames: int, frame_rate: float) -> SequenceSpec:
        """Choose the files of a sequence: a stage or a bare floor, props, a panorama or a procedural sky."""
        random = np.random.default_rng([seed, crc32(b"files")])
        bare = len(self.props) > 0 and random.random() < _BARE
        stages = [] if bare or not self.stages else [self.stages[int(random.integers(len(self.stages)))]]
        count = min(int(random.integers(1, PROPS + 1)), len(self.props))
        props = [self.props[int(index)] for index in random.permutation(len(self.props))[:count]]
        sky = int(random.integers(len(self.panoramas) + 1))
        files = (*stages, *props, *self.panoramas[sky : sky + 1])
        return SequenceSpec(
            family=GLTF, seed=seed, frames=frames, frame_rate=frame_rate, folder=self.path, files=files
        )

    def split(self, seed: int) -> tuple["Folder", "Folder | None"]:
        """Return the files for training and those kept for validation, which have none in common.

        A single file of a kind is used for training. None: there is nothing to compose for validation.
        """
        random = np.random.default_rng([seed, crc32(b"split")])
        kept: list[dict[str, tuple[File, ...]]] = [{}, {}]
        for kind in ("stages", "props", "panoramas"):
            files: tuple[File, ...] = getattr(self, kind)
            count = max(len(files) // _HELD_OUT, int(len(files) > 1))
            mixed = [files[int(index)] for index in random.permutation(len(files))]
            kept[0][kind], kept[1][kind] = tuple(mixed[count:]), tuple(mixed[:count])
        training, validation = (Folder(path=self.path, **files) for files in kept)
        return training, validation if validation.stages or validation.props else None


def read_folder(path: Path) -> Folder:
    """Read all files (.glb, .gltf, .hdr) in a folder and below, so that errors occur before rendering.

    Raises:
        SceneError: there is no such folder, or nothing in it to compose a sequence of.
        GltfError: one of the files is broken or not supported; names it, the primitive and the reason.
    """
    if not path.is_dir():
        raise SceneError("folder", got=f"{path}, which is none", want="a folder of .glb or .gltf files")
    found = sorted(file for file in path.rglob("*") if file.suffix.lower() in (".glb", ".gltf", PANORAMA))
    stages: list[File] = []
    props: list[File] = []
    panoramas: list[File] = []
    for file in found:
        name = file.relative_to(path).as_posix()
        if file.suffix.lower() == PANORAMA:
            panorama(file)
            panoramas.append((name, digest_of(file)))
            continue
        model = GltfScene(file)
        if not is_stage(model):
            props.append((name, model.digest))
        elif ground_of(model) is not None:
            stages.append((name, model.digest))
    if not stages and not props:
        want = f"at least one .glb or .gltf smaller than {STAGE:g} m, or with room to stand in"
        raise SceneError("folder", got=f"{path}, without any", want=want)
    return Folder(
        path=str(path.resolve()), stages=tuple(stages), props=tuple(props), panoramas=tuple(panoramas)
    )


def is_stage(model: GltfScene) -> bool:
    """Return whether a file is so large that others stand on it."""
    return float(np.ptp(model.bounds, axis=0)[[0, 2]].max()) >= STAGE


def standing(model: GltfScene) -> tuple[Instance, ...]:
    """Return a stage, which does not move."""
    return model.instances(0.0, 0.0, _STILL)


def ground_of(model: GltfScene) -> Ground | None:
    """Return where there is room on a stage; None if there is no floor."""
    triangles = triangles_of(standing(model))
    ground = Ground(triangles) if len(triangles) else None
    return ground if ground is not None and ground.free.any() else None


def digest_of(file: Path) -> str:
    """Return the SHA-256 of a file, in hexadecimal.

    Raises:
        GltfError: it cannot be read.
    """
    try:
        return hashlib.sha256(file.read_bytes()).hexdigest()
    except OSError as error:
        raise GltfError(file, "", f"it cannot be read ({error.strerror})") from error
