"""Read and write shot.json, the description of a shot's frames. docs/shots.md explains each key."""

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
from supersampler.io.display_transforms import REC709
from supersampler.io.files import IMAGE_CHANNELS, SHOT_FRAMES
from supersampler.io.images import Channel, Metadata, read_exr, read_header, read_image, write_exr
from supersampler.io.json_files import FileSize, Rate, Text, check_sizes, check_version, read_typed

FORMAT_VERSION = 1
FILE_NAME = "shot.json"
LARGEST_NUMBER = 10**9
"""Largest number of a frame in the name of its image; the smallest is its negative."""
_LONGEST = 255  # bytes of a name; no file system takes more
_HINT = "docs/shots.md lists the keys."
_FORBIDDEN = re.compile(r"[\\:\x00-\x1f\ud800-\udfff]")


class ShotInfo(msgspec.Struct, frozen=True, kw_only=True):
    """Properties of all frames of a shot.

    Attributes:
        name: name of the shot.
        render_size: (width, height) of the frames that have no size of their own.
        display_size: (width, height) of the references and display-size buffers; None where there are none.
        frame_rate: frames a second, > 0; None where it is unknown.
        conventions: conventions of the stored colour, depth, motion and jitter.
        license: licence of the images; "" is unknown.
        attribution: names to credit where the images are shown, one line each.
        first_number: number of the first frame in the program that rendered it, at most LARGEST_NUMBER from
            0; images of the shot's frames are named by it and the numbers after it.
        file_names: stem of the names of the source's files, #### for the number, such as `beauty.####`.
        aov_names: names of the AOVs' channels in files of results; empty: they are numbered.
        color_space: linear colour space of the pixels (decoded, where the conventions say sRGB): its name in
            an OpenColorIO config, such as "lin_rec709" and "ACEScg"; or "unknown".
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


class FrameEntry(msgspec.Struct, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """One frame in shot.json.

    Attributes:
        file: EXR file of the render-size channels, relative to the folder, with forward slashes.
        jitter: (x, y) in the shot's conventions.
        reset: True on the first frame after a cut.
        exposure: > 0, multiplies colour before the tone curve; None: it is measured.
        pre_exposure: what the renderer has multiplied the colour by.
        display_file: EXR file of the display-size channels, or None.
        reference: EXR file of the ideal output, or None.
        render_size: (width, height) where it differs from the shot's.
        shaded: False where the frame has no colour (extrapolation).
    """

    file: str
    jitter: tuple[float, float]
    reset: bool = False
    exposure: float | None = None
    pre_exposure: float = 1.0
    display_file: str | None = None
    reference: str | None = None
    render_size: FileSize | None = None
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
    return [name for name in (entry.file, entry.display_file, entry.reference) if name]


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
    for index, entry in enumerate(content.frames):
        for name in (entry.file, entry.display_file, entry.reference):
            if name is not None:
                _check_file(path, f"frames[{index}]", name)
    _check_listed_once(path, content.frames)
    return info, content.frames


def shot_json(info: ShotInfo, entries: Sequence[FrameEntry]) -> str:
    """Return the text of a shot.json, with one line for each key and for each frame."""
    stated = {name: getattr(info, name) for name in ShotInfo.__struct_fields__}
    header = {"version": FORMAT_VERSION, **stated, "conventions": info.conventions.to_json()}
    head = "".join(f'  "{key}": {json.dumps(value, ensure_ascii=False)},\n' for key, value in header.items())
    frames = ",\n".join("    " + json.dumps(entry_json(entry)) for entry in entries)
    return f'{{\n{head}  "frames": [\n{frames}\n  ]\n}}\n'


def entry_json(entry: FrameEntry) -> dict[str, object]:
    """Return a frame's entry as JSON values, without most defaults, so that long files stay readable."""
    item: dict[str, object] = {
        "file": entry.file, "jitter": entry.jitter, "reset": entry.reset, "exposure": entry.exposure,
    }  # fmt: skip
    for key in ("display_file", "reference", "render_size"):
        if getattr(entry, key) is not None:
            item[key] = getattr(entry, key)
    if entry.pre_exposure != 1.0:
        item["pre_exposure"] = entry.pre_exposure
    if not entry.shaded:
        item["shaded"] = False
    return item


def _check_names(path: Path, info: ShotInfo) -> None:
    """Check the names of results: no path, with one field for the number; AOVs that differ from colour."""
    name, aovs = info.file_names, info.aov_names
    if re.fullmatch(r"[^#/]*#{4,}[^#/]*", name) is None or _FORBIDDEN.search(name) or name[0] == ".":
        raise ShotError(
            path, f"file_names is {name!r}; want a name with one ####, such as beauty.####", _HINT
        )
    if len({*aovs, *"RGB"}) != len(aovs) + 3:
        raise ShotError(path, f"aov_names is {aovs}; want names that differ, and are not R, G or B", _HINT)


def _check_file(path: Path, place: str, name: str) -> None:
    """Check a file name, which must be inside the shot's folder: a shot must not reach other files."""
    inner = PurePosixPath(name)
    if not inner.name or inner.is_absolute() or ".." in inner.parts or _FORBIDDEN.search(name):
        want = "a file inside the shot's folder, with forward slashes"
        raise ShotError(path, f"{place} has the file {name!r}; want {want}", _HINT)
    if any(len(part.encode()) > _LONGEST for part in inner.parts):
        raise ShotError(path, f"{place} has a name longer than {_LONGEST} bytes", _HINT)


def _check_listed_once(path: Path, entries: Sequence[FrameEntry]) -> None:
    seen: dict[str, int] = {}
    for index, entry in enumerate(entries):
        for name in files_of(entry):
            if name in seen:
                problem = f"{name} is listed twice: in frame {seen[name]} and frame {index}"
                raise ShotError(path, problem, "Each frame has its own files.")
            seen[name] = index


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
    """Why pixels of a reference are hard to upscale: the classes of Guo et al. 2022, and thin objects.

    Attributes:
        ghost: (H, W) uint8, why the history is not usable: 0 it is usable, 1 the surface was occluded or off
            screen, 2 its lighting has changed.
        alias: (H, W) uint8, why one sample aliases: 0 it does not, 1 an edge of a surface, 2 detail on a
            surface.
        thin: (H, W) uint8, 1 where the pixel holds a part of an object less than about two pixels wide, else
            0; None where that is not known.
    """

    ghost: NDArray[np.uint8]
    alias: NDArray[np.uint8]
    thin: NDArray[np.uint8] | None = None

    def known(self) -> dict[str, NDArray[np.uint8]]:
        """Return the maps that are known, by name."""
        maps = {"ghost": self.ghost, "alias": self.alias}
        return maps if self.thin is None else {**maps, "thin": self.thin}


def read_frame(
    folder: Path,
    entry: FrameEntry,
    render_size: Size,
    display_size: Size | None,
    gbuffers: Collection[str] | None = None,
    *,
    sky: float | None = None,
    aov_names: Sequence[str] = (),
) -> RawFrame:
    """Read one frame as it was stored.

    Args:
        folder: folder of the shot.
        entry: the frame's entry in shot.json.
        render_size: required (width, height) of the render-size file.
        display_size: required (width, height) of the display-size file; None accepts any.
        gbuffers: G-buffers to read, by their names in `ModelInfo.gbuffers`, and "motion_next"; None reads
            all.
        sky: depth of pixels outside of a file's data window; None refuses a data window that is too small.
        aov_names: names of the AOVs in files of results; empty: they are numbered.

    Raises:
        ShotError: a file is missing, damaged, of another size, or lacks a channel; or it has another number
            of AOVs than there are names.
    """
    path = folder / entry.file
    outside = None if sky is None else {DEPTH[0]: sky}
    no_next = () if gbuffers is None or "motion_next" in gbuffers else MOTION_NEXT
    without = (*_unwanted("gbuffer", GBUFFER, gbuffers), *no_next)
    channels = read_exr(path, without=without, outside=outside)
    check_size(path, channels, render_size)
    display_path = folder / (entry.display_file or entry.file)
    unwanted = (*_unwanted("gbuffer_display", _GBUFFER_DISPLAY, gbuffers), *no_next)
    display = {}
    if entry.display_file is not None:
        display = read_exr(display_path, without=unwanted, outside=outside)
    check_size(display_path, display, display_size)
    aovs = take_aovs(path, channels)
    if aovs is not None and aov_names and len(aov_names) != aovs.shape[2]:
        raise ShotError(path, f"has {aovs.shape[2]} AOVs; the shot names {len(aov_names)}")
    motion_file, next_file = (
        (display_path, display) if name in display else (path, channels)
        for name in (MOTION[0], MOTION_NEXT[0])
    )
    return RawFrame(
        color=take(path, channels, COLOR) if entry.shaded else None,
        depth=take(path, channels, DEPTH).astype(np.float32, copy=False),
        motion=take(*motion_file, MOTION),
        motion_next=take(*next_file, MOTION_NEXT) if MOTION_NEXT[0] in next_file[1] else None,
        jitter=entry.jitter,
        reset=entry.reset,
        exposure=entry.exposure,
        pre_exposure=entry.pre_exposure,
        reactive=take(path, channels, REACTIVE) if REACTIVE[0] in channels else None,
        gbuffer=_take_gbuffer(path, channels, GBUFFER),
        gbuffer_display=_take_gbuffer(display_path, display, _GBUFFER_DISPLAY),
        aovs=aovs,
        aov_names=aov_names or None,
    )


def sky_depth(conventions: Conventions) -> float:
    """Return the depth of the sky: of pixels that a file's data window does not have."""
    if conventions.depth == "linear":
        return math.inf if conventions.far is None else conventions.far
    return 1.0 if conventions.depth.startswith("forward") else 0.0


def read_reference(path: Path, display_size: Size | None, names: Sequence[str] = COLOR) -> Float32:
    """Read a reference image as (H, W, 3) float32."""
    channels = read_image(path, only=names, outside={})
    check_size(path, channels, display_size)
    return take(path, channels, names).astype(np.float32, copy=False)


def read_classes(path: Path, display_size: Size | None) -> ClassMaps | None:
    """Read the class maps in a reference's file; None where it has none."""
    channels = read_exr(path, only=CLASSES, outside={})
    check_size(path, channels, display_size)
    if not channels:
        return None
    names = CLASSES if CLASSES[2] in channels else CLASSES[:2]
    maps = [take(path, channels, (name,)) for name in names]
    for name, array in zip(names, maps, strict=True):
        if not ((array >= 0) & (array <= np.iinfo(np.uint8).max)).all():  # NaN is neither
            raise ShotError(path, f"channel {name} holds other values than classes, 0 to 255")
    return ClassMaps(*(array.astype(np.uint8) for array in maps))


def read_truth(path: Path, display_size: Size | None) -> dict[str, Array]:
    """Read the planes of truth in a reference's file, by name; none where it has none."""
    names = [name for name in read_header(path).types if name.startswith(TRUTH)]
    channels = read_exr(path, only=names, outside={})
    check_size(path, channels, display_size)
    return {name.removeprefix(TRUTH): take(path, channels, (name,)) for name in channels}


def write_reference(
    path: Path, reference: Array, classes: ClassMaps | None, truth: Mapping[str, Array], compression: str
) -> None:
    """Write a reference image, (H, W, 3), its class maps and planes of truth; ShotError where that fails."""
    channels = _named(COLOR, reference)
    if classes is not None:
        channels |= {f"class.{name}": array.astype(np.float16) for name, array in classes.known().items()}
    channels |= {f"{TRUTH}{name}": array for name, array in truth.items()}
    write_exr(path, channels, compression=compression)


def has_display_file(raw: RawFrame) -> bool:
    """Return whether the frame has display-size G-buffers or motion vectors."""
    return bool(raw.gbuffer_display) or raw.motion.shape[:2] != raw.depth.shape


def write_frame(
    folder: Path,
    entry: FrameEntry,
    raw: RawFrame,
    compression: str,
    *,
    display: bool = True,
    metadata: Metadata | None = None,
) -> None:
    """Write the render-size file, and the display-size file where `entry` names one and `display` is True.

    Raises:
        ShotError: EXR cannot store an array's type, or the disk refused.
    """
    render = {} if raw.color is None else _named(COLOR, raw.color)
    render |= _named(DEPTH, raw.depth)
    if raw.reactive is not None:
        render |= _named(REACTIVE, raw.reactive)
    motion = _named(MOTION, raw.motion)
    if raw.motion.shape[:2] == raw.depth.shape:
        render, motion = render | motion, {}
    if raw.motion_next is not None:
        following = _named(MOTION_NEXT, raw.motion_next)
        if raw.motion_next.shape[:2] == raw.depth.shape:
            render |= following
        else:
            motion |= following
    for name, array in (raw.gbuffer or {}).items():
        render |= _named(GBUFFER[name], array)
    if raw.aovs is not None:
        render |= _named(aov_channels(raw.aovs.shape[2]), raw.aovs)
    large = motion
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
    """Raise ShotError where the channels are not of this (width, height)."""
    for array in channels.values():
        height, width = array.shape
        if size is not None and (width, height) != size:
            hint = "Render it again at that size, or mend the size."
            raise ShotError(path, f"is {width}x{height}; the shot says {size[0]}x{size[1]}", hint)


def _named(names: Sequence[str], array: Array) -> dict[str, Channel]:
    """Return the channels of an array, (h, w) or (h, w, k), by name; the inverse of `take`."""
    planes = [array] if array.ndim == 2 else [array[..., index] for index in range(len(names))]
    return dict(zip(names, planes, strict=True))


def _take_gbuffer(
    path: Path, channels: Mapping[str, Channel], layout: Mapping[str, Sequence[str]]
) -> dict[str, Array] | None:
    """Take each buffer of which any channel exists, so that a missing channel is an error."""
    found = {
        n: take(path, channels, names) for n, names in layout.items() if not channels.keys().isdisjoint(names)
    }
    return found or None


def _unwanted(
    group: str, layout: Mapping[str, Sequence[str]], gbuffers: Collection[str] | None
) -> Iterator[str]:
    """Yield the channels of the G-buffers that are not in `gbuffers`; None includes all."""
    for name, channels in layout.items():
        if gbuffers is not None and f"{group}_{name}" not in gbuffers:
            yield from channels


def take_aovs(path: Path, channels: Mapping[str, Channel]) -> Array | None:
    """Return the AOVs, (h, w, k); None where the file has none."""
    count = sum(name.startswith("aovs.") for name in channels)
    if count == 0:
        return None
    array = take(path, channels, aov_channels(count))
    return array if array.ndim == 3 else array[..., None]


def aov_channels(count: int) -> list[str]:
    """Return the channel names of `count` AOVs."""
    return [f"aovs.{index}" for index in range(count)]
