"""The CPU library, compiled by Zig for other platforms, in QEMU and Wine: `make emulators`."""

import importlib.util
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest
from OpenImageIO import ImageBuf

from commands import ran
from native_build import SOURCES, native_build
from supersampler import Shot, Upscaler
from supersampler.io.display import display_transform, to_uint8

ROOT = Path(__file__).parents[2]
FRAMES = 2
ARM_LIBRARIES = Path("/usr/aarch64-linux-gnu")

pytestmark = pytest.mark.timeout(1800)  # QEMU is some twenty times slower than the machine


class Platform(NamedTuple):
    """A build for another platform, and the command that runs its programs."""

    target: str
    folder: Path
    emulator: list[str]

    def run(self, program: Path, *arguments: object, **variables: str) -> None:
        command = [*self.emulator, str(program), *map(str, arguments)]
        wine = {"WINEDEBUG": "-all", "WINEPREFIX": str(self.folder / "wine")}
        said = self.folder / "said.txt"  # a pipe would wait for Wine's server
        with said.open("w") as file:
            done = subprocess.run(
                command, stdout=file, stderr=file, timeout=1700, env=os.environ | wine | variables
            )
        assert done.returncode == 0, said.read_text()


def qemu(*options: str) -> list[str]:
    """Return the command that runs arm64 programs, or skip the test."""
    program = shutil.which("qemu-aarch64-static") or shutil.which("qemu-aarch64")
    if program is None or not ARM_LIBRARIES.exists():
        pytest.skip("QEMU or arm64's C library is missing: Debian's qemu-user-static and libc6-arm64-cross")
    return [program, "-L", str(ARM_LIBRARIES), *options]


def wine() -> list[str]:
    """Return the command that runs Windows programs, or skip the test."""
    found = [path for path in ("/usr/lib/wine/wine64", shutil.which("wine64"), shutil.which("wine")) if path]
    program = next((path for path in found if Path(path).exists()), None)
    if program is None:
        pytest.skip("Wine is missing: Debian's wine64")
    return [program]


@pytest.fixture(scope="module", params=["manylinux-aarch64", "windows-x86_64"])
def platform(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Platform:
    """The library and its tests in C, compiled for a platform."""
    build = native_build()
    if importlib.util.find_spec("ziglang") is None or not build.has_cmake():
        pytest.skip("ziglang or CMake is missing: `make emulators` installs the former")
    emulator = wine() if "windows" in request.param else qemu()
    folder = tmp_path_factory.mktemp(request.param)
    build.compile_library(folder, [*build.zig_compiler(build.TARGETS[request.param]), "-DSS_TESTS=ON"])
    return Platform(build.TARGETS[request.param].zig, folder, emulator)


def test_the_interface_in_c(platform: Platform) -> None:
    suffix = ".exe" if "windows" in platform.target else ""
    platform.run(platform.folder / f"test_api{suffix}", SS_HOSTILE="4")


def test_images_are_those_of_this_machine(platform: Platform, tmp_path: Path) -> None:
    shot = Shot.open("plaza")
    raw, out, program = tmp_path / "raw", tmp_path / "out", platform.folder / "upscale.exe"
    out.mkdir()
    ran(sys.executable, ROOT / "examples/cpp_onnxruntime/raw_planes.py", "plaza", raw, FRAMES)
    compiler = [sys.executable, "-m", "ziglang", "cc", "-target", platform.target, "-O2", "-std=c99"]
    sources = [ROOT / "examples/c_cpu/upscale.c", f"-I{SOURCES / 'include'}", f"-L{platform.folder}"]
    ran(*compiler, *sources, "-lsupersampler", "-lm", "-o", program)
    for method in ("taau", "classifier"):
        platform.run(program, raw, out, method, QEMU_SET_ENV=f"LD_LIBRARY_PATH={platform.folder}")
        upscaler = Upscaler(method, display_size=(640, 360), executor="cpu")
        for index in range(FRAMES):
            frame = shot.read(index).frame
            shown = to_uint8(display_transform(upscaler.step(frame), frame.exposure or 1.0)).astype(int)
            image = np.asarray(ImageBuf(str(out / f"{index:04d}.png")).get_pixels("uint8")).astype(int)
            assert np.abs(image - shown).mean() < 0.1, (method, index)


def test_a_cpu_without_dot_products_runs_portable_instructions(platform: Platform) -> None:
    if "aarch64" not in platform.target:
        pytest.skip("of arm64")
    older = platform._replace(emulator=qemu("-cpu", "cortex-a72"))  # others would end with a signal
    older.run(platform.folder / "test_api", SS_HOSTILE="4")
