"""Tests of examples/cpp_onnxruntime, compiled against ONNX Runtime's headers, which `make cpp` fetches."""

import os
import shutil
import sys
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from commands import assert_code_is_of, ran, refused
from noise import MASKED_DISPLAY, masked_shot, noise
from supersampler import Frame, Shot, Upscaler
from supersampler.methods.model_file import find_model

ROOT = Path(__file__).parents[2]
EXAMPLE = ROOT / "examples" / "cpp_onnxruntime"
FRAMES = int(os.environ.get("SUPERSAMPLER_CPP_FRAMES", "3"))
TOLERANCE = 1e-5  # mean difference of an image


def onnx_runtime() -> Path:
    """Return a folder with include/ and lib/ of ONNX Runtime, or skip the test."""
    for folder in (ROOT / ".onnxruntime", Path("/usr")):
        if any((folder / f"include{name}/onnxruntime_cxx_api.h").exists() for name in ("", "/onnxruntime")):
            return folder
    pytest.skip("there are no headers of ONNX Runtime here: `make cpp` fetches them")


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The example, compiled."""
    missing = [name for name in ("cmake", "c++") if shutil.which(name) is None]
    if missing:
        pytest.skip(f"{' and '.join(missing)} cannot be found")
    folder = tmp_path_factory.mktemp("build")
    options = [f"-DCMAKE_PREFIX_PATH={onnx_runtime()}", "-DCMAKE_BUILD_TYPE=Release", "-Werror=dev"]
    ran("cmake", "-S", EXAMPLE, "-B", folder, *options, CXXFLAGS="-Werror")
    ran("cmake", "--build", folder)
    return folder / "upscale"


def upscale(program: Path, model: str, folder: Path, *options: str) -> tuple[object, ...]:
    """Return the command that upscales folder/raw into folder/out."""
    return program, find_model(model) / "step.onnx", folder / "raw", folder / "out", *options


def image_of(folder: Path, name: str, size: tuple[int, int]) -> NDArray[np.float32]:
    planes = np.fromfile(folder / f"{name}.image", "<f4").reshape(3, size[1], size[0])
    return planes.transpose(1, 2, 0)


@pytest.fixture(scope="module")
def plaza_images() -> list[NDArray[np.float32]]:
    """The first images of the shipped shot, by Python's ONNX backend."""
    shot, upscaler = Shot.open("plaza"), Upscaler("classifier", display_size=(640, 360), executor="onnx")
    return [upscaler.step(shot.read(index).frame) for index in range(FRAMES)]


@pytest.mark.parametrize("option", [[], ["--fixed"]], ids=["free sizes", "fixed sizes"])
def test_the_programs_images_of_the_shipped_shot_are_those_of_upscaler(
    program: Path, plaza_images: list[NDArray[np.float32]], tmp_path: Path, option: list[str]
) -> None:
    ran(sys.executable, EXAMPLE / "raw_planes.py", "plaza", tmp_path / "raw", FRAMES)
    ran(*upscale(program, "classifier", tmp_path, *option))
    for index, expected in enumerate(plaza_images):
        image = image_of(tmp_path / "out", f"{index:04d}", (640, 360))
        assert np.abs(image - expected).mean() <= TOLERANCE, index


def test_pre_exposure_and_a_reactive_mask_give_the_images_of_upscaler(program: Path, tmp_path: Path) -> None:
    shot = masked_shot(tmp_path / "shot")
    ran(sys.executable, EXAMPLE / "raw_planes.py", shot.path, tmp_path / "raw")
    ran(*upscale(program, "classifier-large", tmp_path))
    upscaler = Upscaler("classifier-large", display_size=MASKED_DISPLAY, executor="onnx", validate="off")
    for item in shot:
        image = image_of(tmp_path / "out", f"{item.index:04d}", MASKED_DISPLAY)
        assert np.abs(image - upscaler.step(item.frame)).mean() <= TOLERANCE, item.index


def write_raw(folder: Path, frames: list[Frame], displays: list[tuple[int, int]]) -> None:
    folder.mkdir()
    lines = []
    for index, (frame, display) in enumerate(zip(frames, displays, strict=True)):
        assert frame.color is not None
        (folder / f"{index}.color").write_bytes(frame.color.transpose(2, 0, 1).astype("<f4").tobytes())
        (folder / f"{index}.depth").write_bytes(frame.depth.astype("<f4").tobytes())
        (folder / f"{index}.motion").write_bytes(frame.motion.transpose(2, 0, 1).astype("<f4").tobytes())
        values = (*frame.size, *display, *frame.jitter, frame.exposure or 0.0, 1.0, int(frame.reset), 0)
        lines.append(f"{index} {' '.join(map(repr, values))}\n")
    (folder / "frames.txt").write_text("".join(lines))


def test_a_new_render_size_keeps_the_history_and_a_new_display_size_drops_it(
    program: Path, tmp_path: Path
) -> None:
    renders = [(64, 36), (64, 36), (80, 45), (72, 40), (64, 36), (64, 36), (64, 36)]
    displays = [(128, 72)] * 5 + [(121, 67)] * 2
    frames = [noise(i, size, reset=i in (0, 4)) for i, size in enumerate(renders)]
    write_raw(tmp_path / "raw", frames, displays)
    ran(*upscale(program, "taau", tmp_path))
    for part in (slice(0, 5), slice(5, 7)):
        size = displays[part.start]
        upscaler = Upscaler("taau", display_size=size, executor="onnx", validate="off")
        for index, frame in list(enumerate(frames))[part]:
            expected = upscaler.step(frame)
            assert np.abs(image_of(tmp_path / "out", str(index), size) - expected).mean() <= TOLERANCE, index


@pytest.fixture
def one(tmp_path: Path) -> Path:
    """A folder with a frame in raw/."""
    write_raw(tmp_path / "raw", [noise(0, (64, 36))], [(128, 72)])
    return tmp_path


def test_the_program_reports_unsupported_input_in_one_line(program: Path, one: Path) -> None:
    assert "not supported in this build" in refused(*upscale(program, "taau", one, "--provider", "SNPE"))
    no_buffers = refused(*upscale(program, "gbuffer-small", one))
    assert no_buffers == "the frame has no gbuffer_base_color, which the graph takes\n"
    assert "has the size 'shaded_" in refused(*upscale(program, "guided-warp", one))
    (one / "raw/0.depth").write_bytes(b"short")
    assert refused(*upscale(program, "taau", one)) == "0.depth: has another size than frames.txt says\n"


@pytest.mark.parametrize(
    "line",
    [
        "../0 64 36 128 72 0 0 1 1 1 0",
        "/0 64 36 128 72 0 0 1 1 1 0",
        "0 0 36 128 72 0 0 1 1 1 0",
        "0 64 36 -1 72 0 0 1 1 1 0",
        "0 9223372036854775807 4 128 72 0 0 1 1 1 0",
        "0 64 36 128 99999 0 0 1 1 1 0",
        "0 64 36 128 72 0 0 1 1 1 2",
        "0 64 36 128 72 0 0 1 1",
        "0 64",
    ],
)
def test_a_tampered_list_of_frames_is_refused(program: Path, one: Path, line: str) -> None:
    for file in (one / "raw").glob("0.*"):
        shutil.copy(file, one / file.name)
    (one / "raw/frames.txt").write_text(f"{line}\n")
    assert refused(*upscale(program, "taau", one)) == f"frames.txt: cannot be read: {line}\n"
    assert not list(one.rglob("*.image"))


def test_the_library_leaves_the_home_alone(program: Path, one: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (one / "home").mkdir()
    monkeypatch.delenv("ORT_DISABLE_TELEMETRY", raising=False)
    ran(*upscale(program, "taau", one), HOME=str(one / "home"))
    assert not list((one / "home").rglob("*"))


def test_a_python_without_onnxruntime_is_named_before_headers_are_fetched(tmp_path: Path) -> None:
    bare = tmp_path / "python"
    bare.write_text(f'#!/bin/sh\nexec "{sys.executable}" -I -S "$@"\n')
    bare.chmod(0o755)
    said = refused("sh", EXAMPLE / "get_onnxruntime.sh", tmp_path / "made", bare)
    assert said.startswith(f"{bare} has no onnxruntime")
    assert not (tmp_path / "made").exists()


def test_the_code_on_the_page_is_that_of_the_example() -> None:
    files = (EXAMPLE / "upscaler.hpp", EXAMPLE / "upscale.cpp")
    assert_code_is_of(ROOT / "docs/how-to/onnx-in-cpp.md", "cpp", files, 5)
