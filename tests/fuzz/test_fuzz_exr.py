"""Fuzz tests of the EXR reader: random valid and damaged files are read or refused with ShotError."""

import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from OpenImageIO import ImageSpec

from exr_parts import write_parts
from fuzzing import damaged, examples, run_apart, with_other_numbers
from supersampler import ShotError, SupersamplerError
from supersampler.io.images import read_exr, read_header, write_exr
from supersampler.io.shot.format import read_classes

COMPRESSIONS = ("zip", "zips", "piz", "rle", "none", "dwaa:45", "dwab:45", "pxr24", "b44", "b44a")


def whole_files() -> list[bytes]:
    """One of each compression, one in tiles, one in parts."""
    noise = np.random.default_rng(0)
    channels = ("R", "G", "B", "depth.Z", "motion.X", "class.ghost", "class.alias")
    image = {
        name: noise.random((12, 16)).astype(np.float16 if index % 2 else np.float32)
        for index, name in enumerate(channels)
    }
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "a.exr"
        found = []
        for compression in COMPRESSIONS:
            write_exr(path, image, compression=compression)
            found.append(path.read_bytes())
        tiles = ImageSpec(40, 30, 4, "half")
        tiles.tile_width = tiles.tile_height = 16
        write_parts(path, with_noise(tiles))
        found.append(path.read_bytes())
        parts = [ImageSpec(16, 12, 3, "half"), ImageSpec(16, 12, 1, "float")]
        for name, part in zip("ab", parts, strict=True):
            part.attribute("oiio:subimagename", name)
        write_parts(path, *map(with_noise, parts))
        return [*found, path.read_bytes()]


def with_noise(spec: ImageSpec) -> tuple[ImageSpec, np.ndarray]:
    return spec, np.random.default_rng(0).random((spec.height, spec.width, spec.nchannels), np.float32)


def prepare() -> Callable[[int], object]:
    files = whole_files()

    def run(case: int) -> None:
        rng = np.random.default_rng(case)
        data = files[case % len(files)]
        data = with_other_numbers(data, rng, 700) if rng.random() < 0.4 else damaged(data, rng)
        path = Path("case.exr")
        path.write_bytes(data)
        for read in (read_header, read_exr, lambda path: read_classes(path, None)):
            try:
                read(path)
            except SupersamplerError:
                continue

    return run


def test_no_exr_harms_its_reader() -> None:
    assert run_apart(prepare, examples(150)) == []


def set_window(data: bytes, width: int, height: int) -> bytes:
    """Have both windows of a whole file say another size."""
    content = bytearray(data)
    for name in (b"dataWindow\0box2i\0", b"displayWindow\0box2i\0"):
        at = content.index(name) + len(name) + 4 + 8
        content[at : at + 8] = (width - 1).to_bytes(4, "little") + (height - 1).to_bytes(4, "little")
    return bytes(content)


@pytest.mark.parametrize("size", [(1 << 16, 4), (4, 1 << 16), (1 << 14, 1 << 14), (1 << 30, 1 << 30)])
def test_a_size_beyond_the_limits_is_refused_before_allocation(tmp_path: Path, size: tuple[int, int]) -> None:
    (tmp_path / "a.exr").write_bytes(set_window(whole_files()[0], *size))
    with pytest.raises(ShotError, match=r"want 1 to 32768 a side|claims|INVALID"):
        read_exr(tmp_path / "a.exr")


@pytest.mark.parametrize("parts", [1, 2])
def test_header_entries_without_end_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, parts: int
) -> None:
    """OpenEXR takes minutes to read two megabytes of header entries."""
    specs = [ImageSpec(8, 6, 3, "half") for _ in range(parts)]
    for name, spec in zip("ab", specs, strict=False):
        spec.attribute("oiio:subimagename", name)
    for number in range(40):  # of the last part
        specs[-1].attribute(f"entry{number}", "x" * 600)
    write_parts(tmp_path / "a.exr", *map(with_noise, specs))
    monkeypatch.setattr("supersampler.io.files.IMAGE_ATTRIBUTES", 100)
    assert len(read_exr(tmp_path / "a.exr")) == 3 * parts
    monkeypatch.setattr("supersampler.io.files.IMAGE_ATTRIBUTES", 40)
    with pytest.raises(
        ShotError, match=r"has 41 header entries or more in a part, .* want at most 40 and 640"
    ):
        read_exr(tmp_path / "a.exr")


def test_other_formats_do_not_reach_their_decoders_under_the_name_of_an_exr(tmp_path: Path) -> None:
    spec = ImageSpec(4, 3, 3, "uint8")
    write_parts(tmp_path / "a.tif", with_noise(spec))
    (tmp_path / "a.tif").rename(tmp_path / "a.exr")
    with pytest.raises(ShotError, match="is not an EXR image"):
        read_exr(tmp_path / "a.exr")
