"""Import Blender's multilayer EXR frames: the passes Combined, Depth, Vector, Normal and diffuse colour."""

import json
from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias, Unpack, get_args

import msgspec
import numpy as np
from numpy.typing import NDArray

from supersampler.arguments import checked_choice
from supersampler.conventions import Conventions, RawFrame, camera_motion, jittered_projection
from supersampler.conventions.conventions import checked_conventions
from supersampler.errors import ArgumentError, ShotError
from supersampler.frame import GBUFFER_CHANNELS, Array, Float32
from supersampler.io.files import SHOT_FRAMES, check_inside, write_text
from supersampler.io.images import read_exr, read_header, scene_linear_space
from supersampler.io.json_files import FileSize, Rate, Text, check_sizes, check_version, read_typed
from supersampler.io.shot.channels import SequenceOptions, first_file, import_channels
from supersampler.io.shot.format import LARGEST_NUMBER, FrameEntry, ShotInfo, check_size, take
from supersampler.io.shot.named_channels import blended_and_ignored, late_channels, of_first_view
from supersampler.io.shot.numbered import numbered_files
from supersampler.io.shot.shot import Shot

RENDER_FILE = "render.json"
_VERSION = 1


_Number = Annotated[int, msgspec.Meta(ge=0, le=LARGEST_NUMBER)]
_Marker = Annotated[int, msgspec.Meta(ge=-LARGEST_NUMBER, le=LARGEST_NUMBER)]
_Row = tuple[float, float, float, float]
Rows: TypeAlias = tuple[_Row, _Row, _Row, _Row]
"""A matrix, row by row."""
_Stops = Annotated[float, msgspec.Meta(ge=-32.0, le=32.0)]
Denoising: TypeAlias = Literal["temporal", "frame", "off"]
"""Denoising of a render: by Cycles and over time, at full size; by Cycles only; or none."""
Guides: TypeAlias = Literal["surface", "denoising"]
"""Passes of the G-buffers: Diffuse Color and Normal, or Denoising Albedo and Denoising Normal."""


class RenderedCamera(msgspec.Struct, frozen=True, omit_defaults=True):
    """The camera of one frame, as Blender evaluates it.

    Attributes:
        camera: (4, 4) projection @ view with lens shift and jitter, row-major, acting on column vectors; clip
            space from -1 to 1, y up.
        shift: (x right, y up) of the lens, in render pixels, without jitter.
        seconds: wall time of the frame's render.
        world: (4, 4) camera to world, without scale, looking along -z; None in files of older versions.
    """

    camera: Rows
    shift: tuple[float, float]
    seconds: float = 0.0
    world: Rows | None = None

    def __post_init__(self) -> None:
        if not np.linalg.det(self.camera):
            raise ValueError("the camera is not an invertible matrix")

    @property
    def matrix(self) -> NDArray[np.float64]:
        """The camera as an array."""
        return np.array(self.camera)

    @property
    def denoising_axes(self) -> NDArray[np.float64]:
        """(3, 3) world directions of the axes of Denoising Normal, as columns: right, up, forward."""
        _, y, z, w = self.matrix[:, :3]
        forward = w if w.any() else z  # w is 0 for an orthographic camera
        forward = forward / np.linalg.norm(forward)
        up = y - (y @ forward) * forward
        up = up / np.linalg.norm(up)
        return np.stack([np.cross(forward, up), up, forward], axis=-1)


class ColorManagement(msgspec.Struct, frozen=True):
    """Blender's colour management: names, exposure in stops, and gamma."""

    display: Text
    view: Text
    look: Text
    exposure: _Stops
    gamma: _Stops


class RenderedScene(msgspec.Struct, frozen=True, kw_only=True):
    """Description of the rendered scene, as Blender reports it.

    Attributes:
        name: name of the scene.
        blender: Blender's version.
        engine: Blender's name of the render engine.
        layer: name of the view layer.
        numbers: numbers of the scene's first and last frame.
        frame_rate: frames per second.
        render_size: (width, height) of the frames.
        display_size: (width, height) of the final images.
        samples: samples per pixel in Cycles.
        denoise: denoising of the render. "temporal": the frames have display size and no jitter.
        has_strokes: whether the frames show Grease Pencil or Freestyle; their noisy colours do not.
        cuts: numbers of the frames at which the camera changes.
        view: the scene's colour management.
        ocio: file of Blender's OpenColorIO configuration.
        linear: name of the linear space of the pixels in that configuration. Since Blender 5, it is a
            property of the .blend file.
        interop_id: its `colorInteropID`; "" before Blender 5.
    """

    name: Text
    blender: Text
    engine: Text
    layer: Text
    numbers: tuple[_Number, _Number]
    frame_rate: Rate
    render_size: FileSize
    display_size: FileSize
    samples: int | None = None
    denoise: Denoising = "off"
    has_strokes: bool = False
    cuts: Annotated[tuple[_Marker, ...], msgspec.Meta(max_length=SHOT_FRAMES)] = ()
    view: ColorManagement
    ocio: Text
    linear: Text = "scene_linear"
    interop_id: str = ""

    def __post_init__(self) -> None:
        check_sizes(self.render_size, self.display_size)


class RenderRecord(msgspec.Struct, frozen=True, kw_only=True):
    """Content of render.json.

    Attributes:
        settings: everything that the frames depend on; JSON values.
        first: number of the first frame.
        jitter: (x right, y down) of the first frames, in render pixels; later frames repeat them.
        scene: None until Blender has opened the file.
        frames: cameras of the complete frames, from the first on.
    """

    version: int = _VERSION
    settings: dict[str, Any]
    first: _Number
    jitter: Annotated[tuple[tuple[float, float], ...], msgspec.Meta(min_length=1, max_length=SHOT_FRAMES)]
    scene: RenderedScene | None = None
    frames: Annotated[tuple[RenderedCamera, ...], msgspec.Meta(max_length=SHOT_FRAMES)] = ()

    def write(self, folder: Path) -> None:
        """Write render.json into the folder; ShotError if the disk refuses."""
        content = msgspec.to_builtins(self)
        frames = ",\n".join("    " + json.dumps(camera) for camera in content.pop("frames"))
        head = "".join(f'  "{key}": {json.dumps(value)},\n' for key, value in content.items())
        write_text(folder / RENDER_FILE, f'{{\n{head}  "frames": [\n{frames}\n  ]\n}}\n')


def read_render_record(folder: Path) -> RenderRecord:
    """Read render.json of a folder; ShotError if it is missing, damaged or of another version."""
    path, hint = folder / RENDER_FILE, "Render it again, or update supersampler."
    check_version(path, _VERSION, hint)
    return read_typed(path, RenderRecord, hint)


_DEPTH = ("Depth.Z", "Z.Z", "Z")
_NEEDED = "Turn on the passes Combined, Z and Vector, and save as OpenEXR MultiLayer."


def import_blender(
    folder: Path | str,
    *,
    layer: str | None = None,
    reference: str | None = None,
    conventions: Conventions | None = None,
    guides: Guides = "surface",
    **options: Unpack[SequenceOptions],
) -> Shot:
    """Open a folder of Blender's OpenEXR MultiLayer frames as a Shot.

    Colour is the Combined pass. Its alpha and the layer's other passes that can be blended (DiffDir, Emit,
    Mist) are AOVs; `Shot.ignored_channels` lists the rest. Depth is Depth or Z, motion is Vector X and Y,
    motion to the next frame Vector Z and W. Normal and DiffCol are G-buffers if they exist.
    `Shot.is_denoised` is True if the layer has a Noisy Image pass, which Cycles writes when it denoises;
    `Shot.samples` is what Cycles writes into the header.
    Jitter the camera by `shift_x = x / max(w, h)`, `shift_y = -y / max(w, h)`, and render with a
    Blackman-Harris filter of 0.01 pixels: one sample at that point.

    Args:
        folder: folder of the frames.
        layer: name of the view layer; required if several layers have all passes.
        reference: pattern of the references' files in the folder, such as `reference/*.exr`.
        conventions: by default `Conventions.blender()`; jitter in pixels, y down, pixel centre + jitter.
        guides: "denoising" takes G-buffers from the passes Denoising Albedo and Denoising Normal if they
            exist. They show surfaces seen in mirrors and through glass. The normals are in world space if the
            layer also has Normal, otherwise in camera space.
        options: see `import_channels`.

    Raises:
        ShotError: files or passes are missing, or differ in size.
        ArgumentError: several layers have all passes, or `layer` is none of them.
    """
    folder = Path(folder)
    first = first_file(folder, options)
    header = read_header(first)
    types, other_views = of_first_view(header)
    channel_map = layer_map(first, types, layer, guides=checked_choice("guides", guides, get_args(Guides)))
    layer = channel_map["color"][0].removesuffix(".Combined.R")
    conventions = Conventions.blender() if conventions is None else checked_conventions(conventions)
    if conventions.motion_jittered:  # Eevee: motion to the next frame contains that frame's jitter
        channel_map.pop("motion_next", None)
    if reference is not None:
        follow_links = options.get("follow_links", False)
        image = next(iter(numbered_files(folder, reference, follow_links=follow_links).values()))
        channel_map["reference"] = [f"{reference}:{channel}" for channel in _reference_channels(image)]
    names = aov_names(channel_map.get("aovs", ()), layer)
    shot = import_channels(folder, channel_map, conventions=conventions, aov_names=names, **options)
    used = {name for names in channel_map.values() for name in names}
    shot.ignored_channels[:] = [name for name in _of_layer(types, layer) if name not in used] + other_views
    shot.late_channels = late_channels(shot, header)
    noisy = _channels(layer, "Noisy Image", "RGB")
    if {*noisy} <= types.keys():
        shot.is_denoised, shot.noisy_channels = True, tuple(noisy)
    shot.samples = _samples(header.metadata.get(f"cycles.{layer}.samples"))
    if channel_map.get("normal") == _channels(layer, "Denoising Normal", "XYZ"):
        surface = _channels(layer, "Normal", "XYZ")
        if {*surface} <= types.keys():
            return shot.with_conversion(partial(_to_world_normals, surface))
    return shot


def _samples(entry: object) -> int | None:
    """Return samples per pixel from an entry of the header, a text; None where it is missing or damaged."""
    text = str(entry)
    return int(text) if text.isdecimal() and int(text) > 0 else None


def _to_world_normals(surface: Sequence[str], path: Path, raw: RawFrame) -> RawFrame:
    """Return a frame with the normals of Denoising Normal in world space.

    The pass Normal (channels `surface` of the file) has the normals of directly visible surfaces in world
    space. The camera's rotation is the orthogonal matrix that fits both passes best.
    """
    if raw.gbuffer is None or "normal" not in raw.gbuffer:
        return raw
    stored = take(path, read_exr(path, only=surface, outside={}), surface)
    normal = raw.gbuffer["normal"]
    world, camera = (
        np.nan_to_num(each, nan=0.0, posinf=0.0, neginf=0.0).reshape(-1, 3).astype(np.float64)
        for each in (stored, normal)
    )
    weight = np.ones((len(camera), 1))
    for _ in range(3):  # with less weight of pixels that do not fit: mirrors, glass
        u, _, v = np.linalg.svd(world.T @ (weight * camera))
        rotation = u @ v
        weight = 1.0 / (1e-4 + np.square(world - camera @ rotation.T).sum(axis=1, keepdims=True))
    turned = (normal @ rotation.T).astype(np.float32)
    return replace(raw, gbuffer={**raw.gbuffer, "normal": turned})


def is_blender(channels: Iterable[str]) -> bool:
    """Return whether a file with these channels has a layer with all required passes."""
    return bool(_complete_layers(list(channels)))


def layer_map(
    path: Path,
    types: Mapping[str, str],
    layer: str | None,
    *,
    motion: bool = True,
    guides: Guides = "surface",
) -> dict[str, list[str]]:
    """Return the channels of a view layer's passes by our names, from the types of a file's channels.

    `motion` is whether Vector is needed; for `guides` see `import_blender`.

    Raises:
        ShotError: no layer has all needed passes.
        ArgumentError: several layers have and `layer` is None, or `layer` has not.
    """
    channels = list(types)
    layers = _complete_layers(channels, motion=motion)
    if not layers:
        raise ShotError(path, f"has no layer with all passes; it has {', '.join(channels)}", _NEEDED)
    if layer is None and len(layers) > 1:
        hint = "Several have all passes."
        raise ArgumentError("layer", got="left out", want=f"one of {', '.join(layers)}", hint=hint)
    layer = layers[0] if layer is None else layer
    if layer not in layers:
        raise ArgumentError("layer", got=repr(layer), want=f"one of {', '.join(layers)}", hint=_NEEDED)
    depth = next(name for name in _DEPTH if f"{layer}.{name}" in channels)
    wanted = {
        "color": [_channels(layer, "Combined", "RGB")],
        "depth": [[f"{layer}.{depth}"]],
        "motion": [_channels(layer, "Vector", "XY")],
        "motion_next": [_channels(layer, "Vector", "ZW")],
        "normal": [_channels(layer, "Normal", "XYZ")],
        "base_color": [
            _channels(layer, name, "RGB") for name in ("Diffuse Color", "DiffCol")
        ],  # Blender 5, 4
    }
    if guides == "denoising":
        wanted["normal"].insert(0, _channels(layer, "Denoising Normal", "XYZ"))
        wanted["base_color"].insert(0, _channels(layer, "Denoising Albedo", "RGB"))
    found: dict[str, list[str]] = {}
    for name, groups in wanted.items():
        if there := [group for group in groups if {*group} <= {*channels}]:
            found[name] = there[0]
    alpha = f"{layer}.Combined.A"
    of_layer = {name: types[name] for name in _of_layer(channels, layer) if name != alpha}
    aovs = [name for name in (alpha,) if name in channels] + blended_and_ignored(of_layer, found)[0]
    return found | ({"aovs": aovs} if aovs else {})


def _channels(layer: str, name: str, axes: str) -> list[str]:
    return [f"{layer}.{name}.{axis}" for axis in axes]


def aov_names(channels: Iterable[str], layer: str) -> list[str]:
    """Return the names of AOVs in output files: A is alpha, GlossDir.R a pass."""
    return [name.removeprefix(f"{layer}.").removeprefix("Combined.") for name in channels]


def _layers(channels: Iterable[str]) -> list[str]:
    """Return the names of the layers with colour, in the file's order."""
    return [name.removesuffix(".Combined.R") for name in channels if name.endswith(".Combined.R")]


def _of_layer(channels: Iterable[str], layer: str) -> list[str]:
    """Return the channels of a layer; those of a layer "Fg.Hero" are not of "Fg"."""
    others = tuple(f"{name}." for name in _layers(channels) if name.startswith(f"{layer}."))
    return [name for name in channels if name.startswith(f"{layer}.") and not name.startswith(others)]


def _complete_layers(channels: Sequence[str], *, motion: bool = True) -> list[str]:
    """Return the names of the layers with colour, depth and, if needed, motion, in the file's order."""
    return [
        layer
        for layer in _layers(channels)
        if (not motion or f"{layer}.Vector.X" in channels)
        and any(f"{layer}.{depth}" in channels for depth in _DEPTH)
    ]


def _reference_channels(path: Path) -> list[str]:
    """Return the colour channels of a reference: a layer's Combined pass, or plain R, G, B."""
    channels = list(read_header(path).types)
    for name in channels:
        if name == "R" or name.endswith(".Combined.R"):
            return [f"{name.removesuffix('R')}{axis}" for axis in "RGB"]
    hint = "A reference has R, G, B or Combined."
    raise ShotError(path, f"has no colour; it has {', '.join(channels)}", hint)


_SKY = 1e10  # Z of the background
_ROUNDING = 1e-5  # of Blender's matrices


def import_render(folder: Path | str) -> Shot:
    """Open the frames that `supersampler blender` has rendered into a folder, as a Shot.

    Raises:
        ShotError: render.json is missing or damaged, or lists no frame; or a frame is a link out of the
            folder.
    """
    folder = Path(folder)
    record = read_render_record(folder)
    if not record.frames:
        raise ShotError(folder, "has no complete frame", "Give `supersampler blender` again: it continues.")
    check_inside(folder, (folder / frame_file(record.first + index) for index in range(len(record.frames))))
    return rendered_shot(folder, record, len(record.frames), record.frames.__getitem__)


def rendered_shot(
    folder: Path,
    record: RenderRecord,
    count: int,
    camera_of: Callable[[int], RenderedCamera],
    stop_waiting: Callable[[], None] = lambda: None,
) -> Shot:
    """Return a Shot of `count` frames, which may still be rendering.

    `camera_of` returns the camera of a frame, by its index, when its file is complete, and raises ShotError
    if the frame will never be complete. `stop_waiting` makes a waiting call raise it, too.

    Vectors are corrected, from measurements with Blender 4.5. Cycles omits the change of the lens shift and
    the motion of the sky. Eevee includes both, and the change of the jitter. The camera's motion replaces
    vectors where there are none, in Workbench and in Cycles with motion blur, and where Cycles writes wrong
    ones, while an orthographic camera moves. Frames that were rendered to be denoised have Denoising Albedo
    and Denoising Normal, in world space, as G-buffers.
    """
    scene, first, jitter = record.scene, record.first, record.jitter
    if scene is None:
        raise ShotError(folder / RENDER_FILE, "does not describe the scene", "Render it again.")
    info = ShotInfo(
        name=scene.name,
        render_size=scene.render_size,
        display_size=scene.display_size,
        frame_rate=scene.frame_rate,
        conventions=Conventions.blender(),
        first_number=first,
        color_space=scene_linear_space(scene.ocio, scene.interop_id),
    )
    entries = [
        FrameEntry(
            file=frame_file(first + i),
            jitter=jitter[i % len(jitter)],
            reset=i == 0 or first + i in scene.cuts,
        )
        for i in range(count)
    ]

    def read_raw(index: int, gbuffers: Collection[str] | None) -> RawFrame:
        now, before = camera_of(index), None if entries[index].reset else camera_of(index - 1)
        path = folder / entries[index].file
        arrays, names, shot.ignored_channels[:] = _arrays(path, scene, gbuffers)
        if scene.denoise == "temporal" and "normal" in arrays:
            arrays["normal"] = (arrays["normal"] @ now.denoising_axes.T).astype(np.float32)
        jitters = entries[index].jitter, entries[max(0, index - 1)].jitter
        motion = None if before is None else _motion(path, arrays, scene.engine, (now, before), jitters)
        motion_next = None
        is_last = index + 1 == count or entries[index + 1].reset
        if scene.denoise == "temporal" and not is_last and (gbuffers is None or "motion_next" in gbuffers):
            motion_next = _camera_corrected(
                path,
                arrays,
                "motion_next",
                (now, camera_of(index + 1)),
                (jitters[0], entries[index + 1].jitter),
            )
        return RawFrame(
            color=arrays["color"],
            depth=arrays["depth"],
            motion=np.zeros((*arrays["depth"].shape, 2), np.float32) if motion is None else motion,
            motion_next=motion_next,
            gbuffer={name: arrays[name] for name in GBUFFER_CHANNELS if name in arrays} or None,
            aovs=arrays.get("aovs"),
            aov_names=names,
        )

    color = f"{scene.layer}.Combined.R"
    shot = Shot(
        folder, info, entries, read_raw, wait=camera_of, stop_waiting=stop_waiting, color_channel=color
    )
    shot.is_denoised = scene.denoise != "off"
    if scene.denoise == "temporal" and not scene.has_strokes:
        shot.noisy_channels = tuple(_channels(scene.layer, "Noisy Image", "RGB"))
    shot.samples = scene.samples
    return shot


def frame_file(number: int) -> str:
    """Return the name of a frame's file."""
    return f"{number:04d}.exr"


def _arrays(
    path: Path, scene: RenderedScene, gbuffers: Collection[str] | None
) -> tuple[dict[str, Array], list[str], tuple[str, ...]]:
    """Return the arrays of a frame, the names of its AOVs, and its channels that are not read."""
    types = read_header(path).types
    guides: Guides = "denoising" if scene.denoise == "temporal" else "surface"
    names = layer_map(path, types, scene.layer, motion=False, guides=guides)
    used = {channel for channels in names.values() for channel in channels}
    ignored = tuple(name for name in types if name not in used)
    if scene.denoise != "temporal" or (gbuffers is not None and "motion_next" not in gbuffers):
        names.pop("motion_next", None)
    aovs = names.get("aovs", [])
    for name in GBUFFER_CHANNELS:
        if gbuffers is not None and f"gbuffer_{name}" not in gbuffers:
            names.pop(name, None)
    only = [channel for channels in names.values() for channel in channels]
    channels = read_exr(path, only=only, outside={names["depth"][0]: _SKY})
    check_size(path, channels, scene.render_size)
    arrays = {name: take(path, channels, each) for name, each in names.items()}
    arrays["depth"] = arrays["depth"].astype(np.float32, copy=False)
    if len(aovs) == 1:
        arrays["aovs"] = arrays["aovs"][..., None]
    return arrays, aov_names(aovs, scene.layer), ignored


def _motion(
    path: Path,
    arrays: Mapping[str, Array],
    engine: str,
    cameras: tuple[RenderedCamera, RenderedCamera],
    jitters: tuple[tuple[float, float], tuple[float, float]],
) -> Float32:
    """Return the vectors of a frame in Blender's conventions: previous minus current, pixels, y up."""
    if engine.startswith("BLENDER_EEVEE"):
        change = np.subtract(*jitters) * (-1.0, 1.0)  # change of the jitter, y up
        return arrays["motion"].astype(np.float32, copy=False) + change.astype(np.float32)
    return _camera_corrected(path, arrays, "motion", cameras, jitters)


def _camera_corrected(
    path: Path,
    arrays: Mapping[str, Array],
    name: Literal["motion", "motion_next"],
    cameras: tuple[RenderedCamera, RenderedCamera],
    jitters: tuple[tuple[float, float], tuple[float, float]],
) -> Float32:
    """Add the change of the lens shift and the motion of the sky to the vectors of Cycles; pixels, y up.

    Without vectors, or with an orthographic camera that moves, all motion is the camera's. `cameras` and
    `jitters` are those of this and the other frame.
    """
    (now, other), depth = cameras, arrays["depth"]
    size = depth.shape[1], depth.shape[0]
    sign = np.float32(1.0 if name == "motion" else -1.0)  # previous minus current, current minus next
    is_sky = depth >= _SKY
    is_parallel = not now.matrix[3, :3].any()
    if name in arrays and not (is_parallel and _moves(cameras, jitters, size)):
        shift = sign * np.subtract(now.shift, other.shift).astype(np.float32)  # the image moves against it
        motion: Float32 = arrays[name].astype(np.float32, copy=False) + shift
        unknown = is_sky
    else:
        motion, unknown = np.zeros((*depth.shape, 2), np.float32), np.ones(depth.shape, bool)
    if is_parallel:
        unknown = unknown & ~is_sky  # it has a single colour
    if not unknown.any():
        return motion
    matrices = [  # without jitter
        jittered_projection(camera.matrix, (-x, -y), size)
        for camera, (x, y) in zip(cameras, jitters, strict=True)
    ]
    if is_parallel:
        buffer, near = _parallel_depth(path, now, np.where(is_sky, 0.0, depth)), None
    else:
        buffer, near = np.divide(1.0, depth, out=np.zeros_like(depth), where=~is_sky), 1.0
    moved = camera_motion(buffer, *matrices, jitter=jitters[0], near=near, clip="minus_one_to_one")
    motion[unknown] = (sign * moved * np.array([1.0, -1.0], np.float32))[unknown]
    return motion


def _moves(
    cameras: tuple[RenderedCamera, RenderedCamera],
    jitters: tuple[tuple[float, float], tuple[float, float]],
    size: tuple[int, int],
) -> bool:
    """Return whether the camera moves, turns or zooms between two frames; jitter and lens shift do not count.

    Cycles writes wrong vectors after the smallest movement, hence the exact comparison.
    """
    if cameras[0].world != cameras[1].world:
        return True
    now, other = (
        jittered_projection(camera.matrix, (-x - camera.shift[0], -y + camera.shift[1]), size)
        for camera, (x, y) in zip(cameras, jitters, strict=True)
    )
    return not np.allclose(now, other, rtol=_ROUNDING, atol=_ROUNDING)


def _parallel_depth(path: Path, camera: RenderedCamera, distance: NDArray[np.floating[Any]]) -> Float32:
    """Return the depth buffer of an orthographic camera, 0 at the near plane and 1 at the far plane."""
    if camera.world is None:
        problem = "has no position of its orthographic camera, which moves: an older version has rendered it"
        raise ShotError(path, problem, "Render the sequence again: --overwrite.")
    world, (*slope, offset) = np.array(camera.world), camera.matrix[2]
    clip = slope @ world[:3, 3] + offset - (slope @ world[:3, 2]) * distance
    result: Float32 = ((clip + 1.0) / 2.0).astype(np.float32)
    return result
