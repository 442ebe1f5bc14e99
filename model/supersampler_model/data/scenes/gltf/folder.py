"""The glTF files of a folder, sorted into stages, props and panoramas; a seed chooses among them."""

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

MIN_STAGE_SIZE = 8.0  # metres: files of this width or depth are stages, smaller ones props
MAX_PROP_FILES = 3  # in one sequence
PANORAMA = ".hdr"
_BARE_FLOOR_CHANCE = 0.15  # probability of a bare floor in place of a stage
_VALIDATION_EVERY = 4  # one of so many files of each kind is kept for validation
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

    def spec(self, seed: int, frames: int) -> SequenceSpec:
        """Choose the files of a sequence: a stage or a bare floor, props, a panorama or a procedural sky."""
        random = np.random.default_rng([seed, crc32(b"files")])
        bare = len(self.props) > 0 and random.random() < _BARE_FLOOR_CHANCE
        stages = [] if bare or not self.stages else [self.stages[int(random.integers(len(self.stages)))]]
        count = min(int(random.integers(1, MAX_PROP_FILES + 1)), len(self.props))
        props = [self.props[int(index)] for index in random.permutation(len(self.props))[:count]]
        sky = int(random.integers(len(self.panoramas) + 1))
        files = (*stages, *props, *self.panoramas[sky : sky + 1])
        return SequenceSpec(family=GLTF, seed=seed, frames=frames, folder=self.path, files=files)

    def split(self, seed: int) -> tuple["Folder", "Folder | None"]:
        """Return the files for training and those kept for validation, which have none in common.

        A single file of a kind is used for training. None: there is nothing to compose for validation.
        """
        random = np.random.default_rng([seed, crc32(b"split")])
        parts: list[dict[str, tuple[File, ...]]] = [{}, {}]
        for kind in ("stages", "props", "panoramas"):
            files: tuple[File, ...] = getattr(self, kind)
            count = max(len(files) // _VALIDATION_EVERY, int(len(files) > 1))
            mixed = [files[int(index)] for index in random.permutation(len(files))]
            parts[0][kind], parts[1][kind] = tuple(mixed[count:]), tuple(mixed[:count])
        training, validation = (Folder(path=self.path, **files) for files in parts)
        return training, validation if validation.stages or validation.props else None


def read_folder(path: Path) -> Folder:
    """Read all files (.glb, .gltf, .hdr) in a folder and below, so that errors occur before rendering.

    Raises:
        SceneError: there is no such folder, or no file in it to compose a sequence of.
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
        want = f"at least one .glb or .gltf smaller than {MIN_STAGE_SIZE:g} m, or with room to stand in"
        raise SceneError("folder", got=f"{path}, without any", want=want)
    return Folder(
        path=str(path.resolve()), stages=tuple(stages), props=tuple(props), panoramas=tuple(panoramas)
    )


def is_stage(model: GltfScene) -> bool:
    """Return whether a file is a stage: MIN_STAGE_SIZE or more along the ground."""
    return float(np.ptp(model.bounds, axis=0)[[0, 2]].max()) >= MIN_STAGE_SIZE


def stage_instances(model: GltfScene) -> tuple[Instance, ...]:
    """Return the instances of a stage, which does not move."""
    return model.instances(0.0, 0.0, _STILL)


def ground_of(model: GltfScene) -> Ground | None:
    """Return the free floor of a stage; None if there is none."""
    triangles = triangles_of(stage_instances(model))
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
