"""Read and write EXR files, write PNG and JPEG, by OpenImageIO. Channel types are kept; writes are atomic."""

import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray
from OpenImageIO import ImageInput, ImageOutput, ImageSpec, TypeDesc, geterror

from supersampler.errors import ShotError
from supersampler.io.atomic import NO_ROOM, check_is_file, os_errors_as_shot_error, replacing
from supersampler.io.limits import IMAGE_BYTES, IMAGE_CHANNELS, IMAGE_PARTS, image_size_problem

Bytes: TypeAlias = NDArray[np.uint8]
Channel: TypeAlias = NDArray[Any]
"""(h, w), of the type it has in the file: float16, float32 or uint32."""


def read_exr(
    path: Path | str, *, only: Iterable[str] | None = None, without: Iterable[str] = ()
) -> dict[str, Channel]:
    """Read the channels of an EXR file, in OpenImageIO's order (R, G, B, A first, then by name).

    The parts of a multi-part file are read as one image. A part's name is prefixed to its channels where they
    do not begin with it.

    Args:
        path: the file.
        only: names of the channels to return; missing ones are left out.
        without: names of channels to leave out.

    Returns:
        Channel name to (h, w) array; half stays float16, float stays float32, uint stays uint32.

    Raises:
        ShotError: the file is missing, truncated, not EXR, cropped or deep, or exceeds
            `supersampler.io.limits`.
    """
    wanted, unwanted = None if only is None else frozenset(only), frozenset(without)
    image: dict[str, Channel] = {}
    with _opened(path) as source:
        for part, names in enumerate(_part_names(source, path)):
            chosen = frozenset(names if wanted is None else wanted.intersection(names)) - unwanted
            if chosen:
                image.update(_read_part(source, part, names, chosen, path))
    return image


def read_exr_channels(path: Path | str) -> list[str]:
    """Return the channel names of `read_exr` from the file's header, without reading pixels."""
    with _opened(path) as source:
        return [name for names in _part_names(source, path) for name in names]


def write_exr(
    path: Path | str,
    image: Channel | Mapping[str, Channel],
    channels: Sequence[str] = ("R", "G", "B"),
    *,
    compression: str = "zip",
) -> None:
    """Write an EXR file atomically. float16 is stored as half, float32 as float.

    Args:
        path: the file; its folder is created where it is missing.
        image: (h, w, c) array, or channel name to (h, w) array, whose types may differ.
        channels: the c channel names of an array.
        compression: lossless "zip", "zips", "piz", "rle", "none"; "zip:9" is slower and smaller. Lossy
            "dwaa:45", "dwab:45": larger numbers give smaller files.

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
    spec.attribute("DateTime", "")  # otherwise OpenImageIO stores the time, and files of equal images differ
    pixels = np.stack([array.astype(np.float32, copy=False) for array in arrays], axis=-1)  # exact for half
    _write(path, spec, pixels)


def write_png(path: Path | str, image: Bytes) -> None:
    """Write (h, w, 3) uint8 sRGB pixels as PNG, atomically.

    Raises:
        ShotError: the array is not (h, w, 3) uint8, or the disk refused.
    """
    spec = _byte_spec(path, image)
    spec.attribute("oiio:ColorSpace", "sRGB")
    _write(path, spec, np.ascontiguousarray(image))


def encode_png(image: Bytes) -> bytes:
    """Return (h, w, 3) uint8 sRGB pixels as the bytes of a PNG file."""
    with tempfile.TemporaryDirectory() as folder:
        write_png(path := Path(folder) / "image.png", image)
        return path.read_bytes()


def encode_jpeg(image: Bytes, quality: int = 90) -> bytes:
    """Return (h, w, 3) uint8 sRGB pixels as the bytes of a JPEG file; `quality` is 1 (smallest) to 100."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "image.jpg"
        spec = _byte_spec(path, image)
        spec.attribute("Compression", f"jpeg:{quality}")
        spec.attribute("jpeg:subsampling", "4:4:4")  # 4:2:0 would blur thin lines
        _write(path, spec, np.ascontiguousarray(image))
        return path.read_bytes()


@contextmanager
def _opened(path: Path | str) -> Iterator[ImageInput]:
    """Open an EXR file; errors of the decoder become ShotErrors.

    The first bytes are checked before, as OpenImageIO would try all of its other decoders.
    """
    try:
        with os_errors_as_shot_error(path):
            check_is_file(Path(path))
            with Path(path).open("rb") as file:
                begins = file.read(len(_MAGIC))
            if begins != _MAGIC:
                raise ShotError(path, f"is not an EXR image (it begins with {begins!r})", _DAMAGED)
            source = ImageInput.open(str(path))
            if source is None:
                reason = _reason(geterror) or _NO_REASON
                raise ShotError(path, f"is not an image that can be read ({reason})", _DAMAGED)
            try:
                yield source
            finally:
                source.close()
    except MemoryError as error:
        raise ShotError(path, "claims more pixels than there is memory for", _DAMAGED) from error


_NO_REASON = "no reason given"
_MAGIC = b"v/1\x01"
_DAMAGED = "The file is damaged or cut off; write or copy it again."


def _part_names(source: ImageInput, path: Path | str) -> list[list[str]]:
    """Return the channel names of each part; in a multi-part file they begin with the part's name."""
    parts: list[tuple[str, list[str]]] = []
    count = 0
    while source.seek_subimage(len(parts), 0):
        spec = source.spec()
        parts.append((spec.get_string_attribute("oiio:subimagename"), list(spec.channelnames)))
        count += spec.nchannels
        if len(parts) > IMAGE_PARTS or count > IMAGE_CHANNELS:
            limits = f"want at most {IMAGE_CHANNELS} in {IMAGE_PARTS}"
            raise ShotError(path, f"has {count} channels or more in {len(parts)} parts or more; {limits}")
    _reason(source.geterror)  # clears the message of the seek past the last part
    if len(parts) == 1:
        return [parts[0][1]]
    return [
        [name if not part or name.startswith(f"{part}.") else f"{part}.{name}" for name in names]
        for part, names in parts
    ]


def _read_part(
    source: ImageInput, part: int, names: list[str], wanted: frozenset[str], path: Path | str
) -> dict[str, Channel]:
    source.seek_subimage(part, 0)
    spec = source.spec()
    if (problem := image_size_problem(spec.width, spec.height)) is not None:
        raise ShotError(path, problem, _DAMAGED)
    if spec.deep:
        raise ShotError(path, "holds deep pixels", "Write it with one value per pixel.")
    window = (spec.x, spec.y, spec.width, spec.height)
    full = (spec.full_x, spec.full_y, spec.full_width, spec.full_height)
    if window != full:
        problem = f"holds a part of its image: (x, y, w, h) {window} of {full}"
        raise ShotError(path, problem, "Render without a crop region and without overscan.")
    indices = [index for index, name in enumerate(names) if name in wanted]
    begin = indices[0]
    size = spec.width * spec.height * (indices[-1] + 1 - begin) * np.dtype(np.float32).itemsize
    if size > IMAGE_BYTES:
        raise ShotError(path, f"has {size >> 30} GiB of pixels; want at most {IMAGE_BYTES >> 30}", _DAMAGED)
    pixels = source.read_image(part, 0, begin, indices[-1] + 1, "float")
    if pixels is None:
        reason = _reason(source.geterror) or _NO_REASON
        raise ShotError(path, f"cannot be read to its end ({reason})", _DAMAGED)
    return {names[index]: _plane(source, part, index, pixels[..., index - begin]) for index in indices}


def _plane(source: ImageInput, part: int, index: int, pixels: NDArray[Any]) -> Channel:
    """Return one channel with its type in the file; half values are exact in float32."""
    kind = str(source.spec().channelformat(index))
    if kind == "uint":  # converted to float, they would be fractions of 2^32
        whole = source.read_image(part, 0, index, index + 1, "uint")
        if whole is not None:
            return whole[..., 0]
    plane = np.ascontiguousarray(pixels)
    return plane.astype(np.float16) if kind == "half" else plane


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


def _byte_spec(path: Path | str, image: Bytes) -> ImageSpec:
    if image.ndim != 3 or image.shape[2] != 3 or image.dtype != np.uint8 or 0 in image.shape:
        raise ShotError(path, f"the image to write is {image.shape} {image.dtype}; want (h, w, 3) uint8")
    return _spec(image.shape, ["R", "G", "B"], "uint8")


def _spec(shape: tuple[int, ...], names: list[str], kind: str) -> ImageSpec:
    spec = ImageSpec(shape[1], shape[0], len(names), kind)
    spec.channelnames = tuple(names)
    return spec


def _write(path: Path | str, spec: ImageSpec, pixels: NDArray[Any]) -> None:
    with replacing(path) as partial:
        target = ImageOutput.create(str(partial))
        if target is None:
            raise ShotError(path, f"cannot be written ({_reason(geterror) or _NO_REASON})")
        done = target.open(str(partial), spec) and target.write_image(pixels)
        message = _reason(target.geterror)  # on a full disk the PNG writer returns True and leaves a message
        if not (target.close() and done) or message:
            reason = message or _reason(target.geterror) or _NO_REASON
            reason = reason.replace(partial.name, Path(path).name)
            raise ShotError(path, f"cannot be written ({reason})", NO_ROOM)


def _reason(last_error: Callable[[], str]) -> str:
    """Return the first line of OpenImageIO's last error message and clear it; "" where there is none."""
    try:
        message = last_error().strip()
    except UnicodeDecodeError:  # the message quotes bytes of the file
        return "it holds text that is not UTF-8"
    return message.splitlines()[0] if message else ""
