"""The CPU library in C++: its constants and models, its symbols, and damaged models."""

import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from cpu_models import bytes_of
from native_build import SOURCES, module_of, native_build, native_generated
from supersampler import ModelError
from supersampler.backends.cpu.executor import CpuModel
from supersampler.backends.cpu.library import Options, cpu_library
from supersampler.backends.cpu.model_bytes import arrays_bytes


@pytest.fixture(scope="session")
def path() -> Path:
    built = native_build().build()
    assert isinstance(built, Path)
    return built


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


OTHER_VERSION = """
#include <dlfcn.h>
#include <stdio.h>
#include "supersampler.h"

/* In the place of a library of another version that the program is linked with. */
ss_status ss_model_create_from_bytes(const void* bytes, size_t count, const ss_options* options,
                                     ss_model** model, ss_error* error) {
    (void)bytes, (void)count, (void)options, (void)model, (void)error;
    return SS_BAD_MODEL;
}

int main(int count, char** arguments) {
    void* library = count > 1 ? dlopen(arguments[1], RTLD_NOW) : NULL;
    ss_status (*create)(const char*, const ss_options*, ss_model**, ss_error*);
    ss_model* model = NULL;
    if (!library) return 2;
    *(void**)&create = dlsym(library, "ss_model_create");
    return create("taau", NULL, &model, NULL);
}
"""


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="symbols are bound otherwise")
def test_a_program_may_load_the_library_beside_another_version(path: Path, tmp_path: Path) -> None:
    compiler = shutil.which("cc")
    if compiler is None:
        pytest.skip("a C compiler is missing")
    host = tmp_path / "host"
    host.with_suffix(".c").write_text(OTHER_VERSION)
    include = f"-I{SOURCES / 'include'}"
    command: list[str | Path] = [compiler, host.with_suffix(".c"), include, "-rdynamic", "-ldl", "-o", host]
    subprocess.run(command, check=True)
    assert subprocess.run([host, path], check=False).returncode == 0


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
