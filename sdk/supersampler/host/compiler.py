"""Kernels as machine code: compiled by numba where none is kept yet, kept as object files, called by ctypes.

numba's own cache would bring numba and its dispatcher into every process; an object file is there in
milliseconds, and a call lets other threads run. Kernels are modules of `supersampler.host.kernels`, imported
only to be compiled. Objects are kept by what they are made of (the sources, numba, the processor).
"""

import ctypes
import gc
import hashlib
import importlib
import inspect
import os
import platform
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import cache
from importlib.metadata import version
from pathlib import Path
from subprocess import DEVNULL, Popen

import llvmlite.binding as llvm

from supersampler.errors import ShotError
from supersampler.files import replacing

Call = Callable[..., None]

_POINTER, _INTEGER, _FLOAT = "p", "i", "f"
_C_TYPES: dict[str, type] = {
    _POINTER: ctypes.c_void_p,
    _INTEGER: ctypes.c_int64,
    _FLOAT: ctypes.c_float,
}
_CALLED = ("memset", "memcpy", "memmove")  # by loops that only set or copy bytes
_NEVER_CALLED = (  # where Python's exceptions would be raised; kernels raise none
    "NRT_Free", "PyBytes_FromStringAndSize", "PyErr_Clear", "PyErr_SetNone", "PyErr_SetString",
    "PyErr_WriteUnraisable", "PyExc_RuntimeError", "PyExc_StopIteration", "PyExc_SystemError",
    "PyUnicode_FromString", "Py_DecRef", "numba_do_raise", "numba_gil_ensure", "numba_gil_release",
    "numba_runtime_build_excinfo_struct", "numba_unpickle",
)  # fmt: skip
_ENGINES: list[llvm.ExecutionEngine] = []  # own the code; never freed, as kernels may run until the end


def load_kernels(*names: str) -> dict[str, Call]:
    """Return kernels by name, compiled where none are kept.

    "module.function" is one of `supersampler.host.kernels`; "module.function+part+part", what the function
    makes for these parts, and "module.function+" for none.
    They take addresses for pointers (see `memory.address`), in the order of their parameters. Those that take
    longest to compile belong at both ends.
    """
    missing = [name for name in names if _kept(name) is None]
    if missing and Path(sys.executable or "").stem.startswith("python"):  # not where a program embeds Python
        _compile_apart(missing)
    return {name: _linked(_kept(name) or _compile(name)) for name in names}


def _compile_apart(names: Sequence[str]) -> None:
    """Compile and keep in two processes, one from each end of the list; either is done when all are kept.

    What they could not keep is compiled here. numba's highest level takes longer and makes nothing faster:
    kernels say themselves what is to be a vector.
    """
    command, environment = [sys.executable, "-m", __name__], {**os.environ, "NUMBA_OPT": "1"}
    orders = (names, list(reversed(names)))[: len(names)]
    helpers = [
        Popen([*command, *order], stdout=DEVNULL, stderr=DEVNULL, env=environment)  # noqa: S603  # ourselves
        for order in orders
    ]
    try:
        while all(helper.poll() is None for helper in helpers):
            time.sleep(0.01)
    finally:
        for helper in helpers:
            helper.kill()
            helper.wait()


def _compile(name: str) -> bytes:
    """Compile, and keep."""
    content = _compiled(name)
    with suppress(ShotError), replacing(_path(name)) as partial:  # a read-only home: compile anew next time
        partial.write_bytes(content)
    return content


def cache_folder() -> Path:
    """Where the kernels for this processor, of these sources, are kept."""
    root = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return root / "supersampler" / "kernels" / _made_of()


@cache
def _made_of() -> str:
    made = hashlib.sha256()
    for path in sorted(Path(__file__).parent.rglob("*.py")):
        made.update(path.read_bytes())
    for part in (
        version("numba"),
        version("llvmlite"),
        platform.machine(),
        os.environ.get("NUMBA_CPU_NAME") or llvm.get_host_cpu_name(),
        os.environ.get("NUMBA_CPU_FEATURES") or llvm.get_host_cpu_features().flatten(),
    ):
        made.update(part.encode())
    return made.hexdigest()[:16]


def _path(name: str) -> Path:
    return cache_folder() / f"{name}.o"


def _kept(name: str) -> bytes | None:
    try:
        return _path(name).read_bytes()
    except OSError:
        return None


def _function(name: str) -> Callable[..., None]:
    path, *parts = name.split("+")
    module, _, function = path.partition(".")
    found = getattr(importlib.import_module(f"supersampler.host.kernels.{module}"), function)
    made: Callable[..., None] = found(*parts) if parts else found
    return made


def _compiled(name: str) -> bytes:
    """Machine code, after a line with its symbol and the kinds of its parameters."""
    from numba import cfunc, types  # late: most processes never compile

    from supersampler.host.kernels.types import Bytes, Floats, Halves, Words

    pointers = {Floats: types.float32, Bytes: types.uint8, Halves: types.uint16, Words: types.int32}
    scalars = {int: types.int64, float: types.float32}
    function = _function(name)
    kinds, arguments = "", []
    for parameter in inspect.signature(function).parameters.values():
        annotation = parameter.annotation
        if annotation in pointers:
            kinds += _POINTER
            arguments.append(types.CPointer(pointers[annotation]))
        else:
            kinds += _FLOAT if annotation is float else _INTEGER
            arguments.append(scalars[annotation])
    made = cfunc(types.void(*arguments), error_model="numpy")(function)
    _check_symbols(made._library._final_module, name)
    code: bytes = made._library._get_compiled_object()  # no public way to it
    return f"{made.native_name} {kinds}\n".encode() + code


def _check_symbols(module: llvm.ModuleRef, name: str) -> None:
    """A symbol that is not offered would be a call to nowhere."""
    outside = {v.name for v in (*module.functions, *module.global_variables) if v.is_declaration}
    unknown = {symbol for symbol in outside if not symbol.startswith("llvm.")} - {*_CALLED, *_NEVER_CALLED}
    if unknown:
        raise NotImplementedError(f"kernel {name} calls {', '.join(sorted(unknown))}")


def _linked(content: bytes) -> Call:
    """Put an object into memory, ready to run."""
    header, _, code = content.partition(b"\n")
    symbol, kinds = header.decode().split()
    _offer_symbols()
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    machine = llvm.Target.from_default_triple().create_target_machine()
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), machine)
    engine.add_object_file(llvm.ObjectFileRef.from_data(code))
    engine.finalize_object()
    _ENGINES.append(engine)
    prototype = ctypes.CFUNCTYPE(None, *(_C_TYPES[kind] for kind in kinds))
    return prototype(engine.get_function_address(symbol))


@cache
def _offer_symbols() -> None:
    """What kernels refer to: MCJIT leaves all unresolved where it misses one."""
    library = ctypes.CDLL("msvcrt" if sys.platform == "win32" else None)
    for names, functions in ((_CALLED, _CALLED), (_NEVER_CALLED, ["abort"] * len(_NEVER_CALLED))):
        for name, function in zip(names, functions, strict=True):
            llvm.add_symbol(name, ctypes.cast(getattr(library, function), ctypes.c_void_p).value)


if __name__ == "__main__":
    gc.disable()  # nothing that the compiler makes need be freed: the process ends
    for _name in sys.argv[1:]:
        if _kept(_name) is None:
            _compile(_name)
    os._exit(0)  # at once: someone waits
