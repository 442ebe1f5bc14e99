"""Sequences composed at random of the glTF files in a folder.

A file of a room's size is the stage and stands still, smaller ones stand on it, each moving in its own way;
where no file is so large, the stage is a bare floor. Camera, lights, exposure and a cut are drawn too. All of
it follows from the folder's files and the seed.
"""

from pathlib import Path
from typing import NamedTuple

import numpy as np

from supersampler_model.data.camera import Camera
from supersampler_model.data.errors import SceneError
from supersampler_model.data.gltf.accessors import Values
from supersampler_model.data.gltf.ground import Ground
from supersampler_model.data.gltf.lighting import Lighting
from supersampler_model.data.gltf.motions import Course, Flicker, Prop, Walk
from supersampler_model.data.gltf.scene import GltfScene
from supersampler_model.data.mesh import Mesh, tangents_of
from supersampler_model.data.scene import Instance, Material, Scene, Texture
from supersampler_model.data.values import Vector

STAGE = 8.0  # metres along the ground from which on a file is a stage
PROPS, MODELS = 6, 3  # at most: how many stand there, and of how many files
_KEPT = 0.3, 1.9  # metres: heights of props that are not resized
_TRIES = 16
_STILL = np.eye(4)


class Drawn(NamedTuple):
    """What a composition is made of: files, those that are props, and a stage with its ground."""

    files: tuple[Path, ...]
    props: list[GltfScene]
    stage: tuple[Instance, ...]
    ground: Ground


class Composition:
    """One sequence; `compose` draws it.

    Attributes:
        files: that it is made of.
        frames: how many.
        frame_rate: frames a second.
    """

    def __init__(self, folder: Path, seed: int, frames: int, frame_rate: float) -> None:
        self.frames, self.frame_rate = frames, frame_rate
        rng = np.random.default_rng(seed)
        drawn = _drawn(folder, rng)
        self.files, self._stage, self._ground = drawn.files, drawn.stage, drawn.ground
        self._focus = self._ground.spot(rng)
        count = int(rng.integers(2, PROPS + 1)) if drawn.props else 0
        self._props = [self._prop(drawn.props[index % len(drawn.props)], rng) for index in range(count)]
        self._walks = [self._walk(rng) for _ in range(2)]
        self._cut = int(rng.integers(frames // 3, frames)) if frames > 5 and rng.random() < 0.5 else 0
        self._lighting = Lighting(rng, self._focus, folder)
        self._exposure = Flicker(rng.uniform(0.0, 0.4), rng.uniform(0.05, 0.5), rng.random())

    def scene(self, index: int) -> Scene:
        """Return what frame `index` shows, with where that was in the frame before.

        Raises:
            SceneError: there is no such frame.
        """
        if not 0 <= index < self.frames:
            raise SceneError("index", got=index, want=f"0 to {self.frames - 1}")
        now, before = index / self.frame_rate, (index - 1) / self.frame_rate
        camera, lights = self._camera(index, index), self._lighting.at(now)
        return Scene(
            camera=camera,
            camera_before=camera if self.cut(index) else self._camera(index, index - 1),
            environment=self._lighting.environment,
            instances=(*self._stage, *(i for prop in self._props for i in prop.instances(now, before))),
            sun=lights.sun,
            spot=lights.spot,
            points=lights.points,
        )

    def cut(self, index: int) -> bool:
        """Return whether what frame `index` shows does not follow from the frame before."""
        return index in (0, self._cut)

    def exposure(self, index: int) -> float:
        """Return what frame `index` is multiplied by before the tone curve, as its camera says too."""
        return self._exposure.at(index / self.frame_rate)

    def _camera(self, shot: int, index: int) -> Camera:
        """Return the camera of frame `index` in the shot that frame `shot` belongs to."""
        walk = self._walks[int(0 < self._cut <= shot)]
        eye, target = walk.at(index / self.frame_rate)
        return Camera(
            position=_vector(eye), target=_vector(target), fov_y=walk.fov_y, exposure=self.exposure(index)
        )

    def _prop(self, model: GltfScene, rng: np.random.Generator) -> Prop:
        low, high = model.bounds
        height = float(high[1] - low[1])
        size = 1.0
        if not _KEPT[0] <= height <= _KEPT[1]:
            size = rng.uniform(0.5, 1.2) / max(float((high - low).max()), 1e-6)
        start = self._ground.near(rng, self._focus, 0.0, 2.0)
        end = self._ground.near(rng, start, 1.0, 5.0)
        kind = rng.integers(4)  # still, spinning, sliding, hopping along
        slides = kind >= 2 and self._ground.clear(start, end)
        return Prop(
            model=model,
            size=size,
            course=Course(start, end if slides else start, rng.uniform(0.5, 6.0), rng.uniform(0.0, 2.0)),
            yaw=rng.uniform(0.0, 2.0 * np.pi),
            spin=rng.choice([-1.0, 1.0]) * rng.uniform(0.3, 5.0) if kind in (1, 3) else 0.0,
            hop=rng.uniform(0.2, 0.8) if kind == 3 else 0.0,
            clip=int(rng.integers(max(1, len(model.clips)))),
            glow=Flicker(rng.uniform(0.0, 0.9), rng.uniform(1.0, 12.0), rng.random(), bool(rng.integers(2))),
        )

    def _path(self, rng: np.random.Generator) -> tuple[Values, Values]:
        """Return where a camera walks from and to: past the props, not through them, if there is a way."""
        props = np.array([prop.course.at_share(s) for prop in self._props for s in (0.0, 0.5, 1.0)])
        for _ in range(_TRIES):
            start = self._ground.near(rng, self._focus, 2.0, 5.0)
            end = self._ground.near(rng, start, 0.5, 4.0)
            line = start + np.linspace(0.0, 1.0, 9)[:, None] * (end - start)
            apart = [np.hypot(*(line - thing)[:, [0, 2]].T).min() for thing in (self._focus, *props)]
            if min(apart) > 1.0 and self._ground.clear(start, end):
                return start, end
        return start, start

    def _walk(self, rng: np.random.Generator) -> Walk:
        start, end = self._path(rng)
        eyes = np.array([0.0, rng.uniform(0.5, 1.8), 0.0])
        target = self._focus + np.array([0.0, rng.uniform(0.3, 1.0), 0.0])
        pan = (rng.uniform(0.2, 0.8), rng.uniform(0.1, 0.6)) if rng.random() < 0.5 else (0.0, 0.0)
        course = Course(start + eyes, end + eyes, rng.uniform(0.2, 3.0), rng.uniform(0.0, 2.0))
        return Walk(course, target, pan, rng.uniform(0.0, 0.03), rng.uniform(40.0, 75.0))


def compose(folder: Path | str, seed: int, frames: int = 32, frame_rate: float = 30.0) -> Composition:
    """Draw a sequence from the files (.glb, .gltf) in a folder and below, with its panoramas (.hdr) if any.

    Args:
        folder: with files in metres, y up.
        seed: the same files and seed are the same sequence.
        frames: how many, 1 or more.
        frame_rate: frames a second.

    Raises:
        SceneError: there is no file in the folder.
        GltfError: one of those drawn is broken or not supported.
    """
    if frames < 1 or not frame_rate > 0.0:
        raise SceneError("frames, frame_rate", got=(frames, frame_rate), want="1 or more, and more than 0")
    return Composition(Path(folder), seed, frames, frame_rate)


def triangles_of(instances: tuple[Instance, ...]) -> Values:
    """Return the triangles (m, 3, 3) of rigid meshes, in the world."""
    parts = [np.zeros((0, 3, 3))]
    for instance in instances:
        if instance.mesh.skin is None:
            model = instance.model
            moved = instance.mesh.positions.astype(np.float64) @ model[:3, :3].T + model[:3, 3]
            parts.append(moved[instance.mesh.indices])
    return np.concatenate(parts)


def _drawn(folder: Path, rng: np.random.Generator) -> Drawn:
    """Read files in random order until there is a stage and enough props."""
    paths = sorted(path for kind in ("*.glb", "*.gltf") for path in folder.rglob(kind))
    if not paths:
        raise SceneError("folder", got=f"{folder}, without any .glb or .gltf", want="at least one such file")
    files: list[Path] = []
    stage: tuple[tuple[Instance, ...], Ground] | None = None
    props: list[GltfScene] = []
    for index in rng.permutation(len(paths)):
        if stage and len(props) == MODELS:
            break
        model = GltfScene(paths[index])
        if not _is_stage(model) and len(props) < MODELS:
            props.append(model)
            files.append(model.path)
        elif _is_stage(model) and stage is None:
            instances = model.instances(0.0, 0.0, _STILL)
            stage = _roomy(instances)
            files += [model.path] if stage else []
    if stage is None:
        floor = (_floor(rng),)
        stage = floor, Ground(triangles_of(floor))
    return Drawn(tuple(files), props, *stage)


def _roomy(instances: tuple[Instance, ...]) -> tuple[tuple[Instance, ...], Ground] | None:
    """Return a stage and its ground, None if nobody could stand on it."""
    triangles = triangles_of(instances)
    ground = Ground(triangles) if len(triangles) else None
    return (instances, ground) if ground is not None and ground.free.any() else None


def _is_stage(model: GltfScene) -> bool:
    return float(np.ptp(model.bounds, axis=0)[[0, 2]].max()) >= STAGE


def _floor(rng: np.random.Generator) -> Instance:
    """Return 20 x 20 m of tiles."""
    corners = np.array([[-10, 0, -10], [10, 0, -10], [-10, 0, 10], [10, 0, 10]], np.float32)
    normals = np.tile(np.array([0, 1, 0], np.float32), (4, 1))
    uv, faces = corners[:, [0, 2]].copy(), np.array([[0, 2, 1], [1, 2, 3]], np.uint32)
    mesh = Mesh(
        positions=corners, normals=normals, uv=uv, indices=faces,
        tangents=tangents_of(corners, normals, uv, faces),
    )  # fmt: skip
    tiles = rng.uniform(60.0, 220.0, (2, 2, 3)).repeat(32, axis=0).repeat(32, axis=1)
    tiles += rng.normal(0.0, 12.0, (64, 64, 1))
    texture = Texture(pixels=tiles.clip(0.0, 255.0).astype(np.uint8))
    return Instance(mesh=mesh, material=Material(base_color_texture=texture, roughness=0.6), model=_STILL)


def _vector(values: Values) -> Vector:
    x, y, z = (float(value) for value in values)
    return x, y, z
