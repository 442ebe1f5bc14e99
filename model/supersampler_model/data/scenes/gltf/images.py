"""PNG and JPEG images of a glTF file."""

import tempfile
from pathlib import Path

import numpy as np
from OpenImageIO import ImageInput, ImageSpec, geterror

from supersampler.io.files import write_bytes
from supersampler_model.data.scenes.gltf.document import Document
from supersampler_model.data.scenes.gltf.errors import MalformedError, at
from supersampler_model.data.values import Pixels

LARGEST = 16384  # texels a side; no GL takes more
_SUFFIXES = {b"\x89PNG": ".png", b"\xff\xd8\xff": ".jpg"}


def image_of(document: Document, index: int) -> Pixels:
    """Return (h, w, 3 or 4) uint8; a fourth channel is opacity, by which the others are not multiplied."""
    image = document.item("images", index)
    with at(document.name("images", index)):
        if "bufferView" in image:
            return _decoded(document, document.view(image["bufferView"])[0])
        return _decoded(document, document.load(image["uri"]))


def _decoded(document: Document, data: bytes) -> Pixels:
    """Return the pixels of a PNG or JPEG file; grey becomes colour, 16 bits become 8."""
    suffix = next((suffix for magic, suffix in _SUFFIXES.items() if data.startswith(magic)), None)
    if suffix is None:
        raise MalformedError(f"it is neither PNG nor JPEG (it begins with {data[:4]!r})")
    with tempfile.TemporaryDirectory() as folder:  # OpenImageIO's Python side reads files only
        path = Path(folder) / f"image{suffix}"
        write_bytes(path, data)
        pixels = _read(document, path)
    if pixels.shape[2] < 3:
        pixels = np.concatenate([pixels[..., :1]] * 3 + [pixels[..., 1:]], axis=-1)
    return np.ascontiguousarray(pixels[..., :4])


def _read(document: Document, path: Path) -> Pixels:
    config = ImageSpec()
    config.attribute("oiio:UnassociatedAlpha", 1)
    source = ImageInput.open(str(path), config)
    if source is None:
        raise MalformedError(f"it is damaged ({geterror().strip()})")
    spec = source.spec()
    if max(spec.width, spec.height) > LARGEST:
        raise MalformedError(f"it is {spec.width} x {spec.height}; want at most {LARGEST} a side")
    document.claim("images", spec.width * spec.height * spec.nchannels)
    pixels = source.read_image(0, 0, 0, spec.nchannels, "uint8")
    if pixels is None:
        raise MalformedError(f"it is damaged ({source.geterror().strip()})")
    return np.asarray(pixels, np.uint8)
