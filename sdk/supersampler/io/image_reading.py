"""Read EXR files by OpenImageIO. Channel types are kept."""

import re
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray
from OpenImageIO import ImageInput, geterror

from supersampler.errors import ShotError
from supersampler.io.atomic import check_is_file, os_errors_as_shot_error
from supersampler.io.limits import IMAGE_BYTES, IMAGE_CHANNELS, IMAGE_PARTS, image_size_problem

Channel: TypeAlias = NDArray[Any]
"""(h, w), of the type it has in the file: float16, float32 or uint32."""
Metadata: TypeAlias = dict[str, str | int | float]
"""Entries of an EXR file's header, by name."""

NO_REASON = "no reason given"

_LAYOUT = re.compile(
    "oiio:|openexr:|cryptomatte/|(compression|BlenderMultiChannel|DateTime|PixelAspectRatio|screenWindowWidth"
    "|[XY]Resolution|ResolutionUnit|Orientation|name|type|view|chunkCount|version)$"
)
_MOST_ENTRIES, _LONGEST_TEXT = 256, 4096


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


def read_exr_metadata(path: Path | str) -> Metadata:
    """Return what the program that wrote an EXR file says of it, such as Frame, Camera and timecodes.

    Entries about the file's own layout are left out: its compression, its window, the kind of its channels.
    """
    with _opened(path) as source:
        found: Metadata = {}
        for entry in source.spec().extra_attribs:
            value, name = entry.value, str(entry.name)
            if isinstance(value, str | int | float) and not _LAYOUT.match(name):
                found[name] = value[:_LONGEST_TEXT] if isinstance(value, str) else value
            if len(found) == _MOST_ENTRIES:
                break
    return found


def last_reason(last_error: Callable[[], str]) -> str:
    """Return the first line of OpenImageIO's last error message and clear it; "" where there is none."""
    try:
        message = last_error().strip()
    except UnicodeDecodeError:  # the message quotes bytes of the file
        return "it holds text that is not UTF-8"
    return message.splitlines()[0] if message else ""


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
                reason = last_reason(geterror) or NO_REASON
                raise ShotError(path, f"is not an image that can be read ({reason})", _DAMAGED)
            try:
                yield source
            finally:
                source.close()
    except MemoryError as error:
        raise ShotError(path, "claims more pixels than there is memory for", _DAMAGED) from error


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
    last_reason(source.geterror)  # clears the message of the seek past the last part
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
        reason = last_reason(source.geterror) or NO_REASON
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
