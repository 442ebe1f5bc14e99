"""Exported shaders outside of Python, in Dawn and in C: `make webgpu` runs them."""

import json
import os
import sys
from pathlib import Path
from typing import Any

import pytest

from c_host import built_or_skip
from commands import ran
from raw_shots import AOVS, SIZES, read_images, wanted_images, write_raw
from supersampler import Shot
from supersampler_export.shaders.folder import write_shader_folder

ROOT = Path(__file__).parents[2]
EXAMPLES, TESTS = ROOT / "examples", ROOT / "tests"
MODULES = EXAMPLES / "node_dawn" / "node_modules"

if not MODULES.is_dir() or "SUPERSAMPLER_DAWN_ICD" not in os.environ:
    pytest.skip("`make webgpu` installs Dawn and names its Vulkan driver", allow_module_level=True)


@pytest.fixture(scope="module")
def frames(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("raw") / "frames"
    write_raw(folder)
    return folder


@pytest.fixture(scope="module")
def environment() -> dict[str, str]:
    """Return environment variables of programs that render with Dawn's driver."""
    driver = os.environ["SUPERSAMPLER_DAWN_ICD"]
    return {"PYTHONPATH": os.pathsep.join(sys.path), **({"VK_ICD_FILENAMES": driver} if driver else {})}


@pytest.mark.parametrize(
    ("method", "aovs"), [("taa", 0), ("taau", AOVS), ("classifier", 0), ("gbuffer-fast", AOVS)]
)
def test_dawn_computes_the_images_of_wgpu_on_the_same_adapter(
    method: str, aovs: int, frames: Path, environment: Any, tmp_path: Path
) -> None:
    write_shader_folder(method, tmp_path / "shaders", aovs=aovs)
    textures = -(-aovs // 4)
    script = EXAMPLES / "node_dawn" / "run.mjs"
    ran("node", script, tmp_path / "shaders", frames, tmp_path / "dawn", **environment)
    ran(sys.executable, TESTS / "raw_shots.py", method, tmp_path / "wgpu", textures, **environment)
    images = read_images(tmp_path / "dawn")
    assert len(images) == (1 + textures) * len(SIZES)
    assert images == read_images(tmp_path / "wgpu")


def test_the_module_keeps_its_promises(environment: Any, tmp_path: Path) -> None:
    write_shader_folder("taau", tmp_path / "shaders")
    script = TESTS / "integrations" / "webgpu_checks.mjs"
    found = json.loads(ran("node", script, tmp_path / "shaders", MODULES, **environment))
    assert len(found) >= 26
    assert {promise: answer for promise, answer in found.items() if answer is not True} == {}


def test_the_host_in_c_upscales_the_shipped_shot_to_the_images_of_the_gpu_backend(tmp_path: Path) -> None:
    program = built_or_skip(tmp_path)
    write_shader_folder("classifier", tmp_path / "shaders")
    ran(sys.executable, EXAMPLES / "raw_frames.py", "plaza", tmp_path / "raw")
    (tmp_path / "out").mkdir()
    ran(program, tmp_path / "shaders", tmp_path / "raw", tmp_path / "out")
    shot = [item.frame for item in Shot.open("plaza")]
    assert read_images(tmp_path / "out") == wanted_images("classifier", shot, (640, 360))
