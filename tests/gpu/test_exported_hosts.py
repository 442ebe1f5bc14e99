"""Hosts without this package compute its images from an exported folder."""

import subprocess
from pathlib import Path
from typing import NamedTuple

import pytest

from c_host import built_or_skip
from gpu_steps import device_or_skip
from raw_shots import AOVS, SIZES, read_images, wanted_images, write_raw
from supersampler_export.shaders.folder import write_shader_folder


class Exported(NamedTuple):
    """Shaders of a method that blend this many channels of AOVs, and frames, in a folder."""

    method: str
    aovs: int
    root: Path


@pytest.fixture(
    scope="module",
    params=[
        ("taa", AOVS),
        ("taau", AOVS),
        ("classifier", 0),
        ("classifier-large", 0),
        ("gbuffer-fast", AOVS),
    ],
)
def exported(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Exported:
    """A folder with the shaders of a method and the frames of a shot."""
    device_or_skip()
    (method, aovs), root = request.param, tmp_path_factory.mktemp("exported")
    write_shader_folder(method, root / "shaders", aovs=aovs)
    write_raw(root / "frames")
    return Exported(method, aovs, root)


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    device_or_skip()
    return built_or_skip(tmp_path_factory.mktemp("c"))


def run(command: list[str], root: Path, name: str) -> dict[str, bytes]:
    out = root / name
    out.mkdir()
    empty = root / f"{name} starts here"
    empty.mkdir()
    arguments = [str(root / "shaders"), str(root / "frames"), str(out)]
    done = subprocess.run([*command, *arguments], cwd=empty, capture_output=True, text=True, timeout=280)
    assert done.returncode == 0, done.stderr
    return read_images(out)


def test_a_host_in_c_computes_the_images_of_the_gpu_backend(exported: Exported, program: Path) -> None:
    images, textures = run([str(program)], exported.root, "c"), -(-exported.aovs // 4)
    assert len(images) == (1 + textures) * len(SIZES)
    assert images == wanted_images(exported.method, aovs=textures)


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("upscaler.json", None, "cannot be opened"),
        ("upscaler.json", "{", "is no JSON"),
        ("upscaler.json", '{"format": "other"}', "want supersampler-shaders version 3"),
        ("02_blend.wgsl", "fn main( {", "expected"),
    ],
)
def test_the_host_in_c_reports_errors_in_one_line(
    program: Path, tmp_path: Path, name: str, text: str | None, message: str
) -> None:
    shaders = tmp_path / "shaders"
    write_shader_folder("taa", shaders)
    write_raw(tmp_path / "frames")
    (shaders / name).unlink()
    if text is not None:
        (shaders / name).write_text(text)
    arguments = [str(shaders), str(tmp_path / "frames"), str(tmp_path)]
    done = subprocess.run([str(program), *arguments], capture_output=True, text=True, timeout=280)
    assert done.returncode == 1
    assert message in done.stderr
