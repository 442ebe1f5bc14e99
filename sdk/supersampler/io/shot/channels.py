"""Import EXR, PNG and TIFF sequences in any layout, by a map from our names to their channels."""

import math
import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import chain
from pathlib import Path
from typing import Any, TypeAlias, TypedDict, Unpack

import msgspec
import numpy as np

from supersampler.arguments import as_index, as_number, checked_size, is_row
from supersampler.conventions import Conventions, RawFrame
from supersampler.conventions.conventions import checked_conventions
from supersampler.conventions.encodings import srgb_decoded, srgb_encoded
from supersampler.errors import ArgumentError, ShotError, did_you_mean, shown
from supersampler.frame import GBUFFER_CHANNELS, MAX_AOVS, Array, Float32, Size
from supersampler.io.images import Channel, ImageHeader, exact_rate, read_header, read_image
from supersampler.io.json_files import FileSize, Rate, Text, check_sizes, read_typed
from supersampler.io.shot import format as shot_format
from supersampler.io.shot.id_channels import is_id
from supersampler.io.shot.numbered import Jitter, Range, file_names, numbered_files, of_range, read_jitter
from supersampler.io.shot.shot import Shot

_MAX_BYTES = 4


@dataclass(frozen=True, slots=True)
class Packing:
    """Encoding of a number as a linear function of a float, or of the integer that its bytes form.

    Attributes:
        bytes_each: bytes of a number, 1 to 4, the most significant one first; 0 if it is stored as a float.
        low: number whose bytes are all 0, or that the float 0 stands for.
        high: number whose bytes are all 255, or that the float 1 stands for; it may be less than `low`.
    """

    bytes_each: int
    low: float
    high: float

    def encoded(self, number: float) -> list[float]:
        """Return what the channels store for a number; bytes clamp it to the range."""
        fraction = (number - self.low) / (self.high - self.low)
        if self.bytes_each == 0:
            return [fraction]
        code = round(min(max(fraction, 0.0), 1.0) * (256**self.bytes_each - 1))
        return [byte / 255.0 for byte in code.to_bytes(self.bytes_each, "big")]

    def decoded(self, channels: Array) -> Float32:
        """Return the numbers, (h, w) for one number per pixel, (h, w, n) for n.

        `channels` is (h, w) or (h, w, n * bytes_each), byte / 255, with the bytes of a number side by side.
        Floats are (h, w) or (h, w, n).
        """
        if self.bytes_each == 0:
            return (self.low + channels.astype(np.float32) * (self.high - self.low)).astype(np.float32)
        height, width = channels.shape[:2]
        levels = np.rint(channels.astype(np.float64) * 255.0).reshape(height, width, -1, self.bytes_each)
        weights = 256.0 ** np.arange(self.bytes_each - 1, -1, -1)
        numbers = self.low + (levels @ weights) * ((self.high - self.low) / (255.0 * weights.sum()))
        single: Float32 = numbers.astype(np.float32)
        return single[..., 0] if single.shape[2] == 1 else single


def parse_packing(name: str, value: Mapping[str, Any], count: int) -> tuple[list[str], Packing]:
    """Return the channels of a packed array, in the order of `Packing.decoded`, and its packing.

    `value` is {"bytes": ..., "range": [low, high]}. "bytes" lists the channels of a number, the most
    significant byte first; for `count` > 1 numbers per pixel, it is a list of such lists. Or it is
    {"channels": ..., "range": [low, high]}, with the channel of each number, a float.

    Raises:
        ArgumentError: a key is missing or unknown, or a value is not of this form.
    """
    place, keys = f"channel_map[{name!r}]", ("bytes", "channels", "range")
    for key in value:
        if key not in keys:
            got, hint = f"with {shown(key)}", did_you_mean(key, keys)
            raise ArgumentError(place, got=got, want=f"keys of {', '.join(keys)}", hint=hint)
    if "channels" in value:
        if "bytes" in value:
            raise ArgumentError(place, got="with 'bytes' and 'channels'", want="one of the two")
        channels, bytes_each = _listed_channels(f"{place}['channels']", value["channels"], count), 0
    else:
        listed = [value.get("bytes")] if count == 1 else value.get("bytes")
        lists = listed if isinstance(listed, list | tuple) else []
        sizes = {len(each) if _are_texts(each) else 0 for each in lists}
        if len(lists) != count or len(sizes) != 1 or not 1 <= min(sizes) <= _MAX_BYTES:
            one = f"a list of 1 to {_MAX_BYTES} channels, the most significant byte first"
            want = one if count == 1 else f"{count} lists of equal length, for each number {one}"
            raise ArgumentError(f"{place}['bytes']", got=shown(value.get("bytes")), want=want)
        channels, bytes_each = [channel for each in lists for channel in each], min(sizes)
    ends = value.get("range")
    given = [as_number(end) for end in ends] if isinstance(ends, list | tuple) else []
    numbers = [number for number in given if number is not None and math.isfinite(number)]
    if len(given) != 2 or len(set(numbers)) != 2:
        want = (
            "[low, high], two different finite numbers: for bytes that are all 0 and all 255, or for 0 and 1"
        )
        raise ArgumentError(
            f"{place}['range']", got=shown(ends), want=want, hint="Motion in UV often has [-1, 1]."
        )
    low, high = numbers
    return channels, Packing(bytes_each, low, high)


def _listed_channels(place: str, value: Any, count: int) -> list[str]:
    """Return the names of an array's channels; ArgumentError unless they are `count` texts."""
    texts: list[Any] = list(value) if isinstance(value, list | tuple) else [value]
    if len(texts) != count or not _are_texts(texts):
        raise ArgumentError(place, got=shown(value), want=f"{count} channel names")
    return texts


def _are_texts(value: object) -> bool:
    return isinstance(value, list | tuple) and all(isinstance(text, str) for text in value)


_INTEGERS = {"uint8", "uint16", "int8", "int16"}
_MAPPED = re.compile(r"(.*\.(?:exr|png|tiff?)):(.*)", re.DOTALL | re.IGNORECASE)
_FRAME_RATE = 24.0  # if no file states one
_ALPHA = "A"
"""Alpha of PNG and TIFF."""
MAP_FILE_NAME = "channels.json"


class SequenceOptions(TypedDict, total=False):
    """Options that the importers of numbered files pass on to `import_channels`, which documents them."""

    files: str
    frames: Range | None
    display_size: Size | None
    frame_rate: float | None
    jitter: Jitter | None
    cuts: Sequence[int]
    name: str | None
    color_space: str | None
    follow_links: bool


ChannelMap: TypeAlias = Mapping[str, str | Sequence[str] | Mapping[str, Any]]
_COUNTS: Mapping[str, int] = {
    "color": 3, "depth": 1, "motion": 2, "motion_next": 2, **GBUFFER_CHANNELS, "reference": 3,
}  # fmt: skip
_MOTIONS = {"motion", "motion_next"}
_UNPACKED = ("color", "reference", "aovs")
"""Arrays that are never packed: integers of the first two are sRGB, integers of AOVs are fractions."""
_OPTIONAL = {name: f"gbuffer_{name}" for name in GBUFFER_CHANNELS} | {"motion_next": "motion_next"}
"""Arrays that a reader may omit, and their names in the `gbuffers` of `Shot.frames`."""


def import_channels(
    folder: Path | str,
    channel_map: ChannelMap,
    *,
    conventions: Conventions,
    files: str = "*.exr",
    frames: Range | None = None,
    display_size: Size | None = None,
    frame_rate: float | None = None,
    jitter: Jitter | None = None,
    cuts: Sequence[int] = (),
    name: str | None = None,
    aov_names: Sequence[str] = (),
    color_space: str | None = None,
    follow_links: bool = False,
) -> Shot:
    """Open a folder of EXR, PNG or TIFF frames with other channel names and conventions as a Shot.

    >>> import_channels("renders", {
    ...     "color": ["R", "G", "B"], "depth": "Z", "motion": ["motion/*.exr:R", "motion/*.exr:G"],
    ... }, conventions=Conventions.unreal())

    Frames are ordered by the numbers in their file names. A gap is an error, as motion leads from each frame
    to the previous one.

    Args:
        folder: folder of the files.
        channel_map: our name to EXR channel names: depth (1), motion (2, x first), color (3); optional
            motion_next (2), base_color, normal (3 each), roughness, metallic, specular (1 each), aovs (any
            number), reference (3). `motion/*.exr:R` is channel R of the files of that pattern; `R` alone is a
            channel of `files`. `{"bytes": ..., "range": [low, high]}` describes numbers that are packed into
            8-bit channels, `{"channels": ..., "range": [low, high]}` floats in [0, 1]; see `parse_packing`.
            References have the number of their frame; frames may lack one.
        conventions: conventions of these channels and of the jitter.
        files: pattern of the frames' files: `beauty.####.exr`, `beauty.%04d.exr` or `beauty_*.exr`.
        frames: first and last number of the frames to open, both included; by default all. Only frames
            between them may not be missing. Jitter and cuts are counted from the first file.
        display_size: (width, height) of references and display-size motion; by default the first reference's.
        frame_rate: frames per second, 0.001 to 1000; by default the rate that the first file states,
            otherwise 24.
        jitter: (x, y) of each frame, or a JSON file [[x, y], ...]; by default jitter.json in the folder if it
            exists, otherwise no jitter.
        cuts: indices of the first frames after cuts, from the first file; the first frame is always one.
        name: name of the shot; by default the folder's.
        aov_names: names of the AOVs in output files; by default they are numbered.
        color_space: colour space of the pixels, see `ShotInfo`; by default the space that the first file
            states, see `supersampler.io.images.ImageHeader`.
        follow_links: whether the files and the folders of patterns may be links that lead out of the folder.

    Raises:
        ShotError: files or channels are missing, or differ in number or size; or a link leads out of the
            folder.
        ArgumentError: the map has an unknown name or a wrong number of channels; or the frame rate is out of
            range.
    """
    if not isinstance(channel_map, Mapping):
        raise ArgumentError("channel_map", got=shown(channel_map), want="a mapping of our names to channels")
    conventions = checked_conventions(conventions)
    found = _MappedFiles(Path(folder), channel_map, conventions, files, frames, follow_links=follow_links)
    indices = [as_index(cut) for cut in cuts] if is_row(cuts) else [None]
    if not all(index is not None and 0 <= index <= found.last_index for index in indices):
        raise ArgumentError("cuts", got=shown(cuts), want=f"indices of frames, 0 to {found.last_index}")
    offsets = read_jitter(found.folder, jitter, found.indices)
    found.check_types()
    height, width = found.read_arrays(0).depth.shape
    if display_size is None and found.references:
        image = found.read_reference(found.numbers.index(next(iter(found.references))))
        display_size = (image.shape[1], image.shape[0])
    if display_size is not None:
        display_size = checked_size("display_size", display_size)
    header = read_header(found.frame_file(0))
    if color_space is None:
        found.color_space = header.color_space
    if frame_rate is None:
        frame_rate = header.frame_rate or _FRAME_RATE
    exact_rate(frame_rate)  # raises if it is out of range
    info = shot_format.ShotInfo(
        name=name or found.folder.resolve().name,
        render_size=(width, height),
        display_size=display_size,
        frame_rate=float(frame_rate),
        conventions=conventions,
        first_number=found.numbers[0],
        file_names=file_names(found.frame_file(0), found.frame_pattern),
        aov_names=tuple(aov_names),
        color_space=header.color_space if color_space is None else color_space,
    )
    entries = [
        found.entry(i, offset, reset=i == 0 or index in cuts)
        for i, (index, offset) in enumerate(zip(found.indices, offsets, strict=True))
    ]

    def arrays(index: int, gbuffers: Collection[str] | None) -> RawFrame:
        return found.read_arrays(index, info.render_size, gbuffers)

    def reference(index: int) -> Float32:
        return found.read_reference(index, info.display_size)

    color = found.sources["color"].channels[0] if "color" in found.sources else "R"
    shot = Shot(
        found.folder, info, entries, arrays, reference, color_channel=color, channel_map=channel_map,
        frame_files=found.frame_files,
    )  # fmt: skip
    shot.ignored_channels[:] = found.unmapped_ids(header)
    return shot


def first_file(folder: Path, options: SequenceOptions) -> Path:
    """Return the file of the first frame that these options choose."""
    follow_links = options.get("follow_links", False)
    numbered = numbered_files(folder, options.get("files", "*.exr"), follow_links=follow_links)
    return next(iter(of_range(folder, numbered, options.get("frames")).values()))


def import_described_channels(
    folder: Path | str, *, conventions: Conventions | None = None, **options: Unpack[SequenceOptions]
) -> Shot:
    """Open a folder of EXR frames by its channels.json, which holds arguments of `import_channels`.

    Its keys: channels, conventions; optional display_size, frame_rate, cuts, name, color_space.
    `conventions` and `options` replace the values of the file.

    Raises:
        ShotError: see `import_channels`; or channels.json is missing or wrong.
    """
    folder = Path(folder)
    path = folder / MAP_FILE_NAME
    given = read_typed(path, _MapFile, "docs/shots.md lists the keys.")
    values: dict[str, Any] = {**msgspec.structs.asdict(given), **options}
    stated = values.pop("conventions")
    try:
        used = Conventions.from_json(stated) if conventions is None else conventions
        return import_channels(folder, values.pop("channels"), conventions=used, **values)
    except ArgumentError as error:
        if error.name in options:
            raise
        raise ShotError(path, f"is not valid: {error}") from error


class _MapFile(msgspec.Struct, forbid_unknown_fields=True):
    """Content of channels.json; see `import_channels`."""

    channels: dict[str, Any]
    conventions: dict[str, Any]
    display_size: FileSize | None = None
    frame_rate: Rate | None = None
    cuts: tuple[int, ...] = ()
    name: str | None = None
    color_space: Text | None = None

    def __post_init__(self) -> None:
        check_sizes(self.display_size)


@dataclass(frozen=True, slots=True)
class _Source:
    """Source of one array: channels of the files of a pattern, one file per frame."""

    pattern: str
    channels: tuple[str, ...]
    packing: Packing | None = None

    def taken(self, path: Path, channels: Mapping[str, Channel]) -> Array:
        """Return the array from the channels of a file; see `take`."""
        stored = shot_format.take(path, channels, self.channels)
        return stored if self.packing is None else self.packing.decoded(stored)

    def outside(self, value: float) -> dict[str, float]:
        """Return the values of the channels outside of a file's data window; `value` is the array's."""
        stored = [value] if self.packing is None else self.packing.encoded(value)
        return {name: stored[index % len(stored)] for index, name in enumerate(self.channels)}


class _MappedFiles:
    """Files of a sequence, and the arrays to read from them.

    `color_space` is the space that every file of the colour must state; None: what they state does not count.
    """

    color_space: str | None = None

    def __init__(
        self,
        folder: Path,
        channel_map: ChannelMap,
        conventions: Conventions,
        files: str,
        frames: Range | None,
        *,
        follow_links: bool,
    ) -> None:
        self.folder, self._conventions = folder, conventions
        self._sky = shot_format.sky_depth(conventions)
        self.every_source = _parsed(channel_map, files)
        self.sources = {name: each for name, each in self.every_source.items() if name != "reference"}
        patterns = dict.fromkeys(source.pattern for source in self.sources.values())
        every = {each: numbered_files(folder, each, follow_links=follow_links) for each in patterns}
        self.files = {pattern: of_range(folder, found, frames) for pattern, found in every.items()}
        self.numbers = _common_numbers(folder, self.files)
        numbers = next(iter(every.values()))
        self.indices = [number - min(numbers) for number in self.numbers]  # from the first file
        self.frame_pattern = (self.sources.get("color") or self.sources["depth"]).pattern
        self.last_index = max(numbers) - min(numbers)
        self.references: dict[int, Path] = {}
        if reference := self.every_source.get("reference"):
            files_of_all = numbered_files(folder, reference.pattern, follow_links=follow_links)
            self.references = _references(folder, reference.pattern, files_of_all, self.numbers)

    def frame_file(self, index: int) -> Path:
        """Return the file of a frame's colour, or of its depth if it has no colour."""
        return self.files[self.frame_pattern][self.numbers[index]]

    def frame_files(self, index: int) -> list[Path]:
        """Return the files of a frame, one for each pattern."""
        return [files[self.numbers[index]] for files in self.files.values()]

    def entry(self, index: int, jitter: tuple[float, float], *, reset: bool) -> shot_format.FrameEntry:
        reference = self.references.get(self.numbers[index])
        return shot_format.FrameEntry(
            file=self.frame_file(index).relative_to(self.folder).as_posix(),
            jitter=jitter,
            reset=reset,
            reference=None if reference is None else reference.relative_to(self.folder).as_posix(),
            shaded="color" in self.sources,
        )

    def check_types(self) -> None:
        """Check the types of the first files.

        Raises:
            ShotError: a packed array does not have 8 bits, or another array holds integers. Only sRGB
                colour, references and AOVs, such as alpha, may hold integers. Or an AOV holds ids.
            ArgumentError: colour holds integers, and the conventions do not state that it is sRGB-encoded.
        """
        for name, source in self.every_source.items():
            path = next(
                iter((self.references if name == "reference" else self.files[source.pattern]).values())
            )
            header = read_header(path)
            types = header.types
            ids = [channel for channel in source.channels if is_id(channel, header.cryptomattes)]
            if name == "aovs" and ids:
                hint = "Leave them out of the map, or rename them if they hold none; `denoise` copies ids."
                raise ShotError(path, f"holds ids in {', '.join(ids)}; AOVs are blended", hint)
            kinds = {types[channel] for channel in source.channels if channel in types}
            if source.packing is not None and source.packing.bytes_each:
                if others := sorted(kinds - {"uint8"}):
                    hint = 'Without "bytes", half and float are read as they are.'
                    raise ShotError(path, f"holds packed {name} as {others[0]}; want 8 bits a channel", hint)
                continue
            if kinds.isdisjoint(_INTEGERS) or name == "aovs":
                continue
            if name not in ("color", "reference"):
                hint = 'State the packing by "bytes" and "range" (docs/shots.md), or write floating point.'
                raise ShotError(path, f"holds {name} as {min(kinds)}; want half or float", hint)
            if not self._conventions.srgb:
                hint = "Linear light in 8 or 16 bits shows bands; write it as half."
                got = f"without srgb=True, and {path.name} holds {min(kinds)}"
                raise ArgumentError("conventions", got=got, want="srgb=True for integers", hint=hint)

    def unmapped_ids(self, header: ImageHeader) -> list[str]:
        """Return the channels of ids in the files of the colour, of the first view, that are not mapped."""
        own = [source.channels for source in self.sources.values() if source.pattern == self.frame_pattern]
        known = {*chain.from_iterable(own), *header.other_views}
        return [name for name in header.types if name not in known and is_id(name, header.cryptomattes)]

    def read_arrays(
        self, index: int, render_size: Size | None = None, gbuffers: Collection[str] | None = None
    ) -> RawFrame:
        arrays: dict[str, Array] = {}
        for pattern, files in self.files.items():
            sources = {
                name: source
                for name, source in self.sources.items()
                if source.pattern == pattern
                and (gbuffers is None or name not in _OPTIONAL or _OPTIONAL[name] in gbuffers)
            }
            if not sources:
                continue
            path, names = files[self.numbers[index]], [n for s in sources.values() for n in s.channels]
            outside: dict[str, float] = {}
            for name, source in sources.items():
                outside |= source.outside(self._sky if name == "depth" else 0.0)
            channels = read_image(path, only=names, outside=outside)
            if pattern == self.frame_pattern:
                self._check_color_space(path)
            if self._conventions.motion_resolution == "render" or not set(sources) <= _MOTIONS:
                shot_format.check_size(path, channels, render_size)
            arrays |= {name: source.taken(path, channels) for name, source in sources.items()}
        color, aovs = arrays.get("color"), arrays.get("aovs")
        if color is not None and aovs is not None and self._alpha is not None:
            at, header = self._alpha
            alpha = aovs if aovs.ndim == 2 else aovs[..., at]
            color = _multiplied_by_alpha(color, alpha, header, srgb=self._conventions.srgb)
        return RawFrame(
            color=color,
            depth=arrays["depth"].astype(np.float32, copy=False),
            motion=arrays["motion"],
            motion_next=arrays.get("motion_next"),
            gbuffer={name: arrays[name] for name in GBUFFER_CHANNELS if name in arrays} or None,
            aovs=aovs[..., None] if aovs is not None and aovs.ndim == 2 else aovs,
        )

    def _check_color_space(self, path: Path) -> None:
        """Raise ShotError if the file of a frame states another colour space than the first frame."""
        if self.color_space is None or (stated := read_header(path).color_space) == self.color_space:
            return
        problem = f"is in {stated} by its header; frame {self.numbers[0]} is in {self.color_space}"
        raise ShotError(path, problem, "Render it again, or state the space of all frames: --color-space.")

    def read_reference(self, index: int, display_size: Size | None = None) -> Float32:
        path, channels = self.references[self.numbers[index]], self.every_source["reference"].channels
        header = read_header(path)
        is_multiplied = self._alpha is not None or self.frame_file(0).suffix.lower() == ".exr"
        has_alpha = is_multiplied and header.format != "exr" and _ALPHA in header.types
        image = shot_format.read_reference(path, display_size, (*channels, _ALPHA) if has_alpha else channels)
        srgb = header.types[channels[0]] in _INTEGERS
        if has_alpha:
            image = _multiplied_by_alpha(image[..., :3], image[..., 3], header, srgb=srgb)
        return srgb_decoded(image) if srgb else image

    @cached_property
    def _alpha(self) -> tuple[int, ImageHeader] | None:
        """Place among the AOVs of the alpha of a colour PNG or TIFF, and the header; None without one."""
        color, aovs = self.sources.get("color"), self.sources.get("aovs")
        if color is None or aovs is None or color.pattern != aovs.pattern or _ALPHA not in aovs.channels:
            return None
        header = read_header(self.frame_file(0))
        return None if header.format == "exr" else (aovs.channels.index(_ALPHA), header)


def _multiplied_by_alpha(color: Array, alpha: Array, header: ImageHeader, *, srgb: bool) -> Array:
    """Return colour that is multiplied by alpha in linear light, as in EXR, in the encoding that it has.

    Args:
        color: (h, w, 3) of a PNG or TIFF.
        alpha: (h, w) of the same file.
        header: its header. Colours with associated alpha, which TIFF may have, are multiplied as stored.
        srgb: whether colour is sRGB-encoded.
    """
    alpha = alpha[..., None]
    if not header.straight_alpha:
        if not srgb:
            return color
        alpha = np.where(alpha > 0, alpha, np.float32(1))
        color = np.minimum(color / alpha, 1)
    return srgb_encoded(srgb_decoded(color) * alpha) if srgb else color * alpha


def _parsed(channel_map: ChannelMap, files: str) -> dict[str, _Source]:
    sources = {}
    for name, value in channel_map.items():
        if name not in _COUNTS and name != "aovs":
            known = (*_COUNTS, "aovs")
            want, hint = f"one of {', '.join(known)}", did_you_mean(name, known)
            if name == "channels":  # as in the file
                hint = (
                    f"Pass this object alone. A whole {MAP_FILE_NAME} is read from the folder of the frames."
                )
            raise ArgumentError("channel_map", got=f"a map with {name!r}", want=want, hint=hint)
        texts, packing = _channels(name, value)
        sources[name] = _source(name, texts, files, packing)
    for name in ("depth", "motion"):
        if name not in sources:
            got = f"a map without {name!r}"
            raise ArgumentError("channel_map", got=got, want="depth and motion at least")
    return sources


def _channels(name: str, value: Any) -> tuple[list[str], Packing | None]:
    """Return the channels of an array, and its packing, or None."""
    if isinstance(value, Mapping) and name not in _UNPACKED:
        return parse_packing(name, value, _COUNTS[name])
    number = len(value) if isinstance(value, list | tuple) else 1
    count = _COUNTS.get(name, min(number, MAX_AOVS))
    texts = _listed_channels(f"channel_map[{name!r}]", value, count)
    for text in texts:
        if ":" in text and {*text.partition(":")[0]} & {*"*?#"} and _MAPPED.fullmatch(text) is None:
            raise ArgumentError(f"channel_map[{name!r}]", got=shown(text), want="EXR, PNG or TIFF files")
    return texts, None


def _source(name: str, texts: Sequence[str], files: str, packing: Packing | None) -> _Source:
    """Parse `pattern:channel`; a channel's name may contain colons, a pattern ends in .exr, .png or .tif."""
    parts = [(found[1], found[2]) if (found := _MAPPED.fullmatch(text)) else (files, text) for text in texts]
    patterns = {pattern for pattern, _ in parts}
    if len(patterns) != 1:
        got = f"files of {' and '.join(sorted(patterns))}"
        raise ArgumentError(f"channel_map[{name!r}]", got=got, want="channels of one file")
    return _Source(patterns.pop(), tuple(channel for _, channel in parts), packing)


def _common_numbers(folder: Path, files: Mapping[str, dict[int, Path]]) -> list[int]:
    """Return the frame numbers, which must be the same for every pattern."""
    (pattern, leader), *others = files.items()
    for other, found in others:
        for number in leader.keys() ^ found.keys():
            have, lack = (pattern, other) if number in leader else (other, pattern)
            problem = f"frame {number} is among {have} and not among {lack}"
            raise ShotError(folder, problem, "Render it again.")
    return list(leader)


def _references(
    folder: Path, pattern: str, files: Mapping[int, Path], numbers: Sequence[int]
) -> dict[int, Path]:
    """Return the references of the frames that have one, by number."""
    found = {number: files[number] for number in numbers if number in files}
    if not found:
        problem = f"no reference {pattern} has the number of a frame, {numbers[0]} to {numbers[-1]}"
        raise ShotError(folder, problem, "Give a reference the number of its frame.")
    return found
