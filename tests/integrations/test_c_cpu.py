"""The CPU library without Python: its interface in C, and examples/c_cpu with an installed library."""

import os
import re
import shutil
import subprocess
import sys
import textwrap
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from OpenImageIO import ImageBuf

from native_build import SOURCES, native_build
from noise import MASKED_DISPLAY, masked_shot
from supersampler import Shot, Upscaler
from supersampler.io.display import display_transform, to_uint8

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "examples" / "c_cpu"
FRAMES = 4


def run(*command: object, **variables: str) -> "subprocess.CompletedProcess[str]":
    done = subprocess.run(
        [str(part) for part in command],
        capture_output=True,
        text=True,
        timeout=280,
        env={**os.environ, **variables},
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done


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
    run("cmake", "--install", built, "--prefix", folder)
    return folder


@pytest.fixture(scope="module", params=["find_package", "pkg-config"])
def programs(request: pytest.FixtureRequest, prefix: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the programs, built against the installed library."""
    folder = tmp_path_factory.mktemp("programs")
    if request.param == "find_package":
        run("cmake", "-S", EXAMPLE, "-B", folder, f"-DCMAKE_PREFIX_PATH={prefix}", CFLAGS="-Werror")
        run("cmake", "--build", folder)
        return folder
    if shutil.which("pkg-config") is None:
        pytest.skip("pkg-config cannot be found")
    (place,) = prefix.rglob("pkgconfig")
    run("make", "-C", EXAMPLE, f"BUILD={folder}", PKG_CONFIG_PATH=str(place))
    return folder


def test_the_interface_in_c(built: Path) -> None:
    run("ctest", "--test-dir", built, "--output-on-failure")


@pytest.fixture(scope="module")
def raw(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The first frames of the shipped shot, as raw floats."""
    folder = tmp_path_factory.mktemp("raw")
    run(
        sys.executable,
        ROOT / "examples/cpp_onnxruntime/raw_planes.py",
        Shot.open("plaza").path,
        folder,
        FRAMES,
    )
    return folder


def pixels_of(path: Path) -> NDArray[np.uint8]:
    pixels: NDArray[np.uint8] = np.asarray(ImageBuf(str(path)).get_pixels("uint8"))
    return pixels


def test_images_of_the_shipped_shot_are_those_of_upscaler(programs: Path, raw: Path, tmp_path: Path) -> None:
    run(programs / "upscale", raw, tmp_path)
    shot, upscaler = Shot.open("plaza"), Upscaler("classifier", display_size=(640, 360), executor="cpu")
    for index in range(FRAMES):
        frame = shot.read(index).frame
        shown = to_uint8(display_transform(upscaler.step(frame), frame.exposure or 1.0))
        apart = np.abs(pixels_of(tmp_path / f"{index:04d}.png").astype(int) - shown.astype(int))
        assert apart.max() <= 1, index


def test_pre_exposure_and_a_reactive_mask_give_the_images_of_upscaler(programs: Path, tmp_path: Path) -> None:
    shot, out = masked_shot(tmp_path / "shot"), tmp_path / "out"
    out.mkdir()
    run(sys.executable, ROOT / "examples/cpp_onnxruntime/raw_planes.py", shot.path, tmp_path / "raw")
    run(programs / "upscale", tmp_path / "raw", out, "taau")
    upscaler = Upscaler("taau", display_size=MASKED_DISPLAY, executor="cpu", validate="off")
    for item in shot:
        exposure = (item.frame.exposure or 1.0) / item.frame.pre_exposure
        shown = to_uint8(display_transform(upscaler.step(item.frame), exposure))
        apart = np.abs(pixels_of(out / f"{item.index:04d}.png").astype(int) - shown.astype(int))
        assert apart.max() <= 1, item.index


def test_a_damaged_list_or_a_short_image_is_said_in_a_line(programs: Path, raw: Path, tmp_path: Path) -> None:
    shutil.copytree(raw, tmp_path / "raw")
    (tmp_path / "raw" / "0000.depth").write_bytes(b"short")
    command = [programs / "upscale", tmp_path / "raw", tmp_path]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    assert (done.returncode, done.stderr.count("\n")) == (1, 1)
    assert "0000.depth: it is missing, or has another size" in done.stderr
    damaged = ["../0000 320 180 640 360 0 0 1 1 1 0", "0000 320 180", "0000 -1 180 640 360 0 0 1 1 1 0"]
    for line in (*damaged, "0000 320 180 640 360 0 0 1 0 1 0", "0000 320 180 640 360 0 0 1 1"):
        (tmp_path / "raw" / "frames.txt").write_text(f"{line}\n")
        done = subprocess.run(command, capture_output=True, text=True, timeout=60)
        assert (done.returncode, done.stderr.count("\n")) == (1, 1)
        assert "a line cannot be read" in done.stderr


def turntable(programs: Path, folder: Path, *options: object) -> NDArray[np.uint8]:
    """Return the last image of 16 turned frames."""
    folder.mkdir()
    run(programs / "turntable", "-o", folder, "-n", 16, "-s", "320x180", *options)
    return pixels_of(folder / "0015.png")


def test_the_rasteriser_gains_by_its_motion_and_jitter(programs: Path, tmp_path: Path) -> None:
    reference = turntable(programs, tmp_path / "full", "-r", 1, "-m", "taau").astype(float)
    errors = {
        method: np.square(turntable(programs, tmp_path / method, "-m", method) - reference).mean()
        for method in ("classifier", "bilinear")
    }
    assert errors["classifier"] < 0.6 * errors["bilinear"]


def test_the_rasteriser_draws_in_a_terminal(programs: Path) -> None:
    done = run(programs / "turntable", "-n", 2, "-s", "40x20", "-c")
    assert done.stdout.count("▀") == 2 * 40 * 10
    assert done.stdout.endswith("\x1b[?25h\x1b[0m")


def test_a_model_that_does_not_ship_is_named(programs: Path) -> None:
    done = subprocess.run([programs / "turntable", "-m", "other"], capture_output=True, text=True, timeout=60)
    problem, names = done.stderr.split("; want one of ")
    assert (done.returncode, problem) == (1, "there is no model 'other' in this library")
    assert {"taau", "classifier"} < set(names.strip().split(", "))


def test_the_code_on_the_page_is_that_of_the_examples() -> None:
    page = (ROOT / "docs/how-to/supersampler-in-c.md").read_text("utf-8")
    sources = [
        path.read_text("utf-8") for path in (*EXAMPLE.iterdir(), SOURCES / "include" / "supersampler.h")
    ]
    lines = ["\n".join(line.strip() for line in source.splitlines()) for source in sources]
    snippets = re.findall("```(?:c|cpp|cmake)\n(.*?)```", page, re.DOTALL)
    assert len(snippets) >= 4
    for snippet in snippets:
        wanted = "\n".join(line.strip() for line in textwrap.dedent(snippet).strip().splitlines())
        assert any(wanted in source for source in lines), snippet
