"""Read and write shot.json and the image files that it lists; docs/shots.md explains each key."""

import json
import math
import re
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Annotated, Any

import msgspec
import numpy as np
from numpy.typing import NDArray

from supersampler.conventions import Conventions, RawFrame
from supersampler.errors import ArgumentError, ShotError
from supersampler.frame import Array, Float32, Size
from supersampler.io.display_transforms import REC709, UNKNOWN_COLOR_SPACE
from supersampler.io.files import IMAGE_CHANNELS, SHOT_FRAMES
from supersampler.io.images import Channel, Metadata, read_exr, read_header, read_image, write_exr
from supersampler.io.json_files import FileSize, Rate, Text, check_sizes, check_version, read_typed

FORMAT_VERSION = 1
FILE_NAME = "shot.json"
LARGEST_NUMBER = 10**9
"""Largest number of a frame in the name of its image; the smallest is its negative."""
_LONGEST = 255  # bytes of a name; file systems accept no longer ones
_HINT = "docs/shots.md lists the keys."
_FORBIDDEN = re.compile(r"[\\:\x00-\x1f\ud800-\udfff]")
FORBIDDEN = r"/\\:*?\"<>|\x00-\x1f\x7f"
"""Characters that names of results do not have, because a system refuses them; for a class of `re`."""
NAME = re.compile(rf"(?!\.)[^#{FORBIDDEN}]*#+[^#{FORBIDDEN}]*")
"""Names of results without extension. One run of # stands for the number and gives its minimum of digits."""


class ShotInfo(msgspec.Struct, frozen=True, kw_only=True):
    """Properties of all frames of a shot.

    Attributes:
        name: name of the shot.
        render_size: (width, height) of the frames without a size of their own.
        display_size: (width, height) of the references and display-size buffers; None if there are none.
        frame_rate: frames per second, > 0; None if unknown.
        conventions: conventions of the stored colour, depth, motion and jitter.
        license: licence of the images; "" is unknown.
        attribution: names to credit where the images are shown, one line each.
        first_number: number of the first frame in the program that rendered it, at most LARGEST_NUMBER from
            0. Output images are numbered from it on.
        file_names: stem of the names of the source's files, #### for the number, such as `beauty.####`.
        aov_names: names of the AOVs' channels in output files; empty: they are numbered.
        color_space: linear colour space of the pixels (after decoding, if they are sRGB): its name in an
            OpenColorIO config, such as "lin_rec709" and "ACEScg"; or "unknown".
    """

    name: str
    render_size: FileSize
    display_size: FileSize | None = None
    frame_rate: Rate | None = None
    conventions: Conventions
    license: str = ""
    attribution: tuple[str, ...] = ()
    first_number: Annotated[int, msgspec.Meta(ge=-LARGEST_NUMBER, le=LARGEST_NUMBER)] = 0
    file_names: Annotated[str, msgspec.Meta(max_length=_LONGEST)] = "####"
    aov_names: Annotated[tuple[Text, ...], msgspec.Meta(max_length=IMAGE_CHANNELS)] = ()
    color_space: Text = REC709

    @property
    def known_color_space(self) -> str | None:
        """The colour space; None if the files have unknown primaries."""
        return None if self.color_space == UNKNOWN_COLOR_SPACE else self.color_space


class FrameEntry(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One frame in shot.json.

    Attributes:
        file: EXR file of the render-size channels, relative to the folder, with forward slashes.
        jitter: (x, y) in the shot's conventions.
        reset: True on the first frame after a cut.
        exposure: > 0, multiplies colour before the tone curve; None: it is measured.
        display_file: EXR file of the display-size channels, or None.
        reference: EXR file of the ideal output, or None.
        render_size: (width, height) if it differs from the shot's.
        pre_exposure: factor that the renderer has already multiplied the colour by.
        shaded: False if the frame has no colour (extrapolation).
    """

    file: str
    jitter: tuple[float, float]
    reset: bool = False
    exposure: float | None = None
    display_file: str | None = None
    reference: str | None = None
    render_size: FileSize | None = None
    pre_exposure: float = 1.0
    shaded: bool = True

    def __post_init__(self) -> None:
        check_sizes(self.render_size)


class _ShotFile(ShotInfo, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """Content of shot.json."""

    version: int
    conventions: dict[str, Any]  # type: ignore[assignment]  # see `Conventions.from_json`
    frames: Annotated[list[FrameEntry], msgspec.Meta(min_length=1, max_length=SHOT_FRAMES)]

    def __post_init__(self) -> None:
        check_sizes(self.render_size, self.display_size)


def is_frame_range(first: int, last: int) -> bool:
    """Return whether images can be named by the numbers from a first to a last."""
    return -LARGEST_NUMBER <= first <= last <= LARGEST_NUMBER


def files_of(entry: FrameEntry) -> list[str]:
    """Return the files of a frame, relative to the shot's folder."""
    return [name for name in (entry.file, entry.display_file, entry.reference) if name is not None]


def check_info(path: Path, info: ShotInfo) -> None:
    """Raise ShotError if a reader would refuse these properties of a shot; its render size is not checked."""
    stated = {name: getattr(info, name) for name in ShotInfo.__struct_fields__}
    frame = {"file": "0000.exr", "jitter": (0.0, 0.0)}
    unknown = {"version": FORMAT_VERSION, "render_size": (1, 1), "conventions": {}, "frames": [frame]}
    try:
        msgspec.convert({**stated, **unknown}, _ShotFile)
    except (msgspec.ValidationError, UnicodeError) as error:
        raise ShotError(path, f"could not be read again: {error}", _HINT) from error
    _check_names(path, info)


def load_shot_json(path: Path) -> tuple[ShotInfo, list[FrameEntry]]:
    """Read and check a shot.json.

    Raises:
        ShotError: it is missing, not JSON, of another version, or an entry is missing, wrong or repeated.
    """
    check_version(path, FORMAT_VERSION, "Write it again, or update supersampler.")
    content = read_typed(path, _ShotFile, _HINT)
    try:
        conventions = Conventions.from_json(content.conventions)
    except ArgumentError as error:
        raise ShotError(path, f'"conventions" is not valid: {error}') from error
    stated = {name: getattr(content, name) for name in ShotInfo.__struct_fields__}
    info = ShotInfo(**{**stated, "conventions": conventions})
    _check_names(path, info)
    seen: dict[str, int] = {}
    for index, entry in enumerate(content.frames):
        for name in files_of(entry):
            _check_file(path, f"frames[{index}]", name)
            if name in seen:
                problem = f"{name} is listed twice: in frame {seen[name]} and frame {index}"
                raise ShotError(path, problem, "Each frame has its own files.")
            seen[name] = index
    return info, content.frames


def shot_json(info: ShotInfo, entries: Sequence[FrameEntry]) -> str:
    """Return the text of a shot.json, with one line for each key and for each frame."""
    stated = {name: getattr(info, name) for name in ShotInfo.__struct_fields__}
    header = {"version": FORMAT_VERSION, **stated, "conventions": info.conventions.to_json()}
    head = "".join(f'  "{key}": {json.dumps(value, ensure_ascii=False)},\n' for key, value in header.items())
    frames = ",\n".join("    " + json.dumps(_entry_json(entry)) for entry in entries)
    return f'{{\n{head}  "frames": [\n{frames}\n  ]\n}}\n'


def _entry_json(entry: FrameEntry) -> dict[str, object]:
    """Return a frame's entry as JSON values, without most defaults, so that long files stay readable."""
    default = FrameEntry(file="", jitter=(0.0, 0.0))
    return {
        key: value
        for key, value in msgspec.structs.asdict(entry).items()
        if key in ("file", "jitter", "reset", "exposure") or value != getattr(default, key)
    }


def _check_names(path: Path, info: ShotInfo) -> None:
    """Check the names of output files and AOVs: no path, one field for the number; no name of colour."""
    name, aovs = info.file_names, info.aov_names
    if NAME.fullmatch(name) is None or "####" not in name:
        raise ShotError(
            path, f"file_names is {name!r}; want a name with one ####, such as beauty.####", _HINT
        )
    if len({*aovs, *"RGB"}) != len(aovs) + 3:
        raise ShotError(path, f"aov_names is {aovs}; want names that differ, and are not R, G or B", _HINT)


def _check_file(path: Path, place: str, name: str) -> None:
    """Raise ShotError unless a file name leads into the shot's folder: a shot must not reach other files."""
    inner = PurePosixPath(name)
    if not inner.name or inner.is_absolute() or ".." in inner.parts or _FORBIDDEN.search(name):
        want = "a file inside the shot's folder, with forward slashes"
        raise ShotError(path, f"{place} has the file {name!r}; want {want}", _HINT)
    if any(len(part.encode()) > _LONGEST for part in inner.parts):
        raise ShotError(path, f"{place} has a name longer than {_LONGEST} bytes", _HINT)


COLOR = ("R", "G", "B")
DEPTH = ("depth.Z",)
MOTION = ("motion.X", "motion.Y")
REACTIVE = ("reactive.Y",)
MOTION_NEXT = ("motion_next.X", "motion_next.Y")
GBUFFER: Mapping[str, Sequence[str]] = {
    "base_color": ("base_color.R", "base_color.G", "base_color.B"),
    "normal": ("normal.X", "normal.Y", "normal.Z"),
    "roughness": ("roughness.Y",),
    "metallic": ("metallic.Y",),
    "specular": ("specular.Y",),
}
_GBUFFER_DISPLAY: Mapping[str, Sequence[str]] = {**GBUFFER, "depth": DEPTH}
CLASSES = ("class.ghost", "class.alias", "class.thin")
"""The third may be missing."""
TRUTH = "truth."
"""Prefix of the channels of `Shot.read_truth` in a reference's file."""


@dataclass(frozen=True, slots=True, eq=False)
class ClassMaps:
    """Classes of pixels that are hard to upscale: the classes of Guo et al. 2022, and thin objects.

    Attributes:
        ghost: (H, W) uint8, usability of the history: 0 usable, 1 the surface was occluded or off screen, 2
            its lighting has changed.
        alias: (H, W) uint8, cause of aliasing: 0 none, 1 an edge of a surface, 2 detail on a surface.
        thin: (H, W) uint8, 1 if the pixel has a part of an object less than about two pixels wide, else 0;
            None if unknown.
    """

    ghost: NDArray[np.uint8]
    alias: NDArray[np.uint8]
    thin: NDArray[np.uint8] | None = None

    def known(self) -> dict[str, NDArray[np.uint8]]:
        """Return the maps that are known, by name."""
        maps = {"ghost": self.ghost, "alias": self.alias}
        return maps if self.thin is None else {**maps, "thin": self.thin}


def read_frame(
    folder: Path, info: ShotInfo, entry: FrameEntry, gbuffers: Collection[str] | None = None
) -> RawFrame:
    """Read the arrays of one frame as stored; for `gbuffers` see `Shot.frames`.

    Raises:
        ShotError: a file is missing, damaged, of another size, or lacks a channel; or the number of AOVs
            differs from the number of their names.
    """
    path, outside = folder / entry.file, {DEPTH[0]: sky_depth(info.conventions)}
    no_next = () if gbuffers is None or "motion_next" in gbuffers else MOTION_NEXT
    without = (*_unwanted("gbuffer", GBUFFER, gbuffers), *no_next)
    channels = read_exr(path, without=without, outside=outside)
    check_size(path, channels, entry.render_size or info.render_size)
    display_path = folder / (entry.display_file or entry.file)
    unwanted = (*_unwanted("gbuffer_display", _GBUFFER_DISPLAY, gbuffers), *no_next)
    display = {}
    if entry.display_file is not None:
        display = read_exr(display_path, without=unwanted, outside=outside)
    check_size(display_path, display, info.display_size)
    count = sum(name.startswith("aovs.") for name in channels)
    if count and info.aov_names and len(info.aov_names) != count:
        raise ShotError(path, f"has {count} AOVs; the shot names {len(info.aov_names)}")
    aovs = take(path, channels, aov_channels(count)) if count else None
    motion_file, next_file = (
        (display_path, display) if name in display else (path, channels)
        for name in (MOTION[0], MOTION_NEXT[0])
    )
    return RawFrame(
        color=take(path, channels, COLOR) if entry.shaded else None,
        depth=take(path, channels, DEPTH).astype(np.float32, copy=False),
        motion=take(*motion_file, MOTION),
        motion_next=take(*next_file, MOTION_NEXT) if MOTION_NEXT[0] in next_file[1] else None,
        reactive=take(path, channels, REACTIVE) if REACTIVE[0] in channels else None,
        gbuffer=_take_gbuffer(path, channels, GBUFFER),
        gbuffer_display=_take_gbuffer(display_path, display, _GBUFFER_DISPLAY),
        aovs=aovs[..., None] if count == 1 and aovs is not None else aovs,
    )


def sky_depth(conventions: Conventions) -> float:
    """Return the depth of the sky, for pixels outside of a file's data window."""
    if conventions.depth == "linear":
        return math.inf if conventions.far is None else conventions.far
    return 1.0 if conventions.depth.startswith("forward") else 0.0


def read_reference(path: Path, display_size: Size | None, names: Sequence[str] = COLOR) -> Float32:
    """Read a reference image as (H, W, 3) float32."""
    channels = read_image(path, only=names, outside={})
    check_size(path, channels, display_size)
    return take(path, channels, names).astype(np.float32, copy=False)


def read_classes(path: Path, display_size: Size | None) -> ClassMaps | None:
    """Read the class maps in a reference's file; None if it has none."""
    channels = read_exr(path, only=CLASSES, outside={})
    check_size(path, channels, display_size)
    if not channels:
        return None
    names = CLASSES if CLASSES[2] in channels else CLASSES[:2]
    maps = [take(path, channels, (name,)) for name in names]
    for name, array in zip(names, maps, strict=True):
        if not ((array >= 0) & (array <= np.iinfo(np.uint8).max)).all():  # False for NaN
            raise ShotError(path, f"channel {name} holds values that are not classes, 0 to 255")
    return ClassMaps(*(array.astype(np.uint8) for array in maps))


def read_truth(path: Path, display_size: Size | None) -> dict[str, Array]:
    """Read the planes of truth in a reference's file, by name."""
    names = [name for name in read_header(path).types if name.startswith(TRUTH)]
    channels = read_exr(path, only=names, outside={})
    check_size(path, channels, display_size)
    return {name.removeprefix(TRUTH): take(path, channels, (name,)) for name in channels}


def write_reference(
    path: Path, reference: Array, classes: ClassMaps | None, truth: Mapping[str, Array], compression: str
) -> None:
    """Write a reference image, (H, W, 3), its class maps and planes of truth; ShotError if that fails."""
    channels = _named(COLOR, reference)
    if classes is not None:
        channels |= {f"class.{name}": array.astype(np.float16) for name, array in classes.known().items()}
    channels |= {f"{TRUTH}{name}": array for name, array in truth.items()}
    write_exr(path, channels, compression=compression)


def write_frame(
    folder: Path,
    entry: FrameEntry,
    raw: RawFrame,
    compression: str,
    *,
    display: bool = True,
    metadata: Metadata | None = None,
) -> None:
    """Write the render-size file, and the display-size file if `entry` names one and `display` is True.

    Raises:
        ShotError: EXR cannot store an array's type, or the disk refused.
    """
    render: dict[str, Channel] = {}
    large: dict[str, Channel] = {}
    for names, given in (
        (COLOR, raw.color), (DEPTH, raw.depth), (REACTIVE, raw.reactive), (MOTION, raw.motion),
        (MOTION_NEXT, raw.motion_next),
    ):  # fmt: skip
        if given is not None:
            file = render if given.shape[:2] == raw.depth.shape else large
            file |= _named(names, given)
    for name, array in (raw.gbuffer or {}).items():
        render |= _named(GBUFFER[name], array)
    if raw.aovs is not None:
        render |= _named(aov_channels(raw.aovs.shape[2]), raw.aovs)
    for name, array in (raw.gbuffer_display or {}).items():
        large |= _named(_GBUFFER_DISPLAY[name], array)
    write_exr(folder / entry.file, render, compression=compression, metadata=metadata)
    if display and entry.display_file is not None:
        write_exr(folder / entry.display_file, large, compression=compression)


def take(path: Path, channels: Mapping[str, Channel], names: Sequence[str]) -> Array:
    """Return channels as one array: (h, w) for one name, (h, w, k) for k names.

    Raises:
        ShotError: one is missing, or holds integers.
    """
    for name in names:
        if name not in channels:
            raise ShotError(path, f"has no channel {name}", f"It has {', '.join(read_header(path).types)}.")
        if channels[name].dtype not in (np.float16, np.float32):
            problem = f"channel {name} is {channels[name].dtype}; want half or float"
            raise ShotError(path, problem, "Write it as 16- or 32-bit floating point.")
    arrays = [channels[name] for name in names]
    return np.ascontiguousarray(arrays[0]) if len(arrays) == 1 else np.stack(arrays, axis=-1)


def check_size(path: Path, channels: Mapping[str, Channel], size: Size | None) -> None:
    """Raise ShotError if the channels are not of this (width, height)."""
    for array in channels.values():
        height, width = array.shape
        if size is not None and (width, height) != size:
            hint = "Render it again at that size, or correct the size."
            raise ShotError(path, f"is {width}x{height}; the shot says {size[0]}x{size[1]}", hint)


def _named(names: Sequence[str], array: Array) -> dict[str, Channel]:
    """Return the channels of an array, (h, w) or (h, w, k), by name; the inverse of `take`."""
    planes = [array] if array.ndim == 2 else [array[..., index] for index in range(len(names))]
    return dict(zip(names, planes, strict=True))


def _take_gbuffer(
    path: Path, channels: Mapping[str, Channel], layout: Mapping[str, Sequence[str]]
) -> dict[str, Array] | None:
    """Return each buffer with at least one channel in the file, so that a missing channel is an error."""
    found = {
        n: take(path, channels, names) for n, names in layout.items() if not channels.keys().isdisjoint(names)
    }
    return found or None


def _unwanted(
    group: str, layout: Mapping[str, Sequence[str]], gbuffers: Collection[str] | None
) -> Iterator[str]:
    """Yield the channels of the G-buffers that are not in `gbuffers`; None contains all."""
    for name, channels in layout.items():
        if gbuffers is not None and f"{group}_{name}" not in gbuffers:
            yield from channels


def aov_channels(count: int) -> list[str]:
    """Return the channel names of `count` AOVs."""
    return [f"aovs.{index}" for index in range(count)]
