"""Loads kernels from the cache, compiles those that are missing, links each once per process.

numba's own cache would need numba in every process; an object file is linked within milliseconds. Kernels are
called by ctypes, which releases Python's lock. Each kernel is a library of its own in a private LLJIT, whose
symbols no other code in the process sees, such as other users of numba.
"""

import ctypes
import itertools
import os
import struct
import sys
import time
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING

from supersampler.backends.base import ForkSafeLock
from supersampler.backends.cpu.kernel_cache import (
    CALLED,
    NEVER_CALLED,
    Kernel,
    cache_folder,
    make_writable,
    read_kernel,
    remove_partial_kernels,
    write_kernel,
)
from supersampler.backends.cpu.structs import SLOT
from supersampler.errors import KernelError
from supersampler.io.child_process import ChildProcess, has_interpreter

if TYPE_CHECKING:
    import llvmlite.binding as llvm

Call = Callable[..., None]

_PROTOTYPE = ctypes.CFUNCTYPE(None, ctypes.c_char_p)
_INTEGER = struct.Struct("=q")
_COMPILE_SECONDS = 300.0  # limit for the compiling processes


_linked: dict[tuple[Path, str], Call] = {}  # never unlinked, because a kernel may run until the end
_trackers: "list[llvm.ResourceTracker]" = []  # each keeps its library in memory
_library_numbers = itertools.count()  # a name must not be used twice
_guard = ForkSafeLock()


def load_kernels(*names: str) -> dict[str, Call]:
    """Return kernels by name; compile those that are not cached.

    Args:
        names: "module.function" is that function of `supersampler.module`; "module.function+part+part" is the
            result of calling it with these parts, "module.function+" without parts. The kernels that take
            longest to compile should be first and last.

    Returns:
        Functions that take the kernel's arguments in order: structs by `structs.pack`, arrays by
        `memory.address`, and integers.

    Raises:
        KernelError: there is no compiler, or it fails.
    """
    folder = cache_folder()
    with _guard.lock:
        unlinked = [name for name in names if (folder, name) not in _linked]
        cached = {name: read_kernel(folder, name) for name in unlinked}
        missing = [name for name in unlinked if cached[name] is None]
        if missing and make_writable(folder):
            _compile_in_processes(folder, missing)
        for name in unlinked:
            kernel = cached[name] or read_kernel(folder, name)
            _linked[folder, name] = _link_or_compile(folder, name, kernel)
        return {name: _linked[folder, name] for name in names}


@cache
def kernel_if_possible(name: str) -> Call | None:
    """Return one kernel; None, from then on, where it cannot be compiled. See `load_kernels`."""
    try:
        return load_kernels(name)[name]
    except KernelError:
        return None


def _compile_in_processes(folder: Path, names: Sequence[str]) -> None:
    """Compile kernels to the cache in two processes, one from each end of the list, until one has ended.

    It has ended when all kernels are cached, or after an error: this process then compiles those missing.
    """
    if not has_interpreter():
        return
    no_bytecode = ["-B"] if sys.dont_write_bytecode else []
    module = "supersampler.backends.cpu.kernel_compiler"
    command = [sys.executable, "-P", *no_bytecode, "-m", module, str(folder)]
    passed_on = ("NUMBA_CPU_NAME", "NUMBA_CPU_FEATURES")  # other variables could change the code
    environment = {key: v for key, v in os.environ.items() if key in passed_on or key[:6] != "NUMBA_"}
    environment["NUMBA_OPT"] = "1"  # higher levels compile longer and make no kernel faster
    processes: list[ChildProcess] = []
    try:
        for order in (names, list(reversed(names)))[: len(names)]:
            processes.append(ChildProcess([*command, *order], environment=environment, output="none"))
        latest = time.monotonic() + _COMPILE_SECONDS
        while all(process.poll() is None for process in processes) and time.monotonic() < latest:
            time.sleep(0.01)
    except OSError:  # no process can be started
        pass
    finally:
        for process in processes:
            process.close()
        remove_partial_kernels(folder, names)


def _link_or_compile(folder: Path, name: str, kernel: Kernel | None) -> Call:
    """Link a cached kernel; compile it in this process if it is None or cannot be linked."""
    if kernel is not None:
        try:
            return _link(kernel)
        except RuntimeError:  # for example, an object file of another LLVM
            pass
    try:
        from supersampler.backends.cpu.kernel_compiler import compile_kernel

        kernel = compile_kernel(name)
        call = _link(kernel)
    except Exception as error:  # errors of numba and LLVM have no other common base
        raise KernelError(f"kernel {name} cannot be compiled ({type(error).__name__}: {error})") from error
    write_kernel(folder, kernel)
    return call


def _link(kernel: Kernel) -> Call:
    """Load an object file into memory; raise RuntimeError if LLVM cannot."""
    import llvmlite.binding as llvm

    builder = llvm.JITLibraryBuilder().add_object_img(kernel.code).export_symbol(kernel.symbol)
    for symbol, location in _symbol_addresses().items():
        builder.import_symbol(symbol, location)
    tracker = builder.link(_jit(), f"supersampler {next(_library_numbers)}")
    _trackers.append(tracker)
    function, size = _PROTOTYPE(tracker[kernel.symbol]), SLOT * kernel.slots

    def call(*arguments: bytes | int) -> None:
        record = b"".join([a if isinstance(a, bytes) else _INTEGER.pack(a) for a in arguments])
        if len(record) != size:  # the kernel would read beyond the record
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
    definitions = {name: name for name in CALLED} | dict.fromkeys(NEVER_CALLED, "abort")
    addresses = {
        name: ctypes.cast(getattr(library, definition), ctypes.c_void_p).value
        for name, definition in definitions.items()
    }
    return {name: address for name, address in addresses.items() if address is not None}
