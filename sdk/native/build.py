"""Build the CPU library, and copy it to where the Python package loads it from.

    python sdk/native/build.py
    python sdk/native/build.py wasm     # for the page of `demo --web`; needs ziglang of PyPI

Only changed sources are compiled again. `pip install` also builds the library; see build_hook.py.
"""

import importlib.util
import os
import platform
import re
import shutil
import subprocess
import sys
import sysconfig
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

SOURCES = Path(__file__).resolve().parent
FOLDER = SOURCES.parents[1] / "build" / "native"
PLACE = Path("supersampler/backends/cpu")
"""Folder of the library, in a wheel or in sdk/."""
NAMES = {"win32": "supersampler.dll", "darwin": "libsupersampler.dylib"}
NAME = NAMES.get(sys.platform, "libsupersampler.so")
MIN_CMAKE = 3, 20
MIN_COMPILERS = {"__clang_major__": 14, "__GNUC__": 12}
"""Oldest supported versions, by the macros that hold them. clang defines both macros."""
COMPILERS = ("cc", "c++"), ("gcc", "g++"), ("clang", "clang++")


class Target(NamedTuple):
    """A platform that Zig compiles for: Zig's name of it, the tag of its wheels, and the library's name."""

    zig: str
    tag: str
    library: str = "libsupersampler.so"


TARGETS = {
    "manylinux-x86_64": Target("x86_64-linux-gnu.2.17", "manylinux_2_17_x86_64"),
    "manylinux-aarch64": Target("aarch64-linux-gnu.2.17", "manylinux_2_17_aarch64"),
    "musllinux-x86_64": Target("x86_64-linux-musl", "musllinux_1_2_x86_64"),
    "musllinux-aarch64": Target("aarch64-linux-musl", "musllinux_1_2_aarch64"),
    "macos-x86_64": Target("x86_64-macos.11.0", "macosx_11_0_x86_64", NAMES["darwin"]),
    "macos-arm64": Target("aarch64-macos.11.0", "macosx_11_0_arm64", NAMES["darwin"]),
    "windows-x86_64": Target("x86_64-windows-gnu", "win_amd64", NAMES["win32"]),
}
WASM = Target("wasm32-wasi", "", "supersampler.wasm")
"""WebAssembly with SIMD, for browsers."""


def build() -> Path:
    """Return the library in the package, after building it if a source is newer.

    Raises:
        RuntimeError: the build fails, or CMake or a compiler is missing.
    """
    target = SOURCES.parent / PLACE / NAME
    sources = [path for path in SOURCES.rglob("*") if path.is_file() and path.suffix not in {".py", ".pyc"}]
    if target.exists() and target.stat().st_mtime > max(path.stat().st_mtime for path in sources):
        return target
    options = machine_compiler()
    if options is None or not has_cmake():
        raise RuntimeError(f"{target} is missing or older than its sources. `pip install -e .` builds it.")
    compile_library(FOLDER, options)
    install(FOLDER / NAME)
    return target


def build_wasm(folder: Path) -> Path:
    """Return the library compiled to WebAssembly, built in `folder`.

    Raises:
        RuntimeError: the build fails, or the package ziglang is missing.
    """
    compile_library(folder, zig_compiler(WASM))
    return folder / WASM.library


def compile_library(folder: Path, options: Sequence[str]) -> None:
    """Compile the library in `folder`, with options for CMake.

    Raises:
        RuntimeError: the build fails; the message has the compiler's output.
    """
    generator = ["-G", "Ninja"] if shutil.which("ninja") else []
    options = ["-DCMAKE_BUILD_TYPE=Release", "-DSS_TESTS=OFF", *options]
    _run("cmake", "-S", str(SOURCES), "-B", str(folder), *generator, *options)
    _run("cmake", "--build", str(folder), "--parallel", str(os.cpu_count() or 1))


def install(built: Path) -> None:
    """Copy a library into the package of the source tree."""
    target = SOURCES.parent / PLACE / built.name
    partial = target.with_suffix(f".{os.getpid()}")
    shutil.copyfile(built, partial)
    partial.replace(target)  # a process may have the old one loaded


def has_cmake() -> bool:
    """Return whether CMake is installed and new enough."""
    if shutil.which("cmake") is None:
        return False
    found = re.search(r"version (\d+)\.(\d+)", _run("cmake", "--version"))
    return found is not None and (int(found[1]), int(found[2])) >= MIN_CMAKE


def machine_compiler() -> list[str] | None:
    """Return CMake options that select the machine's C++ compiler; None if it has none that is new enough."""
    if "CXX" in os.environ:  # CMake reads it
        return []
    for c, cxx in COMPILERS:
        paths = shutil.which(c), shutil.which(cxx)
        if all(paths) and _compiles(cxx):
            return [f"-DCMAKE_C_COMPILER={paths[0]}", f"-DCMAKE_CXX_COMPILER={paths[1]}"]
    return None


def _compiles(cxx: str) -> bool:
    """Return whether a C++ compiler is new enough, and has the headers of the C library."""
    command = [cxx, "-x", "c++", "-dM", "-E", "-"]
    done = subprocess.run(command, input="#include <stdlib.h>\n", capture_output=True, text=True, check=False)  # noqa: S603
    versions = dict(re.findall(r"#define (\w+) (\d+)\n", done.stdout))
    macro = next((macro for macro in MIN_COMPILERS if macro in versions), "")
    return done.returncode == 0 and bool(macro) and int(versions[macro]) >= MIN_COMPILERS[macro]


def zig_compiler(target: Target) -> list[str]:
    """Return CMake options that cross-compile with PyPI's package ziglang."""
    spec = importlib.util.find_spec("ziglang")
    if spec is None or spec.origin is None:
        raise RuntimeError("the package ziglang is missing: `pip install ziglang`")
    program = Path(spec.origin).with_name("zig.exe" if os.name == "nt" else "zig")
    toolchain = SOURCES / "cmake" / "zig.cmake"
    return [f"-DCMAKE_TOOLCHAIN_FILE={toolchain}", f"-DSS_ZIG={program}", f"-DSS_TARGET={target.zig}"]


def target_of(name: str) -> Target:
    """Return a target by its name.

    Raises:
        RuntimeError: there is no such target.
    """
    if name not in TARGETS:
        raise RuntimeError(f"the target is {name!r}; want one of {', '.join(TARGETS)}")
    return TARGETS[name]


def machine_target() -> Target:
    """Return the target of this machine.

    Raises:
        RuntimeError: it is not in TARGETS.
    """
    musl = "musl" in (sysconfig.get_config_var("HOST_GNU_TYPE") or "")
    systems = {"Linux": "musllinux" if musl else "manylinux", "Darwin": "macos", "Windows": "windows"}
    name = f"{systems.get(platform.system())}-{platform.machine().lower().replace('amd64', 'x86_64')}"
    if name not in TARGETS:
        raise RuntimeError(
            f"no C++ compiler was found, and Zig is not set up for {name}: install GCC 12 or clang 14"
        )
    return TARGETS[name]


def machine_tag() -> str:
    """Return the platform tag of wheels with a library of the machine's compiler."""
    if sys.platform == "darwin":  # Python's own tag may be universal2
        return f"macosx_{platform.mac_ver()[0].split('.')[0]}_0_{platform.machine()}"
    return re.sub(r"[-.]", "_", sysconfig.get_platform())


def _run(*command: str) -> str:
    done = subprocess.run(command, capture_output=True, text=True, check=False)  # noqa: S603  # its own words
    if done.returncode:
        raise RuntimeError(f"{' '.join(command)} has failed.\n{done.stdout}{done.stderr}")
    return done.stdout


if __name__ == "__main__":
    if sys.argv[1:] == ["wasm"]:
        install(build_wasm(FOLDER.with_name("wasm")))
    else:
        sys.stdout.write(f"{build()}\n")
