"""Build wheels for all platforms on one machine, with Zig, and check their libraries.

    python sdk/native/wheels.py dist [NAME ...]

It needs hatchling, cmake, ninja, ziglang and lief of PyPI. NAME is one of `TARGETS` in build.py; without a
NAME all are built.
"""

import importlib.util
import os
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

import lief

SOURCES = Path(__file__).resolve().parent
ROOT = SOURCES.parents[1]
ALLOWED = {
    "linux": {
        "libc.so.6", "libm.so.6", "libpthread.so.0", "libc.so",
        "ld-linux-x86-64.so.2", "ld-linux-aarch64.so.1",
    },
    "macosx": {"/usr/lib/libSystem.B.dylib"},
    "win": {"kernel32.dll"},
}  # fmt: skip
"""Libraries that every machine of a platform has, apart from Windows' C runtime, api-ms-win-crt-*.dll."""
MAX_GLIBC = 2, 17
MAX_LIBRARY, MAX_WHEEL = 3 << 20, 36 << 20
"""Bytes. The shipped shot is half of a wheel."""

_spec = importlib.util.spec_from_file_location("native_build", SOURCES / "build.py")
assert _spec is not None
assert _spec.loader is not None
native_build = importlib.util.module_from_spec(_spec)
_spec.loader.exec_module(native_build)


def build_wheel(target: str, folder: Path) -> Path:
    """Build the wheel of a target, in place of earlier ones in `folder`, and return its path."""
    wheels = f"supersampler-*-{native_build.target_of(target).tag}.whl"
    for earlier in folder.glob(wheels):
        earlier.unlink()
    command = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)]
    build = {"SUPERSAMPLER_TARGET": target, "SUPERSAMPLER_BUILD": str(ROOT / "build" / "wheels")}
    subprocess.run(command, cwd=ROOT, env={**os.environ, **build}, check=True)
    (made,) = folder.glob(wheels)
    return made


def check_wheel(wheel: Path) -> str:
    """Return a line with the sizes of a wheel and its library.

    Raises:
        RuntimeError: the library needs others that the platform may lack, or a file is too large.
    """
    platform = wheel.stem.rsplit("-", 1)[1]
    with zipfile.ZipFile(wheel) as archive, tempfile.TemporaryDirectory() as folder:
        (name,) = (n for n in archive.namelist() if n.endswith((".so", ".dylib", ".dll")))
        path = Path(archive.extract(name, folder))
        needs, size = needed(path), path.stat().st_size
    system = next(system for system in ALLOWED if system in platform)
    more = {need for need in needs if need not in ALLOWED[system] and not need.startswith("api-ms-win-crt-")}
    if more:
        raise RuntimeError(f"{wheel.name}: {name} needs {', '.join(sorted(more))}")
    if size > MAX_LIBRARY or wheel.stat().st_size > MAX_WHEEL:
        raise RuntimeError(f"{wheel.name} is too large: {wheel.stat().st_size} bytes, its library {size}")
    return f"{wheel.name}: {wheel.stat().st_size / 1e6:.1f} MB, library {size / 1e6:.1f} MB"


def needed(path: Path) -> set[str]:
    """Return the names of the libraries that a library needs.

    Raises:
        RuntimeError: it needs a version of glibc newer than MAX_GLIBC.
    """
    binary = lief.parse(str(path))
    if isinstance(binary, lief.PE.Binary):
        return {str(library.name).lower() for library in binary.imports}
    if isinstance(binary, lief.ELF.Binary):
        for requirement in binary.symbols_version_requirement:
            for version in requirement.get_auxiliary_symbols():
                name = str(version.name)
                if name.startswith("GLIBC_") and tuple(map(int, name[6:].split("."))) > MAX_GLIBC:
                    raise RuntimeError(f"{path.name} needs {name}; want {MAX_GLIBC} or older")
        return {str(library) for library in binary.libraries}
    assert isinstance(binary, lief.MachO.Binary)
    own = "@rpath/libsupersampler.0.dylib"
    return {str(library.name) for library in binary.libraries} - {own}


def try_wheel(wheel: Path) -> None:
    """Install a wheel for this machine in a new environment, and upscale a frame."""
    program = (
        "from supersampler import Shot, Upscaler;"
        "upscaler = Upscaler('classifier', display_size=(640, 360), executor='cpu');"
        "print(upscaler.step(Shot.open('plaza').read(0).frame).mean())"
    )
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run([sys.executable, "-m", "venv", folder], check=True)
        python = Path(folder, "Scripts/python.exe" if os.name == "nt" else "bin/python")
        install: list[str | Path] = [python, "-m", "pip", "install", "-q", "--disable-pip-version-check"]
        subprocess.run([*install, wheel], check=True)
        subprocess.run([python, "-c", program], check=True, cwd=folder)


def main() -> None:
    """Build and check the wheels; try the one for this machine."""
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    folder = Path(sys.argv[1]).resolve()
    own = native_build.machine_target()
    for name in sys.argv[2:] or native_build.TARGETS:
        wheel = build_wheel(name, folder)
        sys.stdout.write(f"{check_wheel(wheel)}\n")
        if native_build.TARGETS[name] == own:
            try_wheel(wheel)
        sys.stdout.flush()


if __name__ == "__main__":
    main()
