"""Exported shaders outside of Python: Dawn in Node, Vulkan, DXC: `make webgpu` runs them."""

import json
import os
import re
import shutil
import subprocess
import sys
from itertools import islice
from pathlib import Path
from typing import Any

import pytest

from c_host import built_or_skip
from dxc import compile_hlsl
from method_lists import WITH_SHADERS
from raw_shots import SIZES, read_images, wanted_images, write_raw
from supersampler import Shot
from supersampler_export.shaders.folder import write_shader_folder
from supersampler_export.shaders.translation import Target

ROOT = Path(__file__).parents[2]
EXAMPLES, TESTS = ROOT / "examples", ROOT / "tests"
MODULES = EXAMPLES / "node_dawn" / "node_modules"
VULKAN = ROOT / ".venv-vulkan" / "bin" / "python"
DXC = ROOT / "out" / "dxc" / "libdxcompiler_x86_64.so.3.7"
METHODS = [name for name in WITH_SHADERS if name != "classifier-large"]

if not MODULES.is_dir():
    pytest.skip(
        "examples/node_dawn has no node_modules: `make webgpu` installs them", allow_module_level=True
    )


@pytest.fixture(scope="module")
def frames(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("raw") / "frames"
    write_raw(folder)
    return folder


@pytest.fixture(scope="module")
def environment() -> dict[str, str]:
    """That of programs which use Dawn's adapter: SUPERSAMPLER_DAWN_ICD names its driver."""
    driver = os.environ.get("SUPERSAMPLER_DAWN_ICD", "")
    found = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    return {**found, "VK_ICD_FILENAMES": driver} if driver else found


def run(command: list[Any], environment: dict[str, str] | None = None) -> str:
    texts = [str(part) for part in command]
    done = subprocess.run(texts, capture_output=True, text=True, timeout=600, env=environment)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.mark.parametrize("method", ["taa", "taau", "classifier"])
def test_dawn_computes_the_images_of_wgpu_on_the_same_adapter(
    method: str, frames: Path, environment: dict[str, str], tmp_path: Path
) -> None:
    write_shader_folder(method, tmp_path / "shaders")
    script = EXAMPLES / "node_dawn" / "run.mjs"
    run(["node", script, tmp_path / "shaders", frames, tmp_path / "dawn"], environment)
    run([sys.executable, TESTS / "raw_shots.py", method, tmp_path / "wgpu"], environment)
    images = read_images(tmp_path / "dawn")
    assert len(images) == len(SIZES)
    assert images == read_images(tmp_path / "wgpu")


def test_the_module_keeps_its_promises(environment: dict[str, str], tmp_path: Path) -> None:
    write_shader_folder("taau", tmp_path / "shaders")
    script = TESTS / "integrations" / "webgpu_checks.mjs"
    found = json.loads(run(["node", script, tmp_path / "shaders", MODULES], environment))
    assert len(found) >= 23
    assert {promise: answer for promise, answer in found.items() if answer is not True} == {}


def test_the_host_in_c_upscales_the_shipped_shot_to_the_images_of_the_gpu_backend(tmp_path: Path) -> None:
    program = built_or_skip(tmp_path)
    write_shader_folder("classifier", tmp_path / "shaders")
    script = EXAMPLES / "raw_frames.py"
    run([sys.executable, script, "plaza", tmp_path / "raw", "--frames", 32])
    (tmp_path / "out").mkdir()
    run([program, tmp_path / "shaders", tmp_path / "raw", tmp_path / "out"])
    shot = [item.frame for item in islice(Shot.open("plaza"), 32)]
    assert read_images(tmp_path / "out") == wanted_images("classifier", shot, (640, 360))


def exported(method: str, target: Target, folder: Path) -> tuple[dict[str, Any], list[Path]]:
    write_shader_folder(method, folder, target=target)
    about = json.loads((folder / "upscaler.json").read_text())
    return about, [folder / one["file"] for one in about["passes"]]


@pytest.mark.skipif(shutil.which("spirv-val") is None, reason="spirv-val is not installed here")
@pytest.mark.parametrize("method", METHODS)
def test_spirv_is_valid(method: str, tmp_path: Path) -> None:
    about, shaders = exported(method, "spirv", tmp_path)
    for file in shaders:
        run(["spirv-val", "--target-env", "vulkan1.1", file])
    assert "Shader" in about["requires"]["spirv_capabilities"]
    assert not [name for name in about["requires"]["spirv_capabilities"] if name.isdigit()]


@pytest.mark.skipif(not VULKAN.is_file(), reason="the package vulkan is not installed here")
@pytest.mark.parametrize("method", METHODS)
def test_spirv_computes_the_images_of_the_gpu_backend_on_vulkan(
    method: str, frames: Path, tmp_path: Path
) -> None:
    exported(method, "spirv", tmp_path / "shaders")
    script = EXAMPLES / "bare_vulkan.py"
    assert "import supersampler" not in script.read_text().replace("not import supersampler", "")
    run([VULKAN, "-I", script, tmp_path / "shaders", frames, tmp_path / "out"])
    assert read_images(tmp_path / "out") == wanted_images(method)


@pytest.mark.skipif(not DXC.is_file(), reason="DXC is not here")
@pytest.mark.parametrize("method", METHODS)
def test_hlsl_compiles(method: str, tmp_path: Path) -> None:
    about, shaders = exported(method, "hlsl", tmp_path)
    profile = "cs_" + about["requires"]["shader_model"].replace(".", "_")
    for one, file in zip(about["passes"], shaders, strict=True):
        compiled, messages = compile_hlsl(DXC, file.read_bytes(), one["entry_point"], profile)
        assert compiled[:4] == b"DXBC", messages
        registers = {(b["register"], b["space"]) for b in one["bindings"]}
        assert len(registers) == len(one["bindings"])


@pytest.mark.skipif(not DXC.is_file(), reason="DXC is not here")
def test_hlsl_that_does_not_compile_is_found() -> None:
    compiled, messages = compile_hlsl(DXC, b"void main( {", "main", "cs_6_4")
    assert compiled == b""
    assert "error: expected" in messages


@pytest.mark.parametrize("method", METHODS)
def test_every_argument_of_a_metal_kernel_has_a_place_of_its_own(method: str, tmp_path: Path) -> None:
    about, shaders = exported(method, "msl", tmp_path)
    for one, file in zip(about["passes"], shaders, strict=True):
        code = file.read_text()
        assert "fake" not in code
        placed = re.findall(r"\[\[(buffer|texture)\((\d+)\)\]\]", code)
        given = [(kind, str(b[kind])) for b in one["bindings"] for kind in ("buffer", "texture") if kind in b]
        given += [("buffer", str(one["buffer_sizes"]["buffer"]))] if "buffer_sizes" in one else []
        assert sorted(placed) == sorted(given)
        assert len(set(placed)) == len(placed)
        assert f"kernel void {one['entry_point']}(" in code
