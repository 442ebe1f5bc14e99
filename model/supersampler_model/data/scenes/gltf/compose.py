"""Sequences composed at random from the glTF files in a folder, with procedural objects added.

A file of the size of a room is the static stage; some sequences have a bare floor instead. Smaller files are
props on it, each with its own motion. Wires, fences, leaves, mirrors, moving objects and particles are added.
Camera, lights, exposure and a cut are random, too. Files and seed determine the sequence.
"""

import hashlib
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple
from zlib import crc32

import numpy as np
from OpenImageIO import ImageInput, geterror

from supersampler.io.files import image_size_problem, utf8_path
from supersampler_model.data.errors import SceneError
from supersampler_model.data.scenes import scene as scenes
from supersampler_model.data.scenes.gltf.clutter import add_clutter
from supersampler_model.data.scenes.gltf.document import GltfError, MalformedError, reading
from supersampler_model.data.scenes.gltf.ground import Ground, ground_of, triangles_of
from supersampler_model.data.scenes.gltf.model import GltfScene
from supersampler_model.data.scenes.procedural import lighting, materials, shapes
from supersampler_model.data.scenes.procedural.lighting import Pulse
from supersampler_model.data.scenes.procedural.paths import Place, placed, vector
from supersampler_model.data.scenes.procedural.stage import Stage, hills, skyline
from supersampler_model.data.specs import GLTF, Sequence, SequenceSpec

MIN_STAGE_SIZE = 8.0  # metres: files of this width or depth are stages, smaller ones props
MAX_PROP_FILES, MAX_PROPS = 3, 6  # in one sequence; a file may be used several times
PANORAMA = ".hdr"
_BARE_FLOOR_CHANCE = 0.15  # probability of a bare floor in place of a stage
_VALIDATION_EVERY = 4  # one file in four of each kind is kept for validation
_PROP_HEIGHTS = 0.3, 1.9  # metres; props of other heights are resized
_PROP_RADII = 0.3, 0.9  # metres: minimum and maximum radius of the floor that a prop occupies
_CAMERA_CLEARANCE = 1.0  # metres between cameras and props, where there is room
_TRIES = 16  # of camera paths
_FLOOR_SIZE = 12.0  # metres a side: the part of a bare floor on which objects are placed
_SKY_ROWS = 64  # of a procedural sky
_MIN_DIMMING = 0.12  # of a sky or a panorama
_MAX_RADIANCE = 50.0  # panoramas are clamped to this: their suns would sparkle in every reflection

File = tuple[str, str]
"""A name below the folder, with forward slashes, and the SHA-256 of its content."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Folder:
    """Files to compose sequences of."""

    path: str  # absolute
    stages: tuple[File, ...]  # of the size of a room or larger, with a floor to stand on
    props: tuple[File, ...]  # smaller files
    panoramas: tuple[File, ...]  # of the surroundings (.hdr)

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
        """Split the files into some for training and some for validation; None: none are left for validation.

        If there is only one file of a kind, it is used for training.
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


def read_folder(path: Path, on_left_out: Callable[[str], None] = lambda _: None) -> Folder:
    """Read all files (.glb, .gltf, .hdr) in a folder and below, so that errors occur before rendering.

    Files are in metres, y up. `on_left_out` is called with the reason why a file is not used.

    Raises:
        SceneError: there is no such folder, or no file in it to compose a sequence of.
        GltfError: one of the files is broken or not supported; names it, the primitive and the reason.
    """
    if not path.is_dir():
        want = "a folder of .glb or .gltf files"
        raise SceneError("gltf", got=f"{path}, which is not a folder", want=want)
    stages, props, panoramas = list[File](), list[File](), list[File]()
    for file in sorted(f for f in path.rglob("*") if f.suffix.lower() in (".glb", ".gltf", PANORAMA)):
        name = file.relative_to(path).as_posix()
        if file.suffix.lower() == PANORAMA:
            read_panorama(file)
            panoramas.append((name, _digest(file)))
            continue
        model = GltfScene(file)
        if not _is_stage(model):
            props.append((name, model.digest))
        elif ground_of(_room(model)) is not None:
            stages.append((name, model.digest))
        else:
            size = " x ".join(f"{side:.3g}" for side in np.ptp(model.bounds, axis=0))
            on_left_out(f"{file} is left out: it is {size} m, too large for a prop, and has no free floor.")
    if not stages and not props:
        want = f"at least one .glb or .gltf smaller than {MIN_STAGE_SIZE:g} m, or with room to stand in"
        raise SceneError("gltf", got=f"{path}, without any", want=want)
    return Folder(
        path=str(path.resolve()), stages=tuple(stages), props=tuple(props), panoramas=tuple(panoramas)
    )


def _is_stage(model: GltfScene) -> bool:
    return float(np.ptp(model.bounds, axis=0)[[0, 2]].max()) >= MIN_STAGE_SIZE


def _room(stage: GltfScene) -> tuple[scenes.Instance, ...]:
    return stage.instances(0.0, 0.0, np.eye(4))


def _digest(file: Path) -> str:
    with reading(file):
        return hashlib.sha256(file.read_bytes()).hexdigest()


def read_panorama(path: Path) -> scenes.Environment:
    """Read a panorama (.hdr) whose size is (2 h, h), h a power of two.

    Raises:
        GltfError: it is damaged, too large, or of another size.
    """
    with reading(path):
        with path.open("rb") as file:
            if file.read(2) != b"#?":
                raise MalformedError("the panorama is no .hdr file")
        source = ImageInput.open(utf8_path(path))
        if source is None:
            raise MalformedError(f"the panorama is damaged ({geterror().strip()})")
        spec = source.spec()
        if (problem := image_size_problem(spec.width, spec.height)) is not None:
            raise MalformedError(f"the panorama {problem}")
        pixels = source.read_image(0, 0, 0, 3, "float")
        if pixels is None:
            raise MalformedError(f"the panorama is damaged ({source.geterror().strip()})")
        return scenes.Environment(
            pixels=np.ascontiguousarray(np.clip(pixels, 0.0, _MAX_RADIANCE), np.float32)
        )


def ping_pong(time: float, duration: float) -> float:
    """Return a time in [0, duration] that runs forwards and backwards in turn."""
    if duration <= 0.0:
        return 0.0
    phase = time / duration % 2.0
    return duration * min(phase, 2.0 - phase)


@dataclass(frozen=True, slots=True, eq=False)
class Course:
    """A path back and forth between two positions (3,), slow at both ends, at `speed` m/s on average."""

    start: scenes.Values
    end: scenes.Values
    speed: float
    phase: float = 0.0

    def at(self, time: float) -> scenes.Values:
        """Return the position (3,)."""
        length = max(float(np.linalg.norm(self.end - self.start)), 1e-3)
        return self.between(0.5 - 0.5 * np.cos(np.pi * (self.speed * time / length + self.phase)))

    def between(self, fraction: float) -> scenes.Values:
        """Return the position (3,) at a fraction of the path, 0 at `start` and 1 at `end`."""
        return np.asarray(self.start + fraction * (self.end - self.start))


def wave(depth: float, hertz: float, phase: float = 0.0, *, square: bool = False) -> Pulse:
    """Return a sine or square wave in [1 - depth, 1 + depth]; `phase` is in periods."""

    def factor(time: float) -> float:
        sine = float(np.sin(2.0 * np.pi * (hertz * time + phase)))
        return 1.0 + depth * (float(np.sign(sine)) if square else sine)

    return factor


class HandHeldCamera(NamedTuple):
    """Camera that moves along a course, sways as if held by hand, and looks at a target."""

    course: Course  # of the eye
    target: scenes.Values  # (3,) metres
    pan: tuple[float, float]  # its amplitude, radians, and frequency, hertz
    sway: float  # amplitude, metres
    fov_y: float  # degrees

    def at(self, time: float, exposure: float) -> scenes.Camera:
        """Return the camera."""
        waves = np.sin(time * np.array([[5.1, 6.7, 4.3], [3.7, 7.9, 5.9]]) + np.arange(3.0))
        eye, target = self.course.at(time) + self.sway * waves[0], self.target + self.sway * waves[1]
        angle = self.pan[0] * np.sin(2.0 * np.pi * self.pan[1] * time)
        x, y, z = target - eye
        cos, sin = np.cos(angle), np.sin(angle)
        aim = eye + np.array([cos * x + sin * z, y, cos * z - sin * x])
        return scenes.Camera(position=vector(eye), target=vector(aim), fov_y=self.fov_y, exposure=exposure)


class GltfProp(NamedTuple):
    """The content of a glTF file, with its motion over the ground."""

    model: GltfScene
    size: float  # scale factor
    course: Course  # of the middle of its lower side
    yaw: float  # at time 0, radians
    spin: float  # change of the yaw, radians a second
    hop: float  # height of the jumps, one a second, metres
    clip: int  # index of the animation, which plays back and forth
    glow: Pulse  # factor of the emission

    def instances(self, now: float, before: float) -> tuple[scenes.Instance, ...]:
        """Return the instances at the time `now`, with their state at the time `before`, both in seconds."""
        clips = self.model.clips
        duration = clips[self.clip].duration if clips else 0.0
        return self.model.instances(
            ping_pong(now, duration), ping_pong(before, duration), self._pose(now), self._pose(before),
            clip=self.clip, emission=self.glow(now),
        )  # fmt: skip

    def _pose(self, time: float) -> scenes.Matrix:
        """Return the matrix from the file's space to the world."""
        low, high = self.model.bounds
        matrix = placed(yaw=self.yaw + self.spin * time, size=self.size)
        foot = np.array([(low[0] + high[0]) / 2.0, low[1], (low[2] + high[2]) / 2.0])
        hop = self.hop * abs(np.sin(np.pi * time))
        matrix[:3, 3] = self.course.at(time) + np.array([0.0, hop, 0.0]) - matrix[:3, :3] @ foot
        return matrix


def _lit_stage(rng: scenes.Rng, focus: scenes.Values, panorama: scenes.Environment | None) -> Stage:
    """Return an empty stage with random lights around `focus` (3,); without a panorama, with a random sky."""
    surroundings = _sky(rng) if panorama is None else panorama
    dim = float(np.exp(rng.uniform(np.log(_MIN_DIMMING), 0.0)))  # in the dark the lamps matter more
    environment = scenes.Environment(pixels=(surroundings.pixels * dim).astype(np.float32))
    stage = Stage(environment=environment, exposure=float(dim**-0.6))
    stage.sun = _sun(rng, focus)
    if rng.random() < 0.7:
        place, color, flicker = _lamp(rng, focus, 2.5, 14.0, 0.7)
        stage.spot = lighting.spotlight(place, focus, color, inner=20.0, outer=32.0, pulsing=flicker)
    for _ in range(int(rng.integers(4))):
        place, color, flicker = _lamp(rng, focus, 0.8, 1.5, 0.9)
        stage.points.append(lighting.lamp(place, color, reach=6.0, pulsing=flicker))
    return stage


def _sky(rng: scenes.Rng) -> scenes.Environment:
    """Return a sky above a ground, with a bright side."""
    up = scenes.directions(_SKY_ROWS)
    above, below, side = (rng.uniform(0.3, 1.0) * _tint(rng) for _ in range(3))
    bright = rng.normal(size=3) + np.array([0.0, 1.0, 0.0])
    lobe = np.clip(up @ (bright / np.linalg.norm(bright)), 0.0, 1.0) ** rng.uniform(2.0, 40.0)
    blend = 0.5 + 0.5 * np.tanh(6.0 * up[..., 1:2])
    color = blend * above + (1.0 - blend) * 0.4 * below + rng.uniform(0.5, 4.0) * lobe[..., None] * side
    return scenes.Environment(pixels=color.astype(np.float32))


def _sun(rng: scenes.Rng, focus: scenes.Values) -> Callable[[float], scenes.Sun] | None:
    """Return a sun, mostly steady; None for no sun."""
    height, around = rng.uniform(0.3, 1.3), rng.uniform(0.0, 2.0 * np.pi)
    toward = np.array([np.cos(height) * np.cos(around), np.sin(height), np.cos(height) * np.sin(around)])
    strength = rng.uniform(0.5, 4.0) if rng.random() < 0.7 else 0.0
    color, direction, center = strength * _tint(rng), vector(-toward), vector(focus)
    flicker = wave(rng.uniform(0.0, 0.8) * (rng.random() < 0.3), rng.uniform(0.2, 3.0))
    if strength == 0.0:
        return None
    return lambda t: scenes.Sun(
        direction=direction, color=vector(color * flicker(t)), center=center, radius=12.0
    )


def _lamp(
    rng: scenes.Rng, focus: scenes.Values, height: float, strength: float, max_flicker: float
) -> tuple[Place, scenes.Color, Pulse]:
    """Return path, colour and flicker of a light that moves at about `height` metres above the focus."""
    low, high = (-2.0, 0.8 * height, -2.0), (2.0, 1.2 * height, 2.0)
    course = Course(focus + rng.uniform(low, high), focus + rng.uniform(low, high), rng.uniform(0.3, 4.0))
    depth, hertz, phase = rng.uniform(0.0, max_flicker), rng.uniform(0.5, 8.0), rng.random()
    flicker = wave(depth, hertz, phase, square=rng.random() < 0.3)
    return course.at, vector(rng.uniform(0.5, 1.5) * strength * _tint(rng)), flicker


def _tint(rng: scenes.Rng) -> scenes.Values:
    """Return a colour of mean 1 between candlelight and clear sky."""
    warmth = rng.uniform(-1.0, 1.0)
    color = np.array([1.0 + 0.5 * warmth, 1.0, 1.0 - 0.5 * warmth])
    return np.asarray(color / color.mean())


class Composition(Sequence):
    """A sequence of a folder's files; lights and added objects are procedural."""

    def __init__(self, spec: SequenceSpec) -> None:
        """Read the files of a spec of the family GLTF.

        Raises:
            GltfError: a file is broken, or has changed since the spec was made.
        """
        self.spec = spec
        rng = np.random.default_rng([spec.seed, crc32(spec.family.encode())])
        stages, props, panorama = _read(spec)
        self._room = _room(stages[-1]) if stages else ()
        floor = shapes.plane(_FLOOR_SIZE, _FLOOR_SIZE)
        bare = scenes.Instance(mesh=floor, material=materials.glow((0, 0, 0), 0), model=np.eye(4))
        self._ground = ground = ground_of(self._room) or Ground(triangles_of((bare,)))
        self._focus = ground.spot(rng)
        self.stage = _lit_stage(rng, self._focus, panorama)
        if not stages:
            _add_floor(rng, self.stage)
        count = int(rng.integers(2, MAX_PROPS + 1)) if props else 0
        self._props = [self._prop(props[index % len(props)], rng) for index in range(count)]
        occupied = add_clutter(rng, self.stage, ground, self._focus)
        occupied += [prop.course.between(fraction) for prop in self._props for fraction in (0.0, 0.5, 1.0)]
        self._cameras = [self._camera(rng, np.array([self._focus, *occupied])) for _ in range(2)]
        cuts = spec.frames > 5 and rng.random() < 0.5
        self.starts = (0, int(rng.integers(spec.frames // 3, spec.frames)) if cuts else 0)
        self._exposure = wave(rng.uniform(0.0, 0.4), rng.uniform(0.05, 0.5), rng.random())

    def scene(self, index: int) -> scenes.Scene:
        """Return the stage with the room and the props."""
        scene, now, before = super().scene(index), self.time(index), self.time(index - 1)
        prop_instances = (instance for prop in self._props for instance in prop.instances(now, before))
        return replace(scene, instances=(*self._room, *prop_instances, *scene.instances))

    def camera(self, index: int) -> scenes.Camera:
        """Return the camera of the current shot."""
        camera, time = self._cameras[int(0 < self.starts[1] <= index)], self.time(index)
        return camera.at(time, self.stage.exposure * self._exposure(time))

    def _prop(self, model: GltfScene, rng: scenes.Rng) -> GltfProp:
        low, high = model.bounds
        size = 1.0
        if not _PROP_HEIGHTS[0] <= float(high[1] - low[1]) <= _PROP_HEIGHTS[1]:
            size = rng.uniform(0.5, 1.2) / max(float((high - low).max()), 1e-6)
        start = self._ground.near(rng, self._focus, 0.0, 2.0)
        radius = 0.6 * size * np.ptp(model.bounds, axis=0)[[0, 2]].max()
        self._ground.take(start, float(np.clip(radius, *_PROP_RADII)))
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
        return GltfProp(model, size, course, yaw, spin, hop, clip, glow)

    def _camera(self, rng: scenes.Rng, occupied: scenes.Values) -> HandHeldCamera:
        start, end = self._camera_path(rng, occupied)
        eyes = np.array([0.0, rng.uniform(0.5, 1.8), 0.0])
        target = self._focus + np.array([0.0, rng.uniform(0.3, 1.0), 0.0])
        pan = (rng.uniform(0.2, 0.8), rng.uniform(0.1, 0.6)) if rng.random() < 0.5 else (0.0, 0.0)
        course = Course(start + eyes, end + eyes, rng.uniform(0.2, 3.0), rng.uniform(0.0, 2.0))
        return HandHeldCamera(course, target, pan, rng.uniform(0.0, 0.03), rng.uniform(40.0, 75.0))

    def _camera_path(self, rng: scenes.Rng, occupied: scenes.Values) -> tuple[scenes.Values, scenes.Values]:
        """Return start and end of a camera path with the props in view, away from `occupied` (n, 3)."""
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


def _read(spec: SequenceSpec) -> tuple[list[GltfScene], list[GltfScene], scenes.Environment | None]:
    """Read the stages, the props and the panorama of a sequence, and check that no file has changed."""
    stages, props, panorama = list[GltfScene](), list[GltfScene](), None
    for name, expected in spec.files:
        path = Path(spec.folder or "", name)
        is_panorama = path.suffix.lower() == PANORAMA
        model = None if is_panorama else GltfScene(path)
        if (_digest(path) if model is None else model.digest) != expected:
            problem = "is not the file that this sequence was made with; restore it, or start another set"
            raise GltfError(path, "", problem)
        if model is None:
            panorama = read_panorama(path)
        else:
            (stages if _is_stage(model) else props).append(model)
    return stages, props, panorama


def _add_floor(rng: scenes.Rng, stage: Stage) -> None:
    """Add a floor up to the horizon, and a skyline or hills."""
    if rng.random() < 0.5:
        stage.put(shapes.plane(70.0, 70.0, 0.5), materials.tiles(rng, 8, rng.random()))
        skyline(rng, stage)
    else:
        stage.put(shapes.plane(70.0, 70.0, 0.35), materials.ground(rng, (0.36, 0.36, 0.28), 0.7))
        hills(rng, stage, (0.25, 0.33, 0.15))
