"""Tests of reading and writing EXR, PNG and JPEG files."""

import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import hypothesis.extra.numpy as hnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from OpenImageIO import ImageBuf, ImageInput, ImageSpec

from commands import ran
from exr_parts import write_parts
from supersampler import ShotError
from supersampler.io import images
from supersampler.io.files import replacing
from supersampler.io.safetensors import open_safetensors, write_safetensors

HOSTILE = [np.nan, np.inf, -np.inf, -0.0, 65504.0, 0.25, -1.5, 2.0**-24]  # all of them halves
PIXELS = np.arange(5 * 7 * 3, dtype=np.float32).reshape(5, 7, 3)
BYTES = PIXELS.astype(np.uint8)


@settings(deadline=None, max_examples=30)
@given(data=st.data(), names=st.sets(st.sampled_from(["R", "G", "B", "depth.Z", "aovs.10", "x"]), min_size=1))
@pytest.mark.parametrize("compression", ["zip:9", "piz", "none"])
def test_an_exr_keeps_values_and_types(data: st.DataObject, names: set[str], compression: str) -> None:
    shape = data.draw(st.tuples(st.integers(1, 9), st.integers(1, 9)))
    kinds = {name: data.draw(st.sampled_from([np.float16, np.float32])) for name in sorted(names)}
    values = hnp.arrays(np.float64, shape, elements=st.sampled_from(HOSTILE))
    image = {name: data.draw(values).astype(kind) for name, kind in kinds.items()}
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "image.exr"
        images.write_exr(path, image, compression=compression)
        again = images.read_exr(path)
        assert set(again) == names == set(images.read_header(path).types)
    for name, array in image.items():
        assert again[name].dtype == array.dtype
        np.testing.assert_array_equal(again[name], array)


def test_an_array_is_written_as_r_g_b_and_single_channels_are_read(tmp_path: Path) -> None:
    path = tmp_path / "made" / "on the way" / "image.exr"
    images.write_exr(path, PIXELS)
    assert list(images.read_exr(path)) == ["R", "G", "B"]
    np.testing.assert_array_equal(images.read_exr(path, only=["G", "none"])["G"], PIXELS[..., 1])
    assert list(images.read_exr(path, only=["G", "none"])) == ["G"]


def test_no_time_is_stored_so_that_equal_images_are_equal_files(tmp_path: Path) -> None:
    for name in ("a.exr", "b.exr"):
        images.write_exr(tmp_path / name, PIXELS)
    assert (tmp_path / "a.exr").read_bytes() == (tmp_path / "b.exr").read_bytes()
    assert ImageBuf(str(tmp_path / "a.exr")).spec().get_string_attribute("DateTime") == ""


def test_whole_numbers_stay_whole_numbers(tmp_path: Path) -> None:
    spec = ImageSpec(2, 1, 1, "uint")
    write_parts(tmp_path / "ids.exr", (spec, np.array([[[1], [70000]]], np.uint32)))
    (ids,) = images.read_exr(tmp_path / "ids.exr").values()
    assert ids.dtype == np.uint32
    assert ids.tolist() == [[1, 70000]]


def test_a_cropped_render_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "crop.exr"
    spec = ImageSpec(4, 3, 3, "half")
    spec.x, spec.full_width, spec.full_height = 2, 8, 3
    write_parts(path, (spec, np.zeros((3, 4, 3), np.float32)))
    with pytest.raises(ShotError, match=r"holds a part of its image.*without a crop"):
        images.read_exr(path)


@pytest.mark.parametrize(
    ("image", "message"),
    [
        ({"R": np.zeros((2, 3)), "G": np.zeros((2, 3))}, "channel R to write is float64; want float16 or"),
        ({"R": np.zeros((2, 3), np.float32), "G": np.zeros((2, 4), np.float32)}, r"R \(2, 3\), G \(2, 4\)"),
        ({}, "are nothing; want arrays"),
        (np.zeros((2, 3, 4), np.float32), r"is \(2, 3, 4\); want \(h, w, 3\) for the channels R, G, B"),
    ],
)
def test_values_that_exr_cannot_store_are_refused(
    tmp_path: Path, image: np.ndarray | dict[str, np.ndarray], message: str
) -> None:
    with pytest.raises(ShotError, match=message):
        images.write_exr(tmp_path / "image.exr", image)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("write", "name"), [(images.write_png, "image.png"), (images.write_tiff, "image.tif")]
)
@pytest.mark.parametrize("kind", [np.uint8, np.uint16])
def test_integers_come_back_and_are_tagged_as_srgb(
    tmp_path: Path, write: Callable[..., None], name: str, kind: type[np.unsignedinteger[Any]]
) -> None:
    image = np.random.default_rng(0).integers(0, np.iinfo(kind).max + 1, (5, 7, 3)).astype(kind)
    write(tmp_path / name, image)
    found: Any = ImageInput.open(str(tmp_path / name))
    np.testing.assert_array_equal(found.read_image(np.dtype(kind).name), image)
    assert found.spec().format == np.dtype(kind).name
    assert found.spec().get_string_attribute("oiio:ColorSpace").startswith("srgb_rec709")
    write(tmp_path / f"again {name}", image)
    assert (tmp_path / name).read_bytes() == (tmp_path / f"again {name}").read_bytes()
    if (name, kind) == ("image.png", np.uint8):
        assert images.encode_png(image) == (tmp_path / name).read_bytes()


def test_a_png_of_another_display_is_tagged_as_its_encoding(tmp_path: Path) -> None:
    images.write_png(tmp_path / "image.png", BYTES, "srgb_p3d65_display")
    content = (tmp_path / "image.png").read_bytes()
    assert b"cICP" + bytes([12, 13, 0, 1]) in content  # primaries of P3, curve of sRGB
    assert b"sRGB" not in content


def test_pixels_become_half_floats_in_one_array_and_too_large_ones_are_clamped() -> None:
    color = np.array([[[1e30, -np.inf, 0.1]]], np.float32)
    pixels = images.half_pixels([color, np.array([[[np.nan, 70000.0]]], np.float32)])
    assert pixels.dtype == np.float16
    np.testing.assert_array_equal(pixels[0, 0], np.array([65504, -65504, 0.1, np.nan, 65504], np.float16))


def test_a_jpeg_is_close_and_closer_with_more_quality(tmp_path: Path) -> None:
    ramp = np.add.outer(np.arange(40), np.arange(60))[..., None] * np.array([1, 2, 0.5])
    image = ramp.astype(np.uint8)
    errors = []
    for quality in (30, 100):
        (tmp_path / "image.jpg").write_bytes(images.encode_jpeg(image, quality))
        shown = np.asarray(ImageBuf(str(tmp_path / "image.jpg")).get_pixels("uint8"))
        errors.append(np.abs(shown.astype(float) - image).mean())
    assert errors[1] < 1 < errors[0] < 20


@pytest.mark.parametrize("image", [np.zeros((2, 3), np.uint8), np.zeros((2, 3, 3), np.float32)])
def test_a_png_of_anything_but_bytes_is_refused(tmp_path: Path, image: np.ndarray) -> None:
    with pytest.raises(ShotError, match=r"want \(h, w, 3\) or \(h, w, 4\) uint8"):
        images.write_png(tmp_path / "image.png", image)


def test_a_write_that_fails_leaves_the_old_file_and_no_other(tmp_path: Path) -> None:
    path = tmp_path / "image.exr"
    images.write_exr(path, PIXELS)

    def write_half_and_stop() -> None:
        with replacing(path) as partial:
            partial.write_bytes(b"half of it")
            raise RuntimeError("stopped")

    with pytest.raises(RuntimeError, match="stopped"):
        write_half_and_stop()
    assert [file.name for file in tmp_path.iterdir()] == ["image.exr"]
    np.testing.assert_array_equal(images.read_exr(path)["R"], PIXELS[..., 0])


FULL_DISK = """
import resource, sys
import numpy as np
from supersampler.errors import ShotError
from supersampler.io.images import write_exr, write_png
resource.setrlimit(resource.RLIMIT_FSIZE, (10_000, 10_000))
noise = np.random.default_rng(0).random((100, 100, 3), np.float32)
for write, name, image in ((write_exr, "a.exr", noise), (write_png, "a.png", (noise * 255).astype(np.uint8))):
    try:
        write(f"{sys.argv[1]}/{name}", image)
    except ShotError as error:
        print(error)
"""


@pytest.mark.skipif(sys.platform == "win32", reason="Windows has no limit on the size of files to set")
def test_a_full_disk_is_an_error_and_leaves_nothing(tmp_path: Path) -> None:
    exr, png = ran(sys.executable, "-c", FULL_DISK, tmp_path).splitlines()
    for line, name in ((exr, "a.exr"), (png, "a.png")):  # OpenImageIO's PNG writer says that all went well
        assert line.startswith(f"{tmp_path / name}: cannot be written (")
        assert "partial" not in line
    assert list(tmp_path.iterdir()) == []


TYPES = ("f2", "f4", "f8", "?", "u1", "i1", "u2", "i2", "u4", "i4", "u8", "i8")


def test_arrays_of_every_type_and_layout_come_back_aligned(tmp_path: Path) -> None:
    random = np.random.default_rng(0)
    arrays = {kind: random.integers(0, 2, (3, 5, 7)).astype(kind)[:, ::2] for kind in TYPES}
    arrays |= {"empty": np.zeros((0, 3), np.float32), "scalar": np.array(np.nan, np.float32)}
    write_safetensors(tmp_path / "a.safetensors", arrays)
    found, _ = open_safetensors(tmp_path / "a.safetensors")
    assert found.keys() == arrays.keys()
    for name, array in arrays.items():
        assert (found[name].dtype, found[name].shape) == (array.dtype, array.shape)
        assert found[name].tobytes() == array.tobytes()
        assert found[name].flags.aligned


def test_an_array_that_the_format_cannot_hold_is_refused_and_no_file_is_left(tmp_path: Path) -> None:
    with pytest.raises(ShotError, match="cannot hold a, of type object"):
        write_safetensors(tmp_path / "a.safetensors", {"a": np.array([None])})
    assert not any(tmp_path.iterdir())
