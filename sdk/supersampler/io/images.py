"""Write EXR, PNG, TIFF and JPEG files by OpenImageIO. Channel types are kept; writes are atomic."""

import tempfile
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray
from OpenImageIO import ColorConfig, ImageOutput, ImageSpec, TypeDesc, geterror

from supersampler.errors import ShotError
from supersampler.frame import Array
from supersampler.io.display import MAX_HALF
from supersampler.io.display_transforms import SRGB, STUDIO_CONFIG
from supersampler.io.files import NO_ROOM, replacing, utf8_path
from supersampler.io.image_headers import Metadata, TypedValues
from supersampler.io.image_reading import NO_REASON, Channel, last_reason

_PAETH = 128  # libpng's PNG_FILTER_PAETH; to try all filters for each row costs more than it saves
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
        path: the file; its folder is created where it is missing.
        image: (h, w, c) array, or channel name to (h, w) array, whose types may differ.
        channels: the c channel names of an array.
        compression: lossless "zip", "zips", "piz", "rle", "none"; "zip:9" is slower and smaller. Lossy
            "dwaa:45", "dwab:45": larger numbers give smaller files.
        metadata: entries of the header, as `read_exr_metadata` returns them.
        color_space: linear space of the colours, such as "ACEScg": the header states name and primaries if
            STUDIO_CONFIG has it. None: the header is silent, which means Rec. 709.

    Raises:
        ShotError: the types or sizes cannot be stored, or the disk refused.
    """
    named = image if isinstance(image, Mapping) else _by_name(path, image, channels)
    _check_storable(path, named)
    arrays = list(named.values())
    kinds = ["half" if array.dtype == np.float16 else "float" for array in arrays]
    spec = _spec(arrays[0].shape, list(named), kinds[0])
    if len(set(kinds)) > 1:  # for equal types OpenImageIO wants the image's type only
        spec.channelformats = tuple(TypeDesc(kind) for kind in kinds)
    spec.attribute("compression", compression)
    for name, value in (metadata or {}).items():
        if isinstance(value, TypedValues):
            spec.attribute(name, TypeDesc(value.type), value.values)
        else:
            spec.attribute(name, value)
    if color_space is not None:
        _state_color_space(spec, color_space)
    spec.attribute("DateTime", "")  # otherwise OpenImageIO stores the time, and files of equal images differ
    pixels = np.stack(arrays, axis=-1) if isinstance(image, Mapping) else image
    _write(path, spec, np.ascontiguousarray(pixels))  # np.stack: float32 where types differ, exact for half


def half_pixels(images: Sequence[Array]) -> NDArray[np.float16]:
    """Return (h, w, c) images as one array of half floats; values beyond +-65504 are clamped to it.

    Args:
        images: of equal size, with any number of channels each.
    """
    counts = [image.shape[2] for image in images]
    pixels = np.empty((*images[0].shape[:2], sum(counts)), np.float16)
    for image, end, count in zip(images, np.cumsum(counts), counts, strict=True):
        np.clip(image, -MAX_HALF, MAX_HALF, out=pixels[..., end - count : end], casting="unsafe")
    return pixels


def write_png(path: Path | str, image: Levels, encoding: str = SRGB, pixel_aspect: float = 1.0) -> None:
    """Write pixels as PNG, atomically.

    Args:
        path: the file; its folder is created where it is missing.
        image: (h, w, 3) uint8 or uint16; or (h, w, 4), with alpha that the colours are not multiplied by.
        encoding: of the pixels, by OpenImageIO's name; tags of the file state it.
        pixel_aspect: width of a pixel over its height; the file states it where it is not 1.

    Raises:
        ShotError: the array has another shape or type, or the disk refused.
    """
    spec = _integer_spec(path, image, np.uint8, np.uint16, channels=(3, 4))
    spec.attribute("oiio:UnassociatedAlpha", 1)  # otherwise OpenImageIO divides by alpha
    spec.attribute("oiio:ColorSpace", encoding)
    if pixel_aspect != 1.0:
        spec.attribute("PixelAspectRatio", pixel_aspect)
    spec.attribute("png:compressionLevel", 3)  # costs far less than the default, for files little larger
    spec.attribute("png:filter", _PAETH)
    _write(path, spec, np.ascontiguousarray(image))


def write_tiff(path: Path | str, image: Levels, encoding: str = SRGB, pixel_aspect: float = 1.0) -> None:
    """Write pixels as TIFF, deflated, atomically.

    Args:
        path: the file; its folder is created where it is missing.
        image: (h, w, 3) uint8 or uint16; or (h, w, 4), with alpha that the colours are not multiplied by.
        encoding: of the pixels, by OpenImageIO's name; TIFF has a tag for sRGB only.
        pixel_aspect: see `write_png`.

    Raises:
        ShotError: the array has another shape or type, or the disk refused.
    """
    spec = _integer_spec(path, image, np.uint8, np.uint16, channels=(3, 4))
    spec.attribute("oiio:UnassociatedAlpha", 1)  # otherwise OpenImageIO divides by alpha
    spec.attribute("oiio:ColorSpace", encoding)
    if pixel_aspect != 1.0:
        spec.attribute("PixelAspectRatio", pixel_aspect)
    spec.attribute("compression", "zip")
    spec.attribute("DateTime", "")
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
    """Return the bytes of a file that `write` writes: OpenImageIO's Python side has no encoder to memory."""
    with tempfile.TemporaryDirectory() as folder:
        write(path := Path(folder) / name)
        return path.read_bytes()


def _by_name(path: Path | str, image: Channel, channels: Sequence[str]) -> dict[str, Channel]:
    if image.ndim != 3 or image.shape[2] != len(channels):
        want = f"(h, w, {len(channels)}) for the channels {', '.join(channels)}"
        raise ShotError(path, f"the image to write is {image.shape}; want {want}")
    return {name: image[..., index] for index, name in enumerate(channels)}


def _check_storable(path: Path | str, image: Mapping[str, Channel]) -> None:
    shapes = {array.shape for array in image.values()}
    if len(shapes) != 1 or len(min(shapes)) != 2 or 0 in min(shapes):
        found = ", ".join(f"{name} {array.shape}" for name, array in image.items()) or "nothing"
        raise ShotError(path, f"the channels to write are {found}; want arrays (h, w) of one size")
    for name, array in image.items():
        if array.dtype not in (np.float16, np.float32):
            problem = f"channel {name} to write is {array.dtype}; want float16 or float32"
            raise ShotError(path, problem, f"Convert it: {name}.astype(np.float32).")


def _integer_spec(
    path: Path | str, image: Levels, *types: type[np.unsignedinteger[Any]], channels: Sequence[int] = (3,)
) -> ImageSpec:
    if image.ndim != 3 or image.shape[2] not in channels or image.dtype not in types or 0 in image.shape:
        shapes = " or ".join(f"(h, w, {count})" for count in channels)
        want = f"{shapes} {' or '.join(each.__name__ for each in types)}"
        raise ShotError(path, f"the image to write is {image.shape} {image.dtype}; want {want}")
    return _spec(image.shape, ["R", "G", "B", "A"][: image.shape[2]], image.dtype.name)


def _state_color_space(spec: ImageSpec, name: str) -> None:
    """Write the space into the header, as OpenImageIO (`colorInteropID`) and Nuke (primaries) read it."""
    config = ColorConfig(STUDIO_CONFIG)
    spec.attribute("oiio:ColorSpace", config.get_color_interop_id(name) or name)
    if primaries := config.get_chromaticities(name):
        spec.attribute("chromaticities", TypeDesc("float[8]"), primaries)


def _spec(shape: tuple[int, ...], names: list[str], kind: str) -> ImageSpec:
    spec = ImageSpec(shape[1], shape[0], len(names), kind)
    spec.channelnames = tuple(names)
    return spec


def _write(path: Path | str, spec: ImageSpec, pixels: NDArray[Any]) -> None:
    utf8_path(path)  # raises, with the name that the caller knows
    with replacing(path) as partial:
        name = utf8_path(partial)
        target = ImageOutput.create(name)
        if target is None:
            raise ShotError(path, f"cannot be written ({last_reason(geterror) or NO_REASON})")
        done = target.open(name, spec) and target.write_image(pixels)
        message = last_reason(target.geterror)  # on a full disk the PNG writer returns True, with a message
        if not (target.close() and done) or message:
            reason = message or last_reason(target.geterror) or NO_REASON
            reason = reason.replace(partial.name, Path(path).name)
            raise ShotError(path, f"cannot be written ({reason})", NO_ROOM)
