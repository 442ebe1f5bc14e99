"""Build hook of Hatchling: compiles the CPU library into wheels and editable installs.

`pip install .` uses the machine's CMake, Ninja and C++ compiler. Missing or outdated ones come from PyPI
during the build, with Zig as the compiler; then the wheel also has the library as WebAssembly. Environment
variables: SUPERSAMPLER_TARGET, a name in `TARGETS` of build.py, builds for another platform;
SUPERSAMPLER_BUILD is a folder to build in, where later builds compile only changed sources, in place of a
temporary folder; what Zig compiles has a subfolder for each platform.
"""

import importlib.util
import os
import shutil
import tempfile
from pathlib import Path
from typing import Any

from hatchling.builders.hooks.plugin.interface import BuildHookInterface

_spec = importlib.util.spec_from_file_location("native_build", Path(__file__).with_name("build.py"))
assert _spec is not None  # noqa: S101
assert _spec.loader is not None  # noqa: S101
native_build = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(native_build)

TARGET = os.environ.get("SUPERSAMPLER_TARGET")


class LibraryHook(BuildHookInterface[Any]):
    """Adds the library to a wheel, or for an editable install to the source tree."""

    def dependencies(self) -> list[str]:
        """Return the requirements of the tools that this machine lacks."""
        needed = [] if native_build.has_cmake() else ["cmake>=3.20"]
        needed += [] if shutil.which("ninja") else ["ninja"]
        needs_zig = TARGET or native_build.machine_compiler() is None
        return [*needed, "ziglang>=0.16,<0.18"] if needs_zig else needed

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile the library; `version` is "editable" or "standard"."""
        self._temporary = tempfile.TemporaryDirectory()
        folder = Path(os.environ.get("SUPERSAMPLER_BUILD") or self._temporary.name)
        compiler, tag = native_build.machine_compiler(), native_build.machine_tag()
        built = folder / native_build.NAME
        uses_zig = bool(TARGET) or compiler is None
        if uses_zig:
            target = native_build.target_of(TARGET) if TARGET else native_build.machine_target()
            compiler, tag = native_build.zig_compiler(target), target.tag
            built = folder / target.tag / target.library
        native_build.compile_library(built.parent, [*compiler, "-DCMAKE_SHARED_LINKER_FLAGS=-s"])
        if version == "editable":
            native_build.install(built)
            return
        found = [built, *([native_build.build_wasm(folder / "wasm")] if uses_zig else [])]
        for path in found:
            build_data["force_include"][str(path)] = str(native_build.PLACE / path.name)
        build_data["pure_python"] = False
        build_data["tag"] = f"py3-none-{tag}"  # ctypes loads the library, in any version of Python

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        """Remove the temporary folder."""
        self._temporary.cleanup()
