"""The CPU library in C++: the images of the graphs, the same bits however it is run, and no C++ runtime."""

import shutil
import subprocess
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from cpu_models import bytes_of, cpu_executor
from native_build import SOURCES, module_of, native_build, native_generated
from noise import noise
from rest_scenes import RestScene, wave
from supersampler import Frame, Model, ModelError
from supersampler.backends.base import StepRequest
from supersampler.backends.cpu.executor import CpuModel
from supersampler.backends.cpu.library import Options, cpu_library
from supersampler.backends.cpu.model_bytes import arrays_bytes
from supersampler.frame import Float32, Size

METHODS = "bilinear", "bicubic", "taa", "taau", "classifier", "classifier-small", "classifier-large"
SIZES = [((37, 22), (81, 47)), ((17, 13), (17, 13)), ((64, 36), (128, 72)), ((1, 1), (1, 1))]


class Bound(NamedTuple):
    """Largest difference of toned images in the mean, in 99.9 % of the values, and in all."""

    mean: float
    most: float
    largest: float


EXACT = Bound(2e-5, 8e-4, 8e-3)
INT8 = Bound(2e-3, 3e-2, 8e-2)
"""Bounds for int8 networks, where rounding one input differently moves some outputs by several steps."""


@pytest.fixture(scope="session")
def path() -> Path:
    built = native_build().build()
    assert isinstance(built, Path)
    return built


def frames(render: Size, count: int) -> Iterator[Frame]:
    """Noise, some of it missing, out of range or without an end, and a reactive mask."""
    for index in range(count):
        frame = noise(index, render)
        color, depth, motion = (np.array(a) for a in (frame.color, frame.depth, frame.motion))
        if index == 1 and render[1] > 9:
            color[2:5], color[6], color[7], color[8], color[1, 1] = np.nan, np.inf, -1.0, 1e6, np.nan
            depth[3], depth[4], depth[5] = np.nan, -1.0, np.inf
            motion[0], motion[1] = np.nan, np.inf
        mask = np.linspace(0.0, 1.0, depth.size, dtype=np.float32).reshape(depth.shape)
        yield replace(frame, color=color, depth=depth, motion=motion, reactive=mask if index == 3 else None)


class Run:
    def __init__(self, executor: Any, render: Size, display: Size) -> None:
        self.executor, self.display = executor, display
        self.history, self.spare = executor.zeros(display, render), executor.zeros(display, render)

    def step(self, frame: Frame, *, adds: float = 0.0, skip: bool = True) -> Float32:
        image = np.zeros((*self.display[::-1], 3), np.float32)
        buffers = self.history, self.spare
        self.executor.step_many([StepRequest(frame, self.display, *buffers, image, (), adds, skip)])
        self.history, self.spare = self.spare, self.history
        return image


def toned(image: Float32) -> Float32:
    made: Float32 = image / (1.0 + image.max(axis=2, keepdims=True))
    return made


def check(image: Float32, want: Float32, bound: Bound) -> None:
    apart = np.abs(toned(image) - toned(want))
    found = Bound(float(apart.mean()), float(np.quantile(apart, 0.999)), float(apart.max()))
    assert all(a <= b for a, b in zip(found, bound, strict=True)), found


def test_constants_are_those_of_the_specs() -> None:
    text = (SOURCES / "src" / "constants.h").read_text()
    assert text == native_generated().constants_header()


def test_models_in_the_library_are_those_that_ship() -> None:
    files = {path.name: path.read_bytes() for path in (SOURCES / "models").iterdir()}
    assert files == native_generated().model_files()


def test_no_runtime_of_cpp_is_needed(path: Path) -> None:
    readelf, nm = shutil.which("readelf"), shutil.which("nm")
    if readelf is None or nm is None:
        pytest.skip("binutils are missing")
    needed = subprocess.run([readelf, "-d", path], check=True, capture_output=True, text=True).stdout
    names = subprocess.run([nm, "-D", path], check=True, capture_output=True, text=True).stdout
    assert "libstdc++" not in needed
    assert "libc++" not in needed
    exported = [line.split()[-1] for line in names.splitlines() if " T " in line]
    assert exported
    assert all(name.startswith("ss_") for name in exported), exported
    assert " U _Z" not in names


@pytest.mark.parametrize("instructions", ["", "avx2", "portable"])
@pytest.mark.parametrize("method", [name for name in METHODS if not name.startswith("classifier")])
def test_images_are_those_of_the_graph(method: str, instructions: str) -> None:
    for render, display in SIZES:
        native = Run(cpu_executor(method, 2, instructions), render, display)
        graph = Run(Model.load(method, executor="onnx", threads=1)._executor, render, display)
        for frame in frames(render, 5):
            check(native.step(frame), graph.step(frame), EXACT)


@pytest.mark.parametrize("instructions", ["avx2", "portable"])
@pytest.mark.parametrize("method", [name for name in METHODS if name.startswith("classifier")])
def test_instruction_sets_agree(method: str, instructions: str) -> None:
    for render, display in [((44, 26), (81, 47)), *SIZES[1:3]]:
        best, other = (Run(cpu_executor(method, 2, name), render, display) for name in ("", instructions))
        for frame in frames(render, 5):
            check(other.step(frame), best.step(frame), INT8)


def test_what_stands_still_converges_as_in_the_graph() -> None:
    scene = RestScene(wave, mover=True, render=(40, 24))
    native = Run(cpu_executor("taau"), scene.render, scene.display)
    graph = Run(Model.load("taau", executor="onnx", threads=1)._executor, scene.render, scene.display)
    for frame, _ in scene.frames(75):
        check(native.step(frame, adds=1.0), graph.step(frame, adds=1.0), Bound(1e-4, 6e-3, 2e-2))
    ages = [run.executor.tensor(run.history, "history.static_blocks")[0, 0] for run in (native, graph)]
    np.testing.assert_array_equal(ages[0] < 0.0, ages[1] < 0.0)


def load(data: bytes) -> CpuModel:
    return CpuModel(cpu_library(), data, Options(threads=1))


def test_a_damaged_model_is_refused() -> None:
    whole = bytes_of("classifier-small")
    assert load(whole).instructions in ("avx512", "avxvnni", "avx2", "neon", "portable")
    rng = np.random.default_rng(0)
    for place in rng.integers(0, len(whole), 40):
        changed = bytearray(whole)
        changed[place] ^= 1 << rng.integers(0, 8)
        with pytest.raises(ModelError):
            load(bytes(changed))
    for end in (0, 7, 8, 100, len(whole) - 8):
        with pytest.raises(ModelError):
            load(whole[:end])
    with pytest.raises(ModelError, match="method"):
        load(arrays_bytes({"method": np.frombuffer(b"other\0", np.uint8)}))


def test_an_unknown_target_of_a_build_is_refused_with_those_that_are_known(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("SUPERSAMPLER_TARGET", "linux")
    hook = object.__new__(module_of(SOURCES / "build_hook.py").LibraryHook)
    with pytest.raises(RuntimeError, match="the target is 'linux'; want one of manylinux-x86_64, "):
        hook.initialize("standard", {})
    hook.finalize("standard", {}, "")
