"""Sequences composed at random from the glTF files in a folder, with procedural objects added.

A file of a room's size is the static stage; some sequences have a bare floor instead. Smaller files are
props on it, each with its own motion. Wires, fences, leaves, mirrors, moving objects and particles are added.
Camera, lights, exposure and a cut are random too. Files and seed determine the sequence.
"""

from dataclasses import replace
from pathlib import Path
from typing import NamedTuple
from zlib import crc32

import numpy as np

from supersampler_model.data.scenes.camera import Camera
from supersampler_model.data.scenes.environment import Environment
from supersampler_model.data.scenes.gltf.clutter import add_clutter
from supersampler_model.data.scenes.gltf.errors import GltfError
from supersampler_model.data.scenes.gltf.folder import (
    PANORAMA,
    digest_of,
    ground_of,
    is_stage,
    read_folder,
    stage_instances,
)
from supersampler_model.data.scenes.gltf.ground import Ground, triangles_of
from supersampler_model.data.scenes.gltf.lighting import lit_stage, panorama
from supersampler_model.data.scenes.gltf.motions import Course, Prop, Walk, wave
from supersampler_model.data.scenes.gltf.scene import GltfScene
from supersampler_model.data.scenes.procedural import materials, shapes
from supersampler_model.data.scenes.procedural.fixtures import hills, skyline
from supersampler_model.data.scenes.procedural.paths import vector
from supersampler_model.data.scenes.procedural.stage import Stage
from supersampler_model.data.scenes.scene import Instance, Scene
from supersampler_model.data.specs import Sequence, SequenceSpec
from supersampler_model.data.values import Values

MAX_PROPS = 6  # props in one sequence; a file may be used several times
_PROP_HEIGHTS = 0.3, 1.9  # metres; props of other heights are resized
_PROP_RADII = 0.3, 0.9  # metres: least and greatest radius of the floor that a prop occupies
_CAMERA_CLEARANCE = 1.0  # metres between cameras and props, where there is room
_TRIES = 16  # of camera paths
_FLOOR_SIZE = 12.0  # metres a side: the part of a bare floor on which objects are placed


class LoadedFiles(NamedTuple):
    """The loaded files of a sequence."""

    stage: GltfScene | None
    props: list[GltfScene]
    surroundings: Environment | None


class Composition(Sequence):
    """A sequence of a folder's files; lights and added objects are procedural."""

    def __init__(self, spec: SequenceSpec) -> None:
        """Read the files of a spec whose family is GLTF.

        Raises:
            GltfError: one of them is broken, or not the one of the spec.
        """
        self.spec = spec
        rng = np.random.default_rng([spec.seed, crc32(spec.family.encode())])
        files = _read(spec)
        ground = None if files.stage is None else ground_of(files.stage)
        self._ground = ground or Ground(triangles_of((_floor(),)))
        self._focus = self._ground.spot(rng)
        self.stage = lit_stage(rng, self._focus, files.surroundings)
        self._room = () if files.stage is None else stage_instances(files.stage)
        if files.stage is None:
            _add_floor(rng, self.stage)
        count = int(rng.integers(2, MAX_PROPS + 1)) if files.props else 0
        self._props = [self._prop(files.props[index % len(files.props)], rng) for index in range(count)]
        occupied = add_clutter(rng, self.stage, self._ground, self._focus)
        occupied += [prop.course.between(fraction) for prop in self._props for fraction in (0.0, 0.5, 1.0)]
        self._walks = [self._walk(rng, np.array([self._focus, *occupied])) for _ in range(2)]
        cuts = spec.frames > 5 and rng.random() < 0.5
        self.starts = (0, int(rng.integers(spec.frames // 3, spec.frames)) if cuts else 0)
        self._exposure = wave(rng.uniform(0.0, 0.4), rng.uniform(0.05, 0.5), rng.random())

    def scene(self, index: int) -> Scene:
        """See `Sequence.scene`."""
        scene, now, before = super().scene(index), self.time(index), self.time(index - 1)
        prop_instances = (instance for prop in self._props for instance in prop.instances(now, before))
        return replace(scene, instances=(*self._room, *prop_instances, *scene.instances))

    def camera(self, index: int) -> Camera:
        """See `Sequence.camera`."""
        walk = self._walks[int(0 < self.starts[1] <= index)]
        eye, target = walk.at(self.time(index))
        exposure = self.stage.exposure * self._exposure(self.time(index))
        return Camera(position=vector(eye), target=vector(target), fov_y=walk.fov_y, exposure=exposure)

    def _prop(self, model: GltfScene, rng: np.random.Generator) -> Prop:
        low, high = model.bounds
        height = float(high[1] - low[1])
        size = 1.0
        if not _PROP_HEIGHTS[0] <= height <= _PROP_HEIGHTS[1]:
            size = rng.uniform(0.5, 1.2) / max(float((high - low).max()), 1e-6)
        start = self._ground.near(rng, self._focus, 0.0, 2.0)
        self._ground.take(
            start, float(np.clip(0.6 * size * np.ptp(model.bounds, axis=0)[[0, 2]].max(), *_PROP_RADII))
        )
        end = self._ground.near(rng, start, 1.0, 5.0)
        kind = rng.integers(4)  # still, spinning, sliding, hopping along
        slides = kind >= 2 and self._ground.clear(start, end)
        course = Course(start, end if slides else start, rng.uniform(0.5, 6.0), rng.uniform(0.0, 2.0))
        yaw = rng.uniform(0.0, 2.0 * np.pi)
        spin = rng.choice([-1.0, 1.0]) * rng.uniform(0.3, 5.0) if kind in (1, 3) else 0.0
        hop = rng.uniform(0.2, 0.8) if kind == 3 else 0.0
        clip = int(rng.integers(max(1, len(model.clips))))
        depth, hertz, phase = rng.uniform(0.0, 0.9), rng.uniform(1.0, 12.0), rng.random()
        glow = wave(depth, hertz, phase, square=bool(rng.integers(2)))
        return Prop(model, size, course, yaw, spin, hop, clip, glow)

    def _path(self, rng: np.random.Generator, occupied: Values) -> tuple[Values, Values]:
        """Return start and end of a camera path that has the props in view and does not cross them.

        Args:
            rng: generator.
            occupied: (n, 3) positions to keep away from, where there is room.
        """
        best, found = -np.inf, (self._focus, self._focus)
        for _ in range(_TRIES):
            start = self._ground.near(rng, self._focus, 1.5, 5.0)
            end = self._ground.near(rng, start, 0.5, 4.0)
            if not self._ground.clear(start, end):
                end = start
            line = start + np.linspace(0.0, 1.0, 9)[:, None] * (end - start)
            clearance = float(np.hypot(*(line[:, None] - occupied)[..., [0, 2]].T).min())
            if clearance > best and (self._ground.clear(start, self._focus) or not np.isfinite(best)):
                best, found = clearance, (start, end)
            if best > _CAMERA_CLEARANCE:
                break
        return found

    def _walk(self, rng: np.random.Generator, occupied: Values) -> Walk:
        start, end = self._path(rng, occupied)
        eyes = np.array([0.0, rng.uniform(0.5, 1.8), 0.0])
        target = self._focus + np.array([0.0, rng.uniform(0.3, 1.0), 0.0])
        pan = (rng.uniform(0.2, 0.8), rng.uniform(0.1, 0.6)) if rng.random() < 0.5 else (0.0, 0.0)
        course = Course(start + eyes, end + eyes, rng.uniform(0.2, 3.0), rng.uniform(0.0, 2.0))
        return Walk(course, target, pan, rng.uniform(0.0, 0.03), rng.uniform(40.0, 75.0))


def compose(folder: Path | str, seed: int, frames: int = 32) -> Composition:
    """Draw a sequence from the files (.glb, .gltf) and panoramas (.hdr) in a folder and below.

    Files are in metres, y up; the same files and seed give the same sequence.

    Raises:
        SceneError: there is no file in the folder.
        GltfError: one of the files is broken or not supported.
    """
    return Composition(read_folder(Path(folder)).spec(seed, frames))


def _read(spec: SequenceSpec) -> LoadedFiles:
    stage, props, surroundings = None, [], None
    for name, digest in spec.files:
        path = Path(spec.folder or "", name)
        if path.suffix.lower() == PANORAMA:
            _expect(path, digest, digest_of(path))
            surroundings = panorama(path)
            continue
        model = GltfScene(path)
        _expect(path, digest, model.digest)
        if is_stage(model):
            stage = model
        else:
            props.append(model)
    return LoadedFiles(stage, props, surroundings)


def _expect(path: Path, wanted: str, found: str) -> None:
    if found != wanted:
        problem = "is not the file that this sequence was made with; put that one back, or begin another set"
        raise GltfError(path, "", problem)


def _floor() -> Instance:
    """Return the part of a bare floor on which objects are placed."""
    return Instance(
        mesh=shapes.plane(_FLOOR_SIZE, _FLOOR_SIZE), material=materials.glow((0, 0, 0), 0), model=np.eye(4)
    )


def _add_floor(rng: np.random.Generator, stage: Stage) -> None:
    """Add a floor up to the horizon, and a skyline or hills."""
    if rng.random() < 0.5:
        stage.put(shapes.plane(70.0, 70.0, 0.5), materials.tiles(rng, 8, rng.random()))
        skyline(rng, stage)
    else:
        stage.put(shapes.plane(70.0, 70.0, 0.35), materials.ground(rng, (0.36, 0.36, 0.28), 0.7))
        hills(rng, stage, (0.25, 0.33, 0.15))
