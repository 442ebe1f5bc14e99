"""Tests of EXR files with features of OpenEXR's test images: each is read right, or refused by name."""

import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from OpenImageIO import ROI, ImageBuf, ImageBufAlgo, ImageSpec, MakeTxTexture, TypeDesc

from supersampler import ShotError
from supersampler.conventions import Conventions
from supersampler.io.images import read_exr, read_image
from supersampler.io.shot import open_source
from upscale_runs import pixels, upscale

NAMES = ("R", "G", "B", "Z", "motion.X", "motion.Y")
SIZE = (48, 40)
OURS = Conventions()


def smooth(width: int = SIZE[0], height: int = SIZE[1]) -> np.ndarray:
    """Values that lossy compressions keep well; depth 0.5, no motion."""
    y, x = np.mgrid[:height, :width].astype(np.float32) / 48
    image = np.stack([0.2 + x, 0.3 + y, 0.5 + 0.2 * x, 0 * x + 0.5, 0 * x, 0 * x], axis=-1)
    return image.astype(np.float16).astype(np.float32)


def write(path: Path, image: np.ndarray, names: Sequence[str] = NAMES, **fields: Any) -> Path:
    """Write a half EXR file by OpenImageIO; `fields` are those of the spec, or else header entries."""
    path.parent.mkdir(parents=True, exist_ok=True)
    spec = ImageSpec(image.shape[1], image.shape[0], len(names), "half")
    spec.channelnames = tuple(names)
    for name, value in fields.items():
        if hasattr(spec, name):
            setattr(spec, name, value)
        else:
            spec.attribute(name, value)
    buffer = ImageBuf(spec)
    area = ROI(spec.x, spec.x + spec.width, spec.y, spec.y + spec.height)
    buffer.set_pixels(area, np.ascontiguousarray(image))
    assert buffer.write(str(path)), buffer.geterror()
    return path


def luminance_chroma(width: int = 8, height: int = 4) -> bytes:
    """An EXR file of Y, and of RY and BY at half the size, which OpenImageIO does not write."""

    def attribute(name: str, kind: str, data: bytes) -> bytes:
        return f"{name}\0{kind}\0".encode() + struct.pack("<i", len(data)) + data

    channels = b"".join(
        name + b"\0" + struct.pack("<iB3xii", 1, 0, step, step)
        for name, step in ((b"BY", 2), (b"RY", 2), (b"Y", 1))
    )
    window = struct.pack("<iiii", 0, 0, width - 1, height - 1)
    header = struct.pack("<II", 20000630, 2) + b"".join(
        (
            attribute("channels", "chlist", channels + b"\0"),
            attribute("compression", "compression", b"\0"),
            attribute("dataWindow", "box2i", window),
            attribute("displayWindow", "box2i", window),
            attribute("lineOrder", "lineOrder", b"\0"),
            attribute("pixelAspectRatio", "float", struct.pack("<f", 1.0)),
            attribute("screenWindowCenter", "v2f", struct.pack("<ff", 0.0, 0.0)),
            attribute("screenWindowWidth", "float", struct.pack("<f", 1.0)),
            b"\0",
        )
    )
    offsets, body = [], b""
    for row in range(height):
        offsets.append(len(header) + 8 * height + len(body))
        values = np.full(width * (2 if row % 2 == 0 else 1), 0.5, np.float16).tobytes()
        body += struct.pack("<ii", row, len(values)) + values
    return header + struct.pack(f"<{height}Q", *offsets) + body


def test_luminance_and_chroma_are_named_with_what_converts_them_and_not_called_damaged(
    tmp_path: Path,
) -> None:
    (tmp_path / "s.0001.exr").write_bytes(luminance_chroma())
    for read in (read_image, read_exr):
        with pytest.raises(
            ShotError, match=r"luminance and chroma \(Y, RY, BY\).* R, G and B; ImageM"
        ) as caught:
            read(tmp_path / "s.0001.exr")
        assert "damaged" not in str(caught.value)
    with pytest.raises(ShotError, match="luminance and chroma"):
        open_source(tmp_path, conventions=OURS)


@pytest.mark.parametrize(
    ("content", "damaged"),
    [
        (b"", True),
        (bytes(100), True),
        (b"v/1\x01\x02\0\0\0", True),
        (b"\xff\xd8\xff\xe0 a JPEG file", False),
        (b"v/1\x01\x03\0\0\0" + bytes(90), False),  # a version to come
    ],
)
def test_only_files_that_are_not_whole_are_called_damaged(
    tmp_path: Path, content: bytes, damaged: bool
) -> None:
    (tmp_path / "s.0001.exr").write_bytes(content)
    with pytest.raises(ShotError, match=r"\. \w+.*\.$") as caught:
        read_image(tmp_path / "s.0001.exr")
    assert ("damaged or cut off" in str(caught.value)) is damaged


def test_luminance_alone_is_a_grey_image(tmp_path: Path) -> None:
    image = smooth()
    write(tmp_path / "in" / "s.0001.exr", image[..., [0, 3, 4, 5]], ("Y", "Z", "motion.X", "motion.Y"))
    shot = open_source(tmp_path / "in", conventions=OURS)
    assert shot.info.aov_names == ()
    color = shot.read_raw(0).color
    assert color is not None
    np.testing.assert_array_equal(color, image[..., [0, 0, 0]])
    upscale(tmp_path / "in", tmp_path / "out", "--conventions", "{}", "--scale", "1")
    np.testing.assert_allclose(pixels(tmp_path / "out" / "s.0001.exr"), color, rtol=2e-3)


@pytest.mark.parametrize(
    ("compression", "tolerance"),
    [
        *((name, 0.0) for name in ("none", "rle", "zips", "zip", "piz", "pxr24")),
        *((name, 0.02) for name in ("b44", "b44a", "dwaa", "dwab")),
    ],
)
def test_every_compression_is_read(tmp_path: Path, compression: str, tolerance: float) -> None:
    path = write(tmp_path / "s.0001.exr", smooth(), compression=compression)
    image = read_exr(path)
    for index, name in enumerate(NAMES):
        np.testing.assert_allclose(image[name], smooth()[..., index], atol=tolerance)


def test_tiles_and_rows_from_the_bottom_are_the_image(tmp_path: Path) -> None:
    tiled = write(tmp_path / "tiled.exr", smooth(), tile_width=7, tile_height=9)
    rows = write(tmp_path / "rows.exr", smooth(), **{"openexr:lineOrder": "decreasingY"})
    for path in (tiled, rows):
        image = read_exr(path)
        for index, name in enumerate(NAMES):
            np.testing.assert_array_equal(image[name], smooth()[..., index])


def test_of_a_file_with_smaller_copies_the_largest_is_read(tmp_path: Path) -> None:
    image = smooth(64, 32)[..., :3]  # powers of two are not resampled
    write(tmp_path / "plain.exr", image, NAMES[:3])
    path = tmp_path / "mip.exr"
    assert ImageBufAlgo.make_texture(MakeTxTexture, str(tmp_path / "plain.exr"), str(path))
    assert ImageBuf(str(path)).nmiplevels > 1
    np.testing.assert_array_equal(np.stack([read_exr(path)[name] for name in NAMES[:3]], -1), image)


@pytest.mark.parametrize(
    ("at", "display"),
    [((-7, -5), (-7, -5, 48, 40)), ((100, 60), (100, 60, 48, 40)), ((-7, -5), (0, 0, 20, 16))],
)
def test_windows_anywhere_show_the_pixels_of_the_display_window(
    tmp_path: Path, at: tuple[int, int], display: tuple[int, int, int, int]
) -> None:
    x, y, width, height = display
    fields: dict[str, Any] = {
        "x": at[0],
        "y": at[1],
        "full_x": x,
        "full_y": y,
        "full_width": width,
        "full_height": height,
    }
    write(tmp_path / "in" / "s.0001.exr", smooth(), **fields)
    shot = open_source(tmp_path / "in", conventions=OURS)
    assert shot.render_size == (width, height)
    color = shot.read_raw(0).color
    assert color is not None
    left, top = x - at[0], y - at[1]
    np.testing.assert_array_equal(color, smooth()[top : top + height, left : left + width, :3])
    upscale(tmp_path / "in", tmp_path / "out", "--conventions", "{}", "--scale", "2")
    result = ImageBuf(str(tmp_path / "out" / "s.0001.exr")).spec()
    assert (result.x, result.y, result.full_width, result.full_height) == (0, 0, 2 * width, 2 * height)


def test_whole_numbers_for_colour_are_refused_by_the_channel(tmp_path: Path) -> None:
    spec_types = tuple(map(TypeDesc, ("uint", "uint", "uint", "half", "half", "half")))
    write(tmp_path / "s.0001.exr", smooth(), channelformats=spec_types)
    with pytest.raises(ShotError, match="channel R is uint32; want half or float"):
        open_source(tmp_path, conventions=OURS).read(0)


def test_channels_of_a_view_alone_are_listed_with_what_to_do(tmp_path: Path) -> None:
    names = tuple(f"left.{name}" for name in NAMES)
    write(tmp_path / "s.0001.exr", smooth(), names)
    with pytest.raises(ShotError, match=r"left\.R, left\.G.* A channels\.json says which is which"):
        open_source(tmp_path, conventions=OURS)
