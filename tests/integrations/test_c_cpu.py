"""The CPU library without Python: its interface in C, and examples/c_cpu with an installed library."""

import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
from OpenImageIO import ImageBuf

from commands import assert_code_is_of, finished, ran, refused
from native_build import SOURCES, native_build
from noise import MASKED_DISPLAY, masked_shot
from supersampler import Shot, Upscaler
from supersampler.frame import Float32
from supersampler.io.display import display_transform, to_uint8

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "examples" / "c_cpu"
RAW_PLANES = ROOT / "examples" / "cpp_onnxruntime" / "raw_planes.py"
FRAMES = 4


@pytest.fixture(scope="module")
def built() -> Path:
    """The folder of a build with the tests in C."""
    build = native_build()
    options = build.machine_compiler()
    if options is None or not build.has_cmake():
        pytest.skip("CMake, or GCC 12 or clang 14, cannot be found")
    build.compile_library(build.FOLDER, [*options, "-DSS_TESTS=ON"])
    folder = build.FOLDER
    assert isinstance(folder, Path)
    return folder


@pytest.fixture(scope="module")
def prefix(built: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Where `cmake --install` has put the library."""
    folder = tmp_path_factory.mktemp("prefix")
    ran("cmake", "--install", built, "--prefix", folder)
    return folder


@pytest.fixture(scope="module", params=["find_package", "pkg-config"])
def programs(request: pytest.FixtureRequest, prefix: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the programs, built against the installed library."""
    folder = tmp_path_factory.mktemp("programs") / "build"
    if request.param == "find_package":
        ran("cmake", "-S", EXAMPLE, "-B", folder, f"-DCMAKE_PREFIX_PATH={prefix}", CFLAGS="-Werror")
        ran("cmake", "--build", folder)
        return folder
    if shutil.which("pkg-config") is None:
        pytest.skip("pkg-config cannot be found")
    (place,) = prefix.rglob("pkgconfig")
    ran("make", "-C", EXAMPLE, f"BUILD={folder}", PKG_CONFIG_PATH=str(place))
    return folder


def test_the_interface_in_c(built: Path) -> None:
    ran("ctest", "--test-dir", built, "--output-on-failure")


@pytest.fixture(scope="module")
def raw(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The first frames of the shipped shot, as raw floats."""
    folder = tmp_path_factory.mktemp("raw")
    ran(sys.executable, RAW_PLANES, "plaza", folder, FRAMES)
    return folder


def assert_shown(path: Path, image: Float32, exposure: float | None) -> None:
    """A PNG must show the image to a step of 8 bits."""
    pixels = np.asarray(ImageBuf(str(path)).get_pixels("uint8")).astype(int)
    wanted = to_uint8(display_transform(image, exposure or 1.0)).astype(int)
    assert np.abs(pixels - wanted).max() <= 1, path.name


def test_images_of_the_shipped_shot_are_those_of_upscaler(programs: Path, raw: Path, tmp_path: Path) -> None:
    ran(programs / "upscale", raw, tmp_path)
    shot, upscaler = Shot.open("plaza"), Upscaler("classifier", display_size=(640, 360), executor="cpu")
    for index in range(FRAMES):
        frame = shot.read(index).frame
        assert_shown(tmp_path / f"{index:04d}.png", upscaler.step(frame), frame.exposure)


def test_pre_exposure_and_a_reactive_mask_give_the_images_of_upscaler(programs: Path, tmp_path: Path) -> None:
    shot, out = masked_shot(tmp_path / "shot"), tmp_path / "out"
    out.mkdir()
    ran(sys.executable, RAW_PLANES, shot.path, tmp_path / "raw")
    ran(programs / "upscale", tmp_path / "raw", out, "taau")
    upscaler = Upscaler("taau", display_size=MASKED_DISPLAY, executor="cpu", validate="off")
    for item in shot:
        exposure = (item.frame.exposure or 1.0) / item.frame.pre_exposure
        assert_shown(out / f"{item.index:04d}.png", upscaler.step(item.frame), exposure)


def test_a_damaged_list_or_a_short_image_is_said_in_a_line(programs: Path, raw: Path, tmp_path: Path) -> None:
    shutil.copytree(raw, tmp_path / "raw")
    (tmp_path / "raw" / "0000.depth").write_bytes(b"short")
    command = programs / "upscale", tmp_path / "raw", tmp_path
    assert "0000.depth: it is missing, or has another size" in refused(*command)
    damaged = ["../0000 320 180 640 360 0 0 1 1 1 0", "0000 320 180", "0000 -1 180 640 360 0 0 1 1 1 0"]
    for line in (*damaged, "0000 320 180 640 360 0 0 1 0 1 0", "0000 320 180 640 360 0 0 1 1"):
        (tmp_path / "raw" / "frames.txt").write_text(f"{line}\n")
        assert "a line cannot be read" in refused(*command)


def turntable(programs: Path, folder: Path, *options: object) -> Float32:
    """Return the last image of 16 turned frames."""
    folder.mkdir()
    ran(programs / "turntable", "-o", folder, "-n", 16, "-s", "320x180", *options)
    return np.asarray(ImageBuf(str(folder / "0015.png")).get_pixels("float"))


def test_the_rasteriser_gains_by_its_motion_and_jitter(programs: Path, tmp_path: Path) -> None:
    reference = turntable(programs, tmp_path / "full", "-r", 1, "-m", "taau")
    errors = {
        method: np.square(turntable(programs, tmp_path / method, "-m", method) - reference).mean()
        for method in ("classifier", "bilinear")
    }
    assert errors["classifier"] < 0.6 * errors["bilinear"]


def test_the_rasteriser_draws_in_a_terminal(programs: Path) -> None:
    drawn = ran(programs / "turntable", "-n", 2, "-s", "40x20", "-c")
    assert drawn.count("▀") == 2 * 40 * 10
    assert drawn.endswith("\x1b[?25h\x1b[0m")


def test_a_model_that_does_not_ship_is_named(programs: Path) -> None:
    done = finished(programs / "turntable", "-m", "other")
    problem, names = done.stderr.split("; want one of ")
    assert (done.returncode, problem) == (1, "there is no model 'other' in this library")
    assert {"taau", "classifier"} < set(names.strip().split(", "))


PLUGIN = """
#include "supersampler.h"

int ss_version(void) { return SS_VERSION; } /* in the place of the static library */

__attribute__((visibility("default"))) int plugin(void) { return ss_version(); }
"""


def test_plugins_do_not_export_a_static_library(tmp_path: Path) -> None:
    if any(shutil.which(program) is None for program in ("cmake", "cc", "pkg-config", "nm")):
        pytest.skip("CMake, a C compiler, pkg-config or nm cannot be found")
    ran("cmake", "-S", SOURCES, "-B", tmp_path, "-DBUILD_SHARED_LIBS=OFF", "-DSS_TESTS=OFF")
    found = ran("pkg-config", "--cflags", "--libs", tmp_path / "supersampler.pc").split()
    assert {"-DSS_STATIC", "-lm", "-pthread"} <= set(found)
    (tmp_path / "plugin.c").write_text(PLUGIN)
    flags = "-shared", "-fPIC", "-fvisibility=hidden", "-DSS_STATIC", f"-I{SOURCES / 'include'}"
    ran("cc", *flags, tmp_path / "plugin.c", "-o", tmp_path / "plugin.so")
    exported = ran("nm", "-D", "--defined-only", tmp_path / "plugin.so").split()
    assert [name for name in exported if name.startswith("ss_")] == []
    assert "plugin" in exported


def test_the_code_on_the_page_is_that_of_the_examples() -> None:
    files = (*EXAMPLE.iterdir(), SOURCES / "include" / "supersampler.h")
    assert_code_is_of(ROOT / "docs/how-to/supersampler-in-c.md", "c|cpp|cmake", files, 4)
