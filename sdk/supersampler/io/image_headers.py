"""Read the header of an image file: its metadata and its colour space."""

import re
from pathlib import Path
from typing import NamedTuple, TypeAlias

import numpy as np
from OpenImageIO import ImageSpec

from supersampler.io.display_transforms import REC709
from supersampler.io.image_reading import opened, read_types
from supersampler.io.limits import RATES

UNKNOWN_COLOR_SPACE = "unknown"
"""Of files with primaries that are none of those below."""


class TypedValues(NamedTuple):
    """An entry of a header that is no plain text or number, such as a matrix or a timecode.

    Attributes:
        type: OpenImageIO's name: "timecode", "rational", "matrix", "float[8]", "vector", "box2i".
        values: all of its numbers or texts, in order.
    """

    type: str
    values: tuple[str | int | float, ...]


Metadata: TypeAlias = dict[str, str | int | float | TypedValues]
"""Entries of an EXR file's header, by name."""

FRAME_RATE, PIXEL_ASPECT = "framesPerSecond", "PixelAspectRatio"
_LAYOUT = re.compile(
    "oiio:|openexr:|cryptomatte/|thumbnail|(compression|BlenderMultiChannel|DateTime|[XY]Resolution"
    "|ResolutionUnit|Orientation|name|type|view|multiView|chunkCount|version|dataWindow|displayWindow"
    "|originalDataWindow|acesImageContainerFlag|textureformat|wrapmodes|tiles|envmap|deepImageState"
    "|maxSamplesPerPixel)$"
)
"""Entries that are true of the file that is read only: of its storage, its windows, its parts and views."""
_DEFAULTS = {PIXEL_ASPECT: 1.0, "screenWindowWidth": 1.0, "screenWindowCenter": (0.0, 0.0)}
"""Entries that every EXR file has; these values say nothing."""
_MOST_ENTRIES, _LONGEST_TEXT, _MOST_VALUES = 256, 4096, 64
_WHITE_D65, _WHITE_ACES = (0.3127, 0.3290), (0.32168, 0.33767)
_PRIMARIES = {
    REC709: (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, *_WHITE_D65),
    "ACEScg": (0.713, 0.293, 0.165, 0.830, 0.128, 0.044, *_WHITE_ACES),
    "ACES2065-1": (0.7347, 0.2653, 0.0, 1.0, 0.0001, -0.0770, *_WHITE_ACES),
    "lin_rec2020": (0.708, 0.292, 0.170, 0.797, 0.131, 0.046, *_WHITE_D65),
    "lin_p3d65": (0.680, 0.320, 0.265, 0.690, 0.150, 0.060, *_WHITE_D65),
}
"""x and y of red, green, blue and white, by the space's name in the OpenColorIO configs of ACES."""
_TOLERANCE = 2e-3  # of a coordinate; files round them to three digits
_INTEROP_IDS = {
    "lin_rec709_scene": "lin_rec709", "lin_ap1_scene": "ACEScg", "lin_ap0_scene": "ACES2065-1",
    "lin_rec2020_scene": "lin_rec2020", "lin_p3d65_scene": "lin_p3d65",
}  # fmt: skip


class StoredAs(NamedTuple):
    """How a file stores its colour.

    Attributes:
        format: "exr", "png", "tif"; "safetensors" for Arm's sequences.
        type: "half", "float", "uint8", "uint16".
    """

    format: str
    type: str


def read_stored_as(path: Path | str, channel: str) -> StoredAs:
    """Return how a file stores a channel; "half" where it has no such channel."""
    with opened(path) as (_, kind):
        return StoredAs(kind, read_types(path).get(channel, "half"))


def read_exr_metadata(path: Path | str) -> Metadata:
    """Return what the program that wrote an EXR file says of its content: Frame, Camera, timecodes, lens.

    Entries that describe the file are left out: its compression, windows, tiles, views, parts.
    """
    with opened(path, ("exr",)) as (source, _):
        found: Metadata = {}
        for entry in source.spec().extra_attribs:
            value, name = entry.value, str(entry.name)
            if _LAYOUT.match(name) or _DEFAULTS.get(name) == value:
                continue
            if isinstance(value, str | int | float):
                found[name] = value[:_LONGEST_TEXT] if isinstance(value, str) else value
            elif isinstance(value, tuple) and len(value) <= _MOST_VALUES:
                found[name] = TypedValues(str(entry.type), value)
            if len(found) == _MOST_ENTRIES:
                break
    return found


def read_frame_rate(path: Path | str) -> float | None:
    """Return the frames a second that an EXR file's header states; None where it states none."""
    with opened(path) as (source, kind):
        rate = source.spec().getattribute(FRAME_RATE) if kind == "exr" else None
        return rate_of(TypedValues("rational", rate) if isinstance(rate, tuple) else None)


def rate_of(entry: str | int | float | TypedValues | None) -> float | None:
    """Return the frames a second of an entry `framesPerSecond`; None where it is no rate of a film."""
    match entry:
        case TypedValues("rational", (int(frames), int(seconds))) if seconds:
            rate = frames / seconds
            return rate if RATES[0] <= rate <= RATES[1] else None
    return None


def read_other_views(path: Path | str) -> list[str]:
    """Return the views of a stereo EXR file but the first, to which channels without a view's name belong."""
    with opened(path) as (source, kind):
        views = source.spec().getattribute("multiView") if kind == "exr" else None
        return [str(view) for view in views[1:]] if isinstance(views, tuple) else []


def read_color_space(path: Path | str) -> str:
    """Return the colour space that a file's header states, by its name in the OpenColorIO configs of ACES.

    EXR files state it by `colorInteropID` or `chromaticities`. Others, and those without: "lin_rec709", which
    sRGB-encoded colour has when it is decoded. Other chromaticities than Rec. 709, AP1, AP0, Rec. 2020 and
    P3-D65: "unknown".
    """
    with opened(path) as (source, kind):
        return _color_space(source.spec()) if kind == "exr" else REC709


def _color_space(spec: ImageSpec) -> str:
    stated = _INTEROP_IDS.get(spec.get_string_attribute("colorInteropID"))
    primaries = spec.getattribute("chromaticities")
    if stated is not None or not isinstance(primaries, tuple) or len(primaries) != 8:
        return stated or REC709
    for name, known in _PRIMARIES.items():
        if np.allclose(primaries, known, rtol=0, atol=_TOLERANCE):
            return name
    return UNKNOWN_COLOR_SPACE
