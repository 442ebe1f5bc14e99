"""Read and write EXR, PNG and TIFF files and their headers, and write JPEG, by OpenImageIO.

Channel types are kept; writes are atomic.
"""

import re
import tempfile
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from fractions import Fraction
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import numpy as np
import OpenImageIO as oiio
from numpy.typing import NDArray

from supersampler.arguments import as_number
from supersampler.errors import ArgumentError, ShotError, shown
from supersampler.frame import Array, Size
from supersampler.io import files
from supersampler.io.display import MAX_HALF
from supersampler.io.display_transforms import REC709, SRGB, STUDIO_CONFIG, UNKNOWN_COLOR_SPACE

Channel: TypeAlias = NDArray[Any]
"""(h, w), of its type in the file: float16, float32 or uint32."""
Outside: TypeAlias = Mapping[str, float]
"""Values of pixels outside of a file's data window, by channel; 0 for other channels."""

_NTSC = 2.5e-4  # maximum relative difference of a rate from a multiple of 1000 / 1001
NO_REASON = "no reason given"
_MAGIC: Mapping[str, tuple[bytes, ...]] = {
    "exr": (b"v/1\x01",), "png": (b"\x89PNG",), "tif": (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"),
}  # fmt: skip
_ENTRY_BYTES = 520
_ENTRY = re.compile(rb"[^\0]{1,255}\0[^\0]{1,255}\0(.{4})", re.DOTALL)
"""Name, type and size of a header entry of an EXR file, at most _ENTRY_BYTES."""
_MULTI_PART = 0x1000  # flag of an EXR file
FORMATS = tuple(_MAGIC)
"""Formats that are read."""
_DAMAGED = "The file is damaged or cut off; write or copy it again."
_TOO_LARGE = "Write a smaller image; if it is smaller, its header is damaged: copy the file again."
_SIGNS_OF_DAMAGE = re.compile(
    r"end of file|READ_IO|SIZE_MISMATCH|corrupt|truncat|CRC|read error|cannot read", re.IGNORECASE
)
"""Words in the decoders' messages about truncated or corrupt files."""


def read_exr(
    path: Path | str,
    *,
    only: Iterable[str] | None = None,
    without: Iterable[str] = (),
    outside: Outside | None = None,
) -> dict[str, Channel]:
    """Read the channels of an EXR file; files of other formats are refused. See `read_image`."""
    return read_image(path, only=only, without=without, outside=outside, formats=("exr",))


def read_image(
    path: Path | str,
    *,
    only: Iterable[str] | None = None,
    without: Iterable[str] = (),
    outside: Outside | None = None,
    formats: Collection[str] = FORMATS,
) -> dict[str, Channel]:
    """Read the channels of an EXR, PNG or TIFF file, in OpenImageIO's order (R, G, B, A first, then by name).

    The parts of a multi-part EXR file are read as one image. A part's name is prefixed to channel names that
    do not begin with it. Overscan, the pixels outside of the display window, is cut off. Only the first page
    of a TIFF is read. RGB is not multiplied by alpha.

    Args:
        path: the file.
        only: names of the channels to return, if the file has them.
        without: names of channels to omit.
        outside: values for pixels of the display window outside of the data window; None refuses such files.
        formats: formats to accept, of FORMATS.

    Returns:
        Channel name to (h, w) array. EXR: half stays float16, float float32, uint uint32. Integers of PNG and
        TIFF become float32, value / maximum value; a palette is read as colours. The arrays may be views of
        one interleaved array.

    Raises:
        ShotError: the file is missing, truncated, of another format or deep, has a data window that is not
            allowed, or exceeds the limits of `supersampler.io.files`.
    """
    wanted, unwanted = None if only is None else frozenset(only), frozenset(without)
    image: dict[str, Channel] = {}
    with open_image(path, formats) as (source, kind):
        for part, names in enumerate(_part_names(source, path, kind)):
            chosen = frozenset(names if wanted is None else wanted.intersection(names)) - unwanted
            if chosen:
                image.update(_read_part(source, part, names, chosen, path, outside))
    return image


def last_reason(last_error: Callable[[], str]) -> str:
    """Return the first line of OpenImageIO's last error message and clear it; "" if there is none."""
    try:
        message = last_error().strip()
    except UnicodeDecodeError:  # the message quotes bytes of the file
        return "it holds text that is not UTF-8"
    return message.splitlines()[0] if message else ""


@contextmanager
def open_image(path: Path | str, formats: Collection[str] = FORMATS) -> Iterator[tuple[oiio.ImageInput, str]]:
    """Open a file, and yield it with its format; errors of the decoder become ShotErrors.

    The first bytes are checked first, because OpenImageIO would try all of its decoders.
    """
    try:
        with files.os_errors_as_shot_error(path):
            files.check_is_file(Path(path))
            with Path(path).open("rb") as file:
                begins = file.read(4)
            kind = next((kind for kind in formats if begins in _MAGIC[kind]), None)
            if kind is None:
                *others, last = (kind.upper() for kind in formats)
                listed = f"{', '.join(others)} or {last}" if others else last
                hint = f"Write it as {listed}; its name does not decide." if any(begins) else _DAMAGED
                problem = f"is not an {listed} image (it begins with {begins!r})" if begins else "is empty"
                raise ShotError(path, problem, hint)
            if kind == "exr":
                _check_attributes(path)
            as_stored = oiio.ImageSpec()
            as_stored.attribute("oiio:UnassociatedAlpha", 1)
            source = oiio.ImageInput.open(files.utf8_path(path), as_stored)
            if source is None:
                raise _unreadable(path, last_reason(oiio.geterror) or NO_REASON)
            try:
                if (rows := source.spec().get_int_attribute("Orientation", 1)) != 1:
                    problem = f"states that its rows are turned or mirrored (orientation {rows})"
                    raise ShotError(path, problem, "Write it with row 0 on top, orientation 1.")
                yield source, kind
            finally:
                source.close()
    except MemoryError as error:
        raise ShotError(path, "claims more pixels than there is memory for", _TOO_LARGE) from error


def _check_attributes(path: Path | str) -> None:
    """Raise ShotError if the headers of an EXR file have very many entries.

    OpenEXR compares each entry's name with all others of its part: a megabyte of entries takes minutes.
    Damaged headers are left to OpenEXR.
    """
    limit, total, at = files.IMAGE_ATTRIBUTES, 0, 8
    with Path(path).open("rb") as file:
        flags = int.from_bytes(file.read(at)[4:], "little")
        for _ in range(files.IMAGE_PARTS if flags & _MULTI_PART else 1):
            count = 0
            while entry := _ENTRY.match(file.read(_ENTRY_BYTES)):
                at += entry.end() + int.from_bytes(entry[1], "little")
                file.seek(at)
                count, total = count + 1, total + 1
                if count > limit or total > 16 * limit:
                    problem = f"has {count} header entries or more in a part, {total} in all"
                    hint = "Write it without most of them."
                    raise ShotError(path, f"{problem}; want at most {limit} and {16 * limit}", hint)
            at += 1  # a zero ends the header
            file.seek(at)


def _unreadable(path: Path | str, reason: str) -> ShotError:
    """Return the error for a file that the decoder does not open, with a remedy for the reason."""
    if re.search(r"subsampled.*\b[RB]Y\b", reason, re.IGNORECASE):
        return luminance_chroma_error(path)
    if re.search("subsampled", reason, re.IGNORECASE):
        return ShotError(path, f"holds channels of reduced size ({reason})", "Write all at one size.")
    hint = _DAMAGED if _SIGNS_OF_DAMAGE.search(reason) else "Write it with other settings, or copy it again."
    hint = _TOO_LARGE if "limits:" in reason else hint  # of OpenImageIO
    return ShotError(path, f"is not an image that can be read ({reason})", hint)


def luminance_chroma_error(path: Path | str) -> ShotError:
    """Return the error for a file whose colours are luminance and chroma."""
    hint = "Write R, G and B; ImageMagick converts it: magick IN.exr OUT.exr."
    return ShotError(path, "holds luminance and chroma (Y, RY, BY)", hint)


def _part_names(source: oiio.ImageInput, path: Path | str, kind: str) -> list[list[str]]:
    """Return the channel names of each part; in a multi-part EXR file they begin with the part's name.

    The first view at the end of a part's name is omitted, as Nuke names the parts of a view "main"
    `rgba.main` and `depth.main`, and Blender 5 those of a view "left" `ViewLayer.Depth-left`. Other formats
    have one part, the first image: further pages of a TIFF are often small copies.
    """
    if kind != "exr":
        return [list(source.spec().channelnames)]
    parts: list[tuple[str, list[str]]] = []
    view, count = "", 0
    while source.seek_subimage(len(parts), 0):
        spec = source.spec()
        view = view or spec.get_string_attribute("view")
        parts.append((spec.get_string_attribute("oiio:subimagename"), list(spec.channelnames)))
        count += spec.nchannels
        if len(parts) > files.IMAGE_PARTS or count > files.IMAGE_CHANNELS:
            limits = f"want at most {files.IMAGE_CHANNELS} in {files.IMAGE_PARTS}"
            raise ShotError(path, f"has {count} channels or more in {len(parts)} parts or more; {limits}")
    last_reason(source.geterror)  # clears the message of the seek past the last part
    if len(parts) == 1:
        return [parts[0][1]]
    suffix = rf"[._-]{re.escape(view)}$" if view else r"[._]main$"
    layers = [re.sub(suffix, "", part) for part, _ in parts]
    if len({*layers}) < len(layers):
        layers = [part for part, _ in parts]
    return [
        [name if not layer or _is_in_layer(name, layer) else f"{layer}.{name}" for name in names]
        for layer, (_, names) in zip(layers, parts, strict=True)
    ]


def _is_in_layer(channel: str, layer: str) -> bool:
    """Return whether a channel's name begins with a layer, or one of its ranks: `crypto00.R` of `crypto`."""
    return re.match(rf"{re.escape(layer)}\d*\.", channel) is not None


def _read_part(
    source: oiio.ImageInput,
    part: int,
    names: list[str],
    wanted: frozenset[str],
    path: Path | str,
    outside: Outside | None,
) -> dict[str, Channel]:
    source.seek_subimage(part, 0)
    spec = source.spec()
    x, y, width, height = data = spec.x, spec.y, spec.width, spec.height
    full_x, full_y, full_width, full_height = display = (
        spec.full_x, spec.full_y, spec.full_width, spec.full_height,
    )  # fmt: skip
    covers = x <= full_x and y <= full_y and x + width >= full_x + full_width
    for size in (data[2:], display[2:]):
        if (problem := files.image_size_problem(*size)) is not None:
            raise ShotError(path, problem, _TOO_LARGE)
    if spec.deep:
        raise ShotError(path, "holds deep pixels", "Write it with one value per pixel.")
    if outside is None and not (covers and y + height >= full_y + full_height):
        problem = f"holds a part of its image: (x, y, w, h) {data} of {display}"
        raise ShotError(path, problem, "Render it without a crop region.")
    indices = [index for index, name in enumerate(names) if name in wanted]
    begin = indices[0]
    area = max(width * height, full_width * full_height)
    size_bytes = area * (indices[-1] + 1 - begin) * np.dtype(np.float32).itemsize
    if size_bytes > files.IMAGE_BYTES:
        problem = f"has {size_bytes >> 30} GiB of pixels; want at most {files.IMAGE_BYTES >> 30}"
        raise ShotError(path, problem, _TOO_LARGE)
    kinds = {str(spec.channelformat(index)) for index in indices}
    kind = "half" if kinds == {"half"} else "float"  # a second read for mixed types would decompress again
    pixels = source.read_image(part, 0, begin, indices[-1] + 1, kind)
    if pixels is None:
        reason = last_reason(source.geterror) or NO_REASON
        raise ShotError(path, f"cannot be read to its end ({reason})", _DAMAGED)
    planes = {names[index]: _plane(source, part, index, pixels[..., index - begin]) for index in indices}
    return {name: _in_display(plane, spec, (outside or {}).get(name, 0.0)) for name, plane in planes.items()}


def _plane(source: oiio.ImageInput, part: int, index: int, pixels: NDArray[Any]) -> Channel:
    """Return one channel in the type that the file stores; half values are exact in float32."""
    kind = str(source.spec().channelformat(index))
    if kind == "uint":  # conversion to float would divide by 2^32
        whole = source.read_image(part, 0, index, index + 1, "uint")
        if whole is not None:
            return whole[..., 0]
    return pixels.astype(np.float16, copy=False) if kind == "half" else pixels


def _in_display(plane: Channel, spec: oiio.ImageSpec, outside: float) -> Channel:
    """Return the pixels of the display window, with `outside` outside of the data window."""
    left, top = spec.x - spec.full_x, spec.y - spec.full_y  # corner of the data window
    width, height = spec.full_width, spec.full_height
    if (left, top) == (0, 0) and plane.shape == (height, width):
        return plane
    image = np.full((height, width), outside, plane.dtype)
    rows = slice(max(top, 0), min(top + spec.height, height))
    columns = slice(max(left, 0), min(left + spec.width, width))
    if rows.start < rows.stop and columns.start < columns.stop:
        inside = (slice(rows.start - top, rows.stop - top), slice(columns.start - left, columns.stop - left))
        image[rows, columns] = plane[inside]
    return image


class TypedValues(NamedTuple):
    """A header entry other than plain text or a number, such as a matrix or a timecode.

    Attributes:
        type: OpenImageIO's name: "timecode", "rational", "matrix", "float[8]", "vector", "box2i".
        values: its numbers or texts, in order.
    """

    type: str
    values: tuple[str | int | float, ...]


Metadata: TypeAlias = dict[str, str | int | float | TypedValues]
"""Entries of an EXR file's header, by name."""

FRAME_RATE, PIXEL_ASPECT = "framesPerSecond", "PixelAspectRatio"
_CRYPTOMATTE = "cryptomatte/"
_LAYOUT = re.compile(
    f"oiio:|openexr:|{_CRYPTOMATTE}|thumbnail|(compression|BlenderMultiChannel|DateTime|[XY]Resolution"
    "|ResolutionUnit|Orientation|name|type|view|multiView|chunkCount|version|dataWindow|displayWindow"
    "|originalDataWindow|acesImageContainerFlag|textureformat|wrapmodes|tiles|envmap|deepImageState"
    "|maxSamplesPerPixel)$"
)
"""Entries that describe only the file itself: storage, windows, parts and views."""
_DEFAULTS = {PIXEL_ASPECT: 1.0, "screenWindowWidth": 1.0, "screenWindowCenter": (0.0, 0.0)}
"""Defaults of entries that every EXR file has; they are not kept."""
_MAX_ENTRIES, _MAX_TEXT, _MAX_VALUES = 256, 1 << 16, 64
_WHITE_D65, _WHITE_ACES = (0.3127, 0.3290), (0.32168, 0.33767)
_PRIMARIES = {
    REC709: (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, *_WHITE_D65),
    "ACEScg": (0.713, 0.293, 0.165, 0.830, 0.128, 0.044, *_WHITE_ACES),
    "ACES2065-1": (0.7347, 0.2653, 0.0, 1.0, 0.0001, -0.0770, *_WHITE_ACES),
    "lin_rec2020": (0.708, 0.292, 0.170, 0.797, 0.131, 0.046, *_WHITE_D65),
    "lin_p3d65": (0.680, 0.320, 0.265, 0.690, 0.150, 0.060, *_WHITE_D65),
}
"""x and y of red, green, blue and white, by the space's name in the OpenColorIO configs of ACES."""
_TOLERANCE = 2e-3  # maximum difference of a coordinate; files round to three digits
_INTEROP_ID = "colorInteropID"
_INTEROP_IDS = {
    "lin_rec709_scene": "lin_rec709", "lin_ap1_scene": "ACEScg", "lin_ap0_scene": "ACES2065-1",
    "lin_rec2020_scene": "lin_rec2020", "lin_p3d65_scene": "lin_p3d65",
}  # fmt: skip


@dataclass(frozen=True)
class ImageHeader:
    """Header of an EXR, PNG or TIFF file.

    Attributes:
        format: "exr", "png" or "tif".
        types: channels of `read_image`, with their types: "half", "float", "uint", "uint8", "uint16".
        metadata: entries of an EXR header that describe the content: frame, camera, time code, lens. Entries
            on the storage are omitted: compression, windows, tiles, views, parts.
        cryptomatte: entries `cryptomatte/ID/name`, `/hash`, `/conversion`, `/manifest` of all parts, whole.
        other_views: channels of a stereo EXR file's views after the first: those of parts with such a `view`,
            and those whose names have it between dots.
        color_space: colour space of the linear light, by its name in the OpenColorIO configs of ACES. EXR
            files state it by `colorInteropID` or `chromaticities`; chromaticities other than Rec. 709, AP1,
            AP0, Rec. 2020 and P3-D65 are "unknown". Files that state nothing: "lin_rec709", which is also
            the space of decoded sRGB.
        straight_alpha: whether the file states that RGB is not multiplied by alpha: PNG, and TIFF with
            unassociated alpha.
    """

    format: str
    types: Mapping[str, str]
    metadata: Metadata
    cryptomatte: Mapping[str, str]
    other_views: Sequence[str]
    color_space: str
    straight_alpha: bool

    @property
    def cryptomattes(self) -> list[str]:
        """Names of the Cryptomatte layers; their channels are NAME00.R and so on."""
        return [name for key, name in self.cryptomatte.items() if name and key.endswith("/name")]

    @property
    def frame_rate(self) -> float | None:
        """Frames per second; None if the header does not state them."""
        return rate_of(self.metadata.get(FRAME_RATE))


def read_header(path: Path | str) -> ImageHeader:
    """Read the header of an EXR, PNG or TIFF file; see `read_image` for errors."""
    with open_image(path) as (source, kind):
        types: dict[str, str] = {}
        cryptomatte: dict[str, str] = {}
        views: dict[str, str] = {}  # of channels
        for part, names in enumerate(_part_names(source, path, kind)):
            source.seek_subimage(part, 0)
            spec = source.spec()
            types |= {name: str(spec.channelformat(index)) for index, name in enumerate(names)}
            cryptomatte |= _cryptomatte(spec)
            views |= dict.fromkeys(names, spec.get_string_attribute("view"))
        if kind != "exr":
            is_straight = bool(source.spec().get_int_attribute("oiio:UnassociatedAlpha"))
            return ImageHeader(kind, types, {}, {}, (), REC709, is_straight)
        source.seek_subimage(0, 0)
        spec = source.spec()
        others = _other_views(spec, views)
        return ImageHeader(kind, types, _metadata(spec), cryptomatte, others, _color_space(spec), False)


def _other_views(spec: oiio.ImageSpec, views: Mapping[str, str]) -> list[str]:
    """Return the channels of the views after the first, given the first part and each channel's view."""
    stated = spec.getattribute("multiView")
    in_order = stated if isinstance(stated, tuple) else dict.fromkeys(filter(None, views.values()))
    others = set(list(map(str, in_order))[1:])
    return [name for name, view in views.items() if not others.isdisjoint([view, *name.split(".")[:-1]])]


def _cryptomatte(spec: oiio.ImageSpec) -> dict[str, str]:
    entries = {str(entry.name): entry.value for entry in spec.extra_attribs}
    return {
        name: value
        for name, value in entries.items()
        if name.startswith(_CRYPTOMATTE) and isinstance(value, str)
    }


def _metadata(spec: oiio.ImageSpec) -> Metadata:
    found: Metadata = {}
    for entry in spec.extra_attribs:
        value, name = entry.value, str(entry.name)
        if _LAYOUT.match(name) or not isinstance(value, str | int | float | tuple):
            continue  # damaged entries may be arrays
        if _DEFAULTS.get(name) == value or (isinstance(value, tuple) and len(value) > _MAX_VALUES):
            continue
        if isinstance(value, str) and len(value) > _MAX_TEXT:  # a part of it would be of no use
            continue
        found[name] = TypedValues(str(entry.type), value) if isinstance(value, tuple) else value
        if len(found) == _MAX_ENTRIES:
            break
    return found


def rate_of(entry: str | int | float | TypedValues | None) -> float | None:
    """Return the frames per second of an entry `framesPerSecond`; None if it is not a valid rate."""
    match entry:
        case TypedValues("rational", (int(frames), int(seconds))) if seconds:
            rate = frames / seconds
            return rate if files.RATES[0] <= rate <= files.RATES[1] else None
    return None


def _color_space(spec: oiio.ImageSpec) -> str:
    stated = spec.get_string_attribute(_INTEROP_ID)
    primaries = spec.getattribute("chromaticities")
    if stated in _INTEROP_IDS:
        return _INTEROP_IDS[stated]
    if not isinstance(primaries, tuple) or len(primaries) != 8:
        return UNKNOWN_COLOR_SPACE if stated else REC709
    for name, known in _PRIMARIES.items():
        if np.allclose(primaries, known, rtol=0, atol=_TOLERANCE):
            return name
    return UNKNOWN_COLOR_SPACE


def scene_linear_space(config: str, interop_id: str = "") -> str:
    """Return the scene-linear space of an OpenColorIO configuration, named as in `ImageHeader.color_space`.

    Rec. 709, as in Blender's own configuration, if the configuration is not on this machine. `interop_id` is
    the `colorInteropID` of the space that takes the configuration's place; "" without one.
    """
    if interop_id:
        return _INTEROP_IDS.get(interop_id, UNKNOWN_COLOR_SPACE)
    if not (config.startswith("ocio://") or files.is_file(Path(config))):
        return REC709
    return _INTEROP_IDS.get(
        oiio.ColorConfig(config).get_color_interop_id("scene_linear"), UNKNOWN_COLOR_SPACE
    )


def space_of_role(config: str, name: str) -> str | None:
    """Return the space of a role in an OpenColorIO configuration, as `scene_linear_space`; None if unknown.

    A role means another space in another configuration. Other names are returned as they are.
    """
    opened = oiio.ColorConfig(config)
    return _INTEROP_IDS.get(opened.get_color_interop_id(name)) if name in opened.getRoles() else name


_TIME_CODE = "smpte:TimeCode"  # counts frames within a second
_ROUNDED = 0.02  # maximum relative difference of the two axes' ratios due to whole pixels


def result_metadata(
    metadata: Metadata, *, frame_rate: float | None, render_size: Size, display_size: Size
) -> Metadata:
    """Return the header entries of an upscaled image, from the entries of its frame.

    The pixel aspect ratio changes if the two axes have different ratios. A stated frame rate is replaced by
    `frame_rate`, unless that is None; a time code of another rate is removed.
    """
    entries = dict(metadata)
    across, down = display_size[0] / render_size[0], display_size[1] / render_size[1]
    if abs(across / down - 1.0) > _ROUNDED:
        entries[PIXEL_ASPECT] = pixel_aspect(metadata) * down / across
    stated = rate_of(metadata.get(FRAME_RATE))
    rate = None if frame_rate is None else exact_rate(frame_rate)
    if FRAME_RATE in metadata and rate is not None and (stated is None or exact_rate(stated) != rate):
        entries[FRAME_RATE] = TypedValues("rational", (rate.numerator, rate.denominator))
        entries.pop(_TIME_CODE, None)
    return entries


def exact_rate(frame_rate: float) -> Fraction:
    """Return frames per second as a fraction: 23.976 is 24000/1001; ArgumentError if out of range."""
    rate = as_number(frame_rate)
    if rate is None or not files.RATES[0] <= rate <= files.RATES[1]:
        raise ArgumentError("frame_rate", got=shown(frame_rate), want="a number from 0.001 to 1000")
    ntsc = Fraction(round(rate * 1.001) * 1000, 1001)
    return ntsc if abs(ntsc / Fraction(rate) - 1) < _NTSC else Fraction(rate).limit_denominator(1001)


def pixel_aspect(metadata: Metadata) -> float:
    """Return the width of a pixel over its height; 1 if the header does not state it."""
    value = metadata.get(PIXEL_ASPECT)
    return float(value) if isinstance(value, int | float) and 0.01 <= value <= 100.0 else 1.0


_INTEGER_VECTORS = {"vector2i": oiio.TypeVector2i, "vector3i": oiio.TypeVector3i}
_PAETH = 128  # libpng's PNG_FILTER_PAETH; trying all filters for each row costs more than it saves
Bytes: TypeAlias = NDArray[np.uint8]
Levels: TypeAlias = NDArray[np.uint8] | NDArray[np.uint16]
"""Encoded values as integers: 1 is 255 or 65535."""


def write_exr(
    path: Path | str,
    image: Channel | Mapping[str, Channel],
    channels: Sequence[str] = ("R", "G", "B"),
    *,
    compression: str = "zip",
    metadata: Metadata | None = None,
    color_space: str | None = None,
) -> None:
    """Write an EXR file atomically. float16 is stored as half, float32 as float.

    A contiguous (h, w, c) array is written without a copy.

    Args:
        path: the file; its folder is created if it is missing.
        image: (h, w, c) array, or channel name to (h, w) array, whose types may differ.
        channels: the c channel names of an array.
        compression: lossless "zip", "zips", "piz", "rle", "none"; "zip:9" is slower and smaller. Lossy
            "dwaa:45", "dwab:45": larger numbers give smaller files.
        metadata: entries of the header, as in `ImageHeader`.
        color_space: linear space of the colours, such as "ACEScg": the header states its name, and its
            primaries if STUDIO_CONFIG has it. None: the header does not state it, which means Rec. 709.

    Raises:
        ShotError: the types or sizes cannot be stored, or the disk refused.
    """
    named = _checked_channels(path, image, channels)
    arrays = list(named.values())
    kinds = ["half" if array.dtype == np.float16 else "float" for array in arrays]
    spec = _spec(arrays[0].shape, list(named), kinds[0])
    if len(set(kinds)) > 1:  # OpenImageIO takes types per channel only if they differ
        spec.channelformats = tuple(oiio.TypeDesc(kind) for kind in kinds)
    spec.attribute("compression", compression)
    for name, value in (metadata or {}).items():
        if isinstance(value, TypedValues):
            spec.attribute(name, _parsed_type(value.type), value.values)
        else:
            spec.attribute(name, value)
    if color_space is not None:  # as OpenImageIO (`colorInteropID`) and Nuke (primaries) read it
        interop_id, primaries = _stated_space(color_space)
        if interop_id:
            spec.erase_attribute(_INTEROP_ID)  # of the metadata: OpenImageIO would keep it
        spec.attribute("oiio:ColorSpace", interop_id or color_space)
        if primaries:
            spec.attribute("chromaticities", oiio.TypeDesc("float[8]"), primaries)
    spec.attribute("DateTime", "")  # otherwise OpenImageIO stores the time, and files of equal images differ
    pixels = np.stack(arrays, axis=-1) if isinstance(image, Mapping) else image  # mixed types: float32
    _write(path, spec, np.ascontiguousarray(pixels))


@cache
def _stated_space(color_space: str) -> tuple[str, Sequence[float] | None]:
    """Return the interop id, "" if unknown, and the chromaticities, None if unknown, of a colour space.

    Opening the configuration takes longer than writing a small image.
    """
    config = oiio.ColorConfig(STUDIO_CONFIG)
    return config.get_color_interop_id(color_space), config.get_chromaticities(color_space)


def _parsed_type(text: str) -> oiio.TypeDesc:
    """Return a type by its name; OpenImageIO's own parser does not know vectors of integers."""
    base, _, length = text.partition("[")
    if base not in _INTEGER_VECTORS:
        return oiio.TypeDesc(text)
    parsed = oiio.TypeDesc(_INTEGER_VECTORS[base])
    parsed.arraylen = int(length.rstrip("]") or 0)
    return parsed


def is_lossy_in_dwa(channel: str) -> bool:
    """Return whether OpenEXR's compressions dwaa and dwab change the values of a channel, by its name."""
    return channel.rpartition(".")[2] in ("R", "G", "B", "Y", "RY", "BY")


def half_pixels(images: Sequence[Array]) -> NDArray[np.float16]:
    """Return (h, w, c) images of equal size as one array of half floats; values are clamped to +-65504."""
    counts = [image.shape[2] for image in images]
    pixels = np.empty((*images[0].shape[:2], sum(counts)), np.float16)
    for image, end, count in zip(images, np.cumsum(counts), counts, strict=True):
        np.clip(image, -MAX_HALF, MAX_HALF, out=pixels[..., end - count : end], casting="unsafe")
    return pixels


def write_png(path: Path | str, image: Levels, encoding: str = SRGB, pixel_aspect: float = 1.0) -> None:
    """Write pixels as PNG, atomically.

    Args:
        path: the file; its folder is created if it is missing.
        image: (h, w, 3) uint8 or uint16; or (h, w, 4), with straight alpha.
        encoding: OpenImageIO's name of the pixels' encoding, for the tags of the file.
        pixel_aspect: width of a pixel over its height; the file states it if it is not 1.

    Raises:
        ShotError: the array has another shape or type, or the disk refused.
    """
    # Compression 3 is much faster than the default, and files are little larger.
    _write_levels(path, image, encoding, pixel_aspect, {"png:compressionLevel": 3, "png:filter": _PAETH})


def write_tiff(path: Path | str, image: Levels, encoding: str = SRGB, pixel_aspect: float = 1.0) -> None:
    """Write pixels as TIFF, deflated, as `write_png` does; TIFF has a tag for sRGB only."""
    _write_levels(path, image, encoding, pixel_aspect, {"compression": "zip", "DateTime": ""})


def _write_levels(
    path: Path | str, image: Levels, encoding: str, pixel_aspect: float, attributes: Mapping[str, int | str]
) -> None:
    spec = _integer_spec(path, image, np.uint8, np.uint16, channels=(3, 4))
    spec.attribute("oiio:UnassociatedAlpha", 1)  # otherwise OpenImageIO divides by alpha
    spec.attribute("oiio:ColorSpace", encoding)
    if pixel_aspect != 1.0:
        spec.attribute("PixelAspectRatio", pixel_aspect)
    for name, value in attributes.items():
        spec.attribute(name, value)
    _write(path, spec, np.ascontiguousarray(image))


def encode_exr(image: Channel) -> bytes:
    """Return an (h, w, 3) image as the bytes of an EXR file; see `write_exr`."""
    return _encoded("image.exr", lambda path: write_exr(path, image))


def encode_png(image: Bytes) -> bytes:
    """Return (h, w, 3) uint8 sRGB pixels as the bytes of a PNG file."""
    return _encoded("image.png", lambda path: write_png(path, image))


def encode_jpeg(image: Bytes, quality: int = 90) -> bytes:
    """Return (h, w, 3) uint8 sRGB pixels as the bytes of a JPEG file; `quality` is 1 (smallest) to 100."""

    def write(path: Path) -> None:
        spec = _integer_spec(path, image, np.uint8)
        spec.attribute("Compression", f"jpeg:{quality}")
        spec.attribute("jpeg:subsampling", "4:4:4")  # 4:2:0 would blur thin lines
        _write(path, spec, np.ascontiguousarray(image))

    return _encoded("image.jpg", write)


def _encoded(name: str, write: Callable[[Path], None]) -> bytes:
    """Return the bytes of a file that `write` writes: OpenImageIO has no encoder to memory in Python."""
    with tempfile.TemporaryDirectory() as folder:
        write(path := Path(folder) / name)
        return path.read_bytes()


def _checked_channels(
    path: Path | str, image: Channel | Mapping[str, Channel], channels: Sequence[str]
) -> Mapping[str, Channel]:
    """Return the channels of an image by name; ShotError if EXR cannot store them."""
    if not isinstance(image, Mapping):
        if image.ndim != 3 or image.shape[2] != len(channels):
            want = f"(h, w, {len(channels)}) for the channels {', '.join(channels)}"
            raise ShotError(path, f"the image to write is {image.shape}; want {want}")
        image = {name: image[..., index] for index, name in enumerate(channels)}
    shapes = {array.shape for array in image.values()}
    if len(shapes) != 1 or len(min(shapes)) != 2 or 0 in min(shapes):
        found = ", ".join(f"{name} {array.shape}" for name, array in image.items()) or "nothing"
        raise ShotError(path, f"the channels to write are {found}; want arrays (h, w) of one size")
    for name, array in image.items():
        if array.dtype not in (np.float16, np.float32):
            problem = f"channel {name} to write is {array.dtype}; want float16 or float32"
            raise ShotError(path, problem, f"Convert it: {name}.astype(np.float32).")
    return image


def _integer_spec(
    path: Path | str, image: Levels, *types: type[np.unsignedinteger[Any]], channels: Sequence[int] = (3,)
) -> oiio.ImageSpec:
    if image.ndim != 3 or image.shape[2] not in channels or image.dtype not in types or 0 in image.shape:
        shapes = " or ".join(f"(h, w, {count})" for count in channels)
        want = f"{shapes} {' or '.join(each.__name__ for each in types)}"
        raise ShotError(path, f"the image to write is {image.shape} {image.dtype}; want {want}")
    return _spec(image.shape, ["R", "G", "B", "A"][: image.shape[2]], image.dtype.name)


def _spec(shape: tuple[int, ...], names: list[str], kind: str) -> oiio.ImageSpec:
    spec = oiio.ImageSpec(shape[1], shape[0], len(names), kind)
    spec.channelnames = tuple(names)
    return spec


def _write(path: Path | str, spec: oiio.ImageSpec, pixels: NDArray[Any]) -> None:
    files.utf8_path(path)  # raises with the final name, not the temporary one
    with files.replacing(path) as partial:
        name = files.utf8_path(partial)
        target = oiio.ImageOutput.create(name)
        if target is None:
            raise ShotError(path, f"cannot be written ({last_reason(oiio.geterror) or NO_REASON})")
        done = target.open(name, spec) and target.write_image(pixels)
        message = last_reason(target.geterror)  # on a full disk the PNG writer returns True, with a message
        if not (target.close() and done) or message:
            reason = message or last_reason(target.geterror) or NO_REASON
            reason = reason.replace(partial.name, Path(path).name)
            raise ShotError(path, f"cannot be written ({reason})", files.NO_ROOM)
