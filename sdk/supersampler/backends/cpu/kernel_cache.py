"""The cache of compiled kernels on disk. A checksum protects each entry; a damaged one counts as missing."""

import hashlib
import os
import platform
from collections.abc import Iterable
from contextlib import suppress
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import NamedTuple

from supersampler.errors import KernelError, ShotError
from supersampler.io.files import remove_partial_files, replacing, user_cache

CALLED = ("memset", "memcpy", "memmove")  # LLVM generates these calls for loops that set or copy bytes
NEVER_CALLED = (  # numba refers to these where Python code could raise; kernels never do
    "NRT_Free", "PyBytes_FromStringAndSize", "PyErr_Clear", "PyErr_SetNone", "PyErr_SetString",
    "PyErr_WriteUnraisable", "PyExc_RuntimeError", "PyExc_StopIteration", "PyExc_SystemError",
    "PyUnicode_FromString", "Py_DecRef", "numba_do_raise", "numba_gil_ensure", "numba_gil_release",
    "numba_runtime_build_excinfo_struct", "numba_unpickle",
)  # fmt: skip
SYMBOLS = (*CALLED, *NEVER_CALLED)
"""All external symbols that a kernel may refer to."""
SOURCES = ("backends/cpu", "conventions", "integrations", "io/display.py", "methods", "sequence")
"""Folders and files of the package with kernels, and the structs and constants that kernels import."""
_MAGIC = b"supersampler kernel 2\n"
_DIGEST = 32  # bytes of a SHA-256


class Kernel(NamedTuple):
    """One compiled kernel.

    Attributes:
        name: see `load_kernels`.
        symbol: name of the function in the object file.
        slots: number of slots of its arguments; see `structs`.
        code: the object file.
    """

    name: str
    symbol: str
    slots: int
    code: bytes


def cache_folder() -> Path:
    """Return the folder of kernels that were compiled from the current sources for this processor.

    Raises:
        KernelError: numba or llvmlite is not installed.
    """
    return user_cache() / "kernels" / _key()


def make_writable(folder: Path) -> bool:
    """Make the folder if it is missing; return whether files can be written to it."""
    with suppress(OSError):
        folder.mkdir(parents=True, exist_ok=True)
    return os.path.isdir(folder) and os.access(folder, os.W_OK)  # noqa: PTH112  # Path.is_dir raises


def read_kernel(folder: Path, name: str) -> Kernel | None:
    """Return a kernel from `cache_folder`; None if it is missing, damaged or has another name."""
    try:
        content = _path(folder, name).read_bytes()
    except OSError:
        return None
    head, payload = content[: len(_MAGIC) + _DIGEST], content[len(_MAGIC) + _DIGEST :]
    if head != _MAGIC + hashlib.sha256(payload).digest():
        return None
    header, _, code = payload.partition(b"\n")
    own_name, symbol, slots = header.decode().split(" ")
    return Kernel(name, symbol, int(slots), code) if own_name == name else None


def write_kernel(folder: Path, kernel: Kernel) -> None:
    """Write a kernel to the cache; do nothing if the folder is not writable."""
    payload = f"{kernel.name} {kernel.symbol} {kernel.slots}\n".encode() + kernel.code
    with suppress(ShotError), replacing(_path(folder, kernel.name)) as partial, partial.open("wb") as file:
        file.write(_MAGIC + hashlib.sha256(payload).digest() + payload)
        file.flush()
        os.fsync(file.fileno())  # before the rename, in case of a power cut


def remove_partial_kernels(folder: Path, names: Iterable[str]) -> None:
    """Remove the temporary files of kernels whose writer was killed."""
    own = {_path(folder, name).name for name in names}
    with suppress(ShotError):
        remove_partial_files(folder, own.__contains__)


def _path(folder: Path, name: str) -> Path:
    return folder / f"{name}.kernel"


@cache
def _key() -> str:
    """Return a hash of everything that the machine code depends on: sources, compiler, processor."""
    try:
        import llvmlite.binding as llvm

        versions = version("numba"), version("llvmlite")
    except (ImportError, OSError, PackageNotFoundError) as error:
        raise KernelError(f"numba and llvmlite, which compile kernels, cannot be used ({error})") from error
    hashed = hashlib.sha256()
    package = Path(__file__).parents[2]
    for folder in SOURCES:
        for path in sorted((package / folder).rglob("*.py")) or [package / folder]:
            hashed.update(path.read_bytes())
    for part in (
        *versions,
        platform.machine(),
        os.environ.get("NUMBA_CPU_NAME") or llvm.get_host_cpu_name(),
        os.environ.get("NUMBA_CPU_FEATURES") or llvm.get_host_cpu_features().flatten(),
    ):
        hashed.update(part.encode())
    return hashed.hexdigest()[:16]
