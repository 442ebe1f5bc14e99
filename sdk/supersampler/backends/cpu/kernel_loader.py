"""Kernels as functions: read from the cache or compiled, linked once in a process, called by ctypes.

numba's own cache would bring numba and its dispatcher into every process; an object file is linked in
milliseconds, and a call lets other threads run. Each kernel is a library of its own in an LLJIT of ours, with
symbols that no other code of the process sees: the process stays as it was for everybody else's numba.
"""

import ctypes
import itertools
import os
import struct
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from supersampler.backends.cpu.kernel_cache import (
    CALLED,
    NEVER_CALLED,
    Kernel,
    cache_folder,
    keeps_kernels,
    read_kernel,
    write_kernel,
)
from supersampler.backends.cpu.structs import SLOT
from supersampler.backends.locks import ForkSafeLock
from supersampler.errors import KernelError

if TYPE_CHECKING:
    import llvmlite.binding as llvm

Call = Callable[..., None]

_PROTOTYPE = ctypes.CFUNCTYPE(None, ctypes.c_char_p)
_INTEGER = struct.Struct("=q")
_COMPILE_SECONDS = 300.0  # that processes may take, before this one compiles by itself


class _Linked:
    """Kernels that this process has linked: each once, and never unlinked, as it may run until the end."""

    def __init__(self) -> None:
        self.calls: dict[tuple[Path, str], Call] = {}
        self.trackers: list[llvm.ResourceTracker] = []  # each keeps its library in memory
        self.library_names = (
            f"supersampler {index}" for index in itertools.count()
        )  # none may be used twice
        self.guard = ForkSafeLock()


_LINKED = _Linked()


def load_kernels(*names: str) -> dict[str, Call]:
    """Return kernels by name, compiled where none are cached.

    Args:
        names: "module.function", where `supersampler.module` has it; "module.function+part+part" is what the
            function makes for these parts, "module.function+" for none. Those that take longest to
            compile belong at both ends.

    Returns:
        Functions of the kernel's arguments in order: a struct as `structs.pack` returns it, an array as
        `memory.address` returns it, an integer as it is.

    Raises:
        KernelError: there is no compiler, or it fails.
    """
    folder = cache_folder()
    with _LINKED.guard.lock:
        missing = [name for name in names if (folder, name) not in _LINKED.calls]
        cached = {name: read_kernel(folder, name) for name in missing}
        wanted = [name for name in missing if cached[name] is None]
        if wanted and keeps_kernels(folder):
            _compile_apart(folder, wanted)
        for name in missing:
            _LINKED.calls[folder, name] = _linked(folder, name, cached[name] or read_kernel(folder, name))
        return {name: _LINKED.calls[folder, name] for name in names}


def _compile_apart(folder: Path, names: Sequence[str]) -> None:
    """Compile and cache in two processes, one from each end of the list; either ends when all are cached.

    What they could not cache is compiled by this process. numba's highest level takes longer and makes no
    kernel faster: kernels say themselves what is to be a vector.
    """
    if not Path(sys.executable or "").stem.startswith("python"):  # a program that embeds Python
        return
    no_bytecode = ["-B"] if sys.dont_write_bytecode else []
    command = [
        sys.executable,
        "-P",
        *no_bytecode,
        "-m",
        "supersampler.backends.cpu.kernel_compiler",
        str(folder),
    ]
    passed_on = ("NUMBA_CPU_NAME", "NUMBA_CPU_FEATURES")  # others would make other code of the same kernels
    environment = {key: v for key, v in os.environ.items() if key in passed_on or key[:6] != "NUMBA_"}
    environment["NUMBA_OPT"] = "1"
    helpers: list[subprocess.Popen[bytes]] = []
    try:
        for order in (names, list(reversed(names)))[: len(names)]:
            helpers.append(
                subprocess.Popen(  # noqa: S603  # ourselves
                    [*command, *order],
                    stdin=subprocess.DEVNULL,
                    stdout=subprocess.DEVNULL,
                    stderr=subprocess.DEVNULL,
                    env=environment,
                    creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),
                )
            )
        latest = time.monotonic() + _COMPILE_SECONDS
        while all(helper.poll() is None for helper in helpers) and time.monotonic() < latest:
            time.sleep(0.01)
    except OSError:  # no process can be started
        pass
    finally:
        for helper in helpers:
            helper.kill()
            helper.wait()


def _linked(folder: Path, name: str, kernel: Kernel | None) -> Call:
    """Link a cached kernel; compile it here where there is none, or where it cannot be linked."""
    if kernel is not None:
        try:
            return _link(kernel)
        except RuntimeError:  # an object of another LLVM, say
            pass
    try:
        from supersampler.backends.cpu.kernel_compiler import compile_kernel

        kernel = compile_kernel(name)
        call = _link(kernel)
    except Exception as error:  # numba's and LLVM's errors share no other base
        raise KernelError(f"kernel {name} cannot be compiled ({type(error).__name__}: {error})") from error
    write_kernel(folder, kernel)
    return call


def _link(kernel: Kernel) -> Call:
    """Put an object file into memory.

    Raises:
        RuntimeError: LLVM cannot.
    """
    import llvmlite.binding as llvm

    builder = llvm.JITLibraryBuilder().add_object_img(kernel.code).export_symbol(kernel.symbol)
    for symbol, place in _symbol_addresses().items():
        builder.import_symbol(symbol, place)
    tracker = builder.link(_jit(), next(_LINKED.library_names))
    _LINKED.trackers.append(tracker)
    function, size = _PROTOTYPE(tracker[kernel.symbol]), SLOT * kernel.slots

    def call(*arguments: bytes | int) -> None:
        record = b"".join([a if isinstance(a, bytes) else _INTEGER.pack(a) for a in arguments])
        if len(record) != size:  # it would read beyond the record
            raise TypeError(f"kernel {kernel.name} takes {size} bytes of arguments, not {len(record)}")
        function(record)

    return call


@cache
def _jit() -> "llvm.LLJIT":
    import llvmlite.binding as llvm

    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    return llvm.create_lljit_compiler(llvm.Target.from_default_triple().create_target_machine(jit=True))


@cache
def _symbol_addresses() -> dict[str, int]:
    library = ctypes.CDLL("msvcrt" if sys.platform == "win32" else None)
    defined = {name: name for name in CALLED} | dict.fromkeys(NEVER_CALLED, "abort")
    found = {name: ctypes.cast(getattr(library, by), ctypes.c_void_p).value for name, by in defined.items()}
    return {name: place for name, place in found.items() if place is not None}
