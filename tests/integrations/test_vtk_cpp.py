"""Tests of examples/vtk_cpp with Debian's libvtk9-dev and Xvfb: `make vtk-cpp` runs them."""

import re
import shutil
from pathlib import Path

import numpy as np
import pytest
from OpenImageIO import ImageBuf

from commands import finished, ran
from native_build import native_build

EXAMPLE = Path(__file__).parents[2] / "examples" / "vtk_cpp"


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
    ran("cmake", "--install", build.FOLDER, "--prefix", prefix)
    configured = finished("cmake", "-S", EXAMPLE, "-B", folder, f"-DCMAKE_PREFIX_PATH={prefix}")
    if "FindVTK" in configured.stderr or "VTKConfig" in configured.stderr:
        pytest.skip("VTK cannot be found: Debian's libvtk9-dev has it")
    assert configured.returncode == 0, configured.stderr
    ran("cmake", "--build", folder)
    return ["xvfb-run", "-a", folder / "viewer"]


def test_a_turning_model_is_close_to_its_reference(viewer: list[object], tmp_path: Path) -> None:
    output = ran(*viewer, "-o", tmp_path, "-n", 17, "-s", "640x360")
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


def test_a_model_that_does_not_ship_is_named(viewer: list[object]) -> None:
    done = finished(*viewer, "-m", "other")
    assert done.returncode == 1
    assert "there is no model 'other' in this library" in done.stderr
