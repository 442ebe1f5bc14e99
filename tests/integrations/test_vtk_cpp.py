"""Tests of examples/vtk_cpp with Debian's libvtk9-dev and Xvfb: `make vtk-cpp` runs them."""

import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from OpenImageIO import ImageBuf

from native_build import native_build

EXAMPLE = Path(__file__).parents[2] / "examples" / "vtk_cpp"


def run(*command: object) -> str:
    done = subprocess.run(
        [str(part) for part in command], capture_output=True, text=True, timeout=900, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def viewer(tmp_path_factory: pytest.TempPathFactory) -> list[object]:
    """The command of the viewer, built against the installed library."""
    build = native_build()
    options = build.machine_compiler()
    if options is None or not build.has_cmake():
        pytest.skip("CMake, or GCC 12 or clang 14, cannot be found")
    if shutil.which("xvfb-run") is None:
        pytest.skip("xvfb-run cannot be found: Debian's xvfb and xauth have it")
    build.compile_library(build.FOLDER, options)
    prefix, folder = tmp_path_factory.mktemp("prefix"), tmp_path_factory.mktemp("vtk_cpp")
    run("cmake", "--install", build.FOLDER, "--prefix", prefix)
    configured = subprocess.run(
        [shutil.which("cmake") or "cmake", "-S", EXAMPLE, "-B", folder, f"-DCMAKE_PREFIX_PATH={prefix}"],
        capture_output=True,
        text=True,
        check=False,
    )
    if "FindVTK" in configured.stderr or "VTKConfig" in configured.stderr:
        pytest.skip("VTK cannot be found: Debian's libvtk9-dev has it")
    assert configured.returncode == 0, configured.stderr
    run("cmake", "--build", folder)
    return ["xvfb-run", "-a", folder / "viewer"]


def test_a_turning_model_is_close_to_its_reference(viewer: list[object], tmp_path: Path) -> None:
    output = run(*viewer, "-o", tmp_path, "-n", 17, "-s", "640x360")
    print(output)
    decibels = dict(re.findall(r"PSNR (\w+): ([\d.]+) dB", output))
    assert float(decibels["upscaled"]) > 33.0  # 34.5 as it is
    assert float(decibels["MSAA"]) > 33.0, "else the reference is another view"
    assert len(re.findall(r": [\d.]+ ms", output)) == 6
    images = sorted(tmp_path.glob("*.png"))
    assert len(images) == 17
    pixels = np.asarray(ImageBuf(str(images[-1])).get_pixels("uint8")).astype(float)
    left, right = pixels[:, :640], pixels[:, 640:]
    assert np.abs(left - right).mean() < 6.0, "both show the same view"
    assert left.std() > 15.0, "something is seen"


@pytest.mark.parametrize(
    ("option", "message"),
    [(("-m", "other"), "there is no model 'other' in this library"), (("-n", "many"), "viewer: -n many: ")],
)
def test_options_that_it_does_not_know_are_named(
    viewer: list[object], option: tuple[str, str], message: str
) -> None:
    command = [str(part) for part in (*viewer, *option)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, message in done.stderr) == (1, True), done.stderr
