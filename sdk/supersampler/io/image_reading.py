"""Read EXR, PNG and TIFF files by OpenImageIO. Channel types are kept."""

import re
from collections.abc import Callable, Collection, Iterable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray
from OpenImageIO import ImageInput, ImageSpec, geterror

from supersampler.errors import ShotError
from supersampler.io.files import check_is_file, os_errors_as_shot_error, utf8_path
from supersampler.io.limits import IMAGE_BYTES, IMAGE_CHANNELS, IMAGE_PARTS, image_size_problem

Channel: TypeAlias = NDArray[Any]
"""(h, w), of the type it has in the file: float16, float32 or uint32."""
Outside: TypeAlias = Mapping[str, float]
"""Values of pixels outside of a file's data window, by channel; 0 for the others."""

NO_REASON = "no reason given"
_MAGIC: Mapping[str, tuple[bytes, ...]] = {
    "exr": (b"v/1\x01",), "png": (b"\x89PNG",), "tif": (b"II*\0", b"MM\0*", b"II+\0", b"MM\0+"),
}  # fmt: skip
FORMATS = tuple(_MAGIC)
"""Of the files that are read: "exr", "png", "tif"."""
_DAMAGED = "The file is damaged or cut off; write or copy it again."
_TOO_LARGE = "Write it smaller; if it is smaller, its header is damaged: copy it again."
_SIGNS_OF_DAMAGE = re.compile(
    r"end of file|READ_IO|corrupt|truncat|CRC|read error|cannot read", re.IGNORECASE
)
"""Words in messages of the decoders about files that are not whole."""


def read_exr(
    path: Path | str,
    *,
    only: Iterable[str] | None = None,
    without: Iterable[str] = (),
    outside: Outside | None = None,
) -> dict[str, Channel]:
    """Read the channels of an EXR file, in OpenImageIO's order (R, G, B, A first, then by name).

    The parts of a multi-part file are read as one image. A part's name is prefixed to its channels where they
    do not begin with it. Overscan, pixels outside of the display window, is cut off.

    Args:
        path: the file.
        only: names of the channels to return; missing ones are left out.
        without: names of channels to leave out.
        outside: values where the data window is smaller than the display window; None refuses such a file.

    Returns:
        Channel name to (h, w) array; half stays float16, float stays float32, uint stays uint32. The arrays
        may be views of one that interleaves them.

    Raises:
        ShotError: the file is missing, truncated, not EXR or deep, has a data window that is not allowed,
            or exceeds `supersampler.io.limits`.
    """
    return read_image(path, only=only, without=without, outside=outside, formats=("exr",))


def read_image(
    path: Path | str,
    *,
    only: Iterable[str] | None = None,
    without: Iterable[str] = (),
    outside: Outside | None = None,
    formats: Collection[str] = FORMATS,
) -> dict[str, Channel]:
    """Read the channels of an EXR, PNG or TIFF file, as `read_exr` does.

    Integers of PNG and TIFF are returned as float32, value / largest value; a palette as its colours. RGB is
    not multiplied by alpha. Of a TIFF with several pages the first is read.
    """
    wanted, unwanted = None if only is None else frozenset(only), frozenset(without)
    image: dict[str, Channel] = {}
    with opened(path, formats) as (source, kind):
        for part, names in enumerate(_part_names(source, path, kind)):
            chosen = frozenset(names if wanted is None else wanted.intersection(names)) - unwanted
            if chosen:
                image.update(_read_part(source, part, names, chosen, path, outside))
    return image


def read_exr_channels(path: Path | str) -> list[str]:
    """Return the channel names of `read_exr` from the file's header, without reading pixels."""
    with opened(path, ("exr",)) as (source, kind):
        return [name for names in _part_names(source, path, kind) for name in names]


def read_types(path: Path | str) -> dict[str, str]:
    """Return the channels of `read_image` with their types: "half", "float", "uint", "uint8", "uint16"."""
    with opened(path) as (source, kind):
        types: dict[str, str] = {}
        for part, names in enumerate(_part_names(source, path, kind)):
            source.seek_subimage(part, 0)
            spec = source.spec()
            types |= {name: str(spec.channelformat(index)) for index, name in enumerate(names)}
        return types


def last_reason(last_error: Callable[[], str]) -> str:
    """Return the first line of OpenImageIO's last error message and clear it; "" where there is none."""
    try:
        message = last_error().strip()
    except UnicodeDecodeError:  # the message quotes bytes of the file
        return "it holds text that is not UTF-8"
    return message.splitlines()[0] if message else ""


@contextmanager
def opened(path: Path | str, formats: Collection[str] = FORMATS) -> Iterator[tuple[ImageInput, str]]:
    """Open a file and return its format, too; errors of the decoder become ShotErrors.

    The first bytes are checked before, as OpenImageIO would try all of its other decoders.
    """
    try:
        with os_errors_as_shot_error(path):
            check_is_file(Path(path))
            with Path(path).open("rb") as file:
                begins = file.read(4)
            kind = next((kind for kind in formats if begins in _MAGIC[kind]), None)
            if kind is None:
                listed = " or ".join(kind.upper() for kind in formats)
                hint = f"Write it as {listed}; its name does not decide." if any(begins) else _DAMAGED
                raise ShotError(path, f"is not an {listed} image (it begins with {begins!r})", hint)
            as_stored = ImageSpec()
            as_stored.attribute("oiio:UnassociatedAlpha", 1)
            source = ImageInput.open(utf8_path(path), as_stored)
            if source is None:
                raise _unreadable(path, last_reason(geterror) or NO_REASON)
            try:
                yield source, kind
            finally:
                source.close()
    except MemoryError as error:
        raise ShotError(path, "claims more pixels than there is memory for", _TOO_LARGE) from error


def _unreadable(path: Path | str, reason: str) -> ShotError:
    """Return the error for a file that the decoder does not open; it is called damaged only where it is."""
    if re.search(r"subsampled.*\b[RB]Y\b", reason, re.IGNORECASE):
        problem = "holds luminance and chroma (Y, RY, BY), chroma at half the size"
        return ShotError(path, problem, "Write R, G and B; ImageMagick converts it: magick IN.exr OUT.exr.")
    if re.search("subsampled", reason, re.IGNORECASE):
        return ShotError(path, f"holds channels of less than its size ({reason})", "Write all at one size.")
    hint = "Write it with other settings, or copy it again."
    if _SIGNS_OF_DAMAGE.search(reason):
        hint = _DAMAGED
    return ShotError(path, f"is not an image that can be read ({reason})", hint)


def _part_names(source: ImageInput, path: Path | str, kind: str) -> list[list[str]]:
    """Return the channel names of each part; in a multi-part EXR file they begin with the part's name.

    Of other formats only the first image is read: further pages of a TIFF are often small copies.
    """
    if kind != "exr":
        return [list(source.spec().channelnames)]
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
    source: ImageInput,
    part: int,
    names: list[str],
    wanted: frozenset[str],
    path: Path | str,
    outside: Outside | None,
) -> dict[str, Channel]:
    source.seek_subimage(part, 0)
    spec = source.spec()
    for size in ((spec.width, spec.height), (spec.full_width, spec.full_height)):
        if (problem := image_size_problem(*size)) is not None:
            raise ShotError(path, problem, _TOO_LARGE)
    if spec.deep:
        raise ShotError(path, "holds deep pixels", "Write it with one value per pixel.")
    if outside is None and not _covers_display(spec):
        window = (spec.x, spec.y, spec.width, spec.height)
        full = (spec.full_x, spec.full_y, spec.full_width, spec.full_height)
        problem = f"holds a part of its image: (x, y, w, h) {window} of {full}"
        raise ShotError(path, problem, "Render it without a crop region.")
    indices = [index for index, name in enumerate(names) if name in wanted]
    begin = indices[0]
    area = max(spec.width * spec.height, spec.full_width * spec.full_height)
    size_bytes = area * (indices[-1] + 1 - begin) * np.dtype(np.float32).itemsize
    if size_bytes > IMAGE_BYTES:
        problem = f"has {size_bytes >> 30} GiB of pixels; want at most {IMAGE_BYTES >> 30}"
        raise ShotError(path, problem, _TOO_LARGE)
    kinds = {str(spec.channelformat(index)) for index in indices}
    kind = "half" if kinds == {"half"} else "float"  # of mixed types, two reads would decompress twice
    pixels = source.read_image(part, 0, begin, indices[-1] + 1, kind)
    if pixels is None:
        reason = last_reason(source.geterror) or NO_REASON
        raise ShotError(path, f"cannot be read to its end ({reason})", _DAMAGED)
    planes = {names[index]: _plane(source, part, index, pixels[..., index - begin]) for index in indices}
    return {name: _in_display(plane, spec, (outside or {}).get(name, 0.0)) for name, plane in planes.items()}


def _plane(source: ImageInput, part: int, index: int, pixels: NDArray[Any]) -> Channel:
    """Return one channel with its type in the file; half values are exact in float32."""
    kind = str(source.spec().channelformat(index))
    if kind == "uint":  # converted to float, they would be fractions of 2^32
        whole = source.read_image(part, 0, index, index + 1, "uint")
        if whole is not None:
            return whole[..., 0]
    return pixels.astype(np.float16, copy=False) if kind == "half" else pixels


def _covers_display(spec: ImageSpec) -> bool:
    """Return whether the data window contains the whole display window."""
    return bool(
        spec.x <= spec.full_x
        and spec.y <= spec.full_y
        and spec.x + spec.width >= spec.full_x + spec.full_width
        and spec.y + spec.height >= spec.full_y + spec.full_height
    )


def _in_display(plane: Channel, spec: ImageSpec, outside: float) -> Channel:
    """Return the pixels of the display window; `outside` where the data window has none."""
    left, top = spec.x - spec.full_x, spec.y - spec.full_y  # of the data window
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
