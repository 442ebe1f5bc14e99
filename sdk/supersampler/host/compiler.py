"""Kernels as machine code: compiled by numba where none is kept yet, kept as object files, called by ctypes.

numba's own cache would bring numba and its dispatcher into every process; an object file is there in
milliseconds, and a call lets other threads run. Kernels are modules of `supersampler.host.kernels`, imported
only to be compiled. Objects are kept by what they are made of (the sources, numba, the processor).
"""

import ctypes
import hashlib
import importlib
import os
import platform
from collections.abc import Callable, Mapping
from contextlib import suppress
from functools import cache
from importlib.metadata import version
from pathlib import Path

import llvmlite.binding as llvm

from supersampler.errors import ShotError
from supersampler.image_io import replacing

Call = Callable[..., None]
Signature = str
"""Kinds of a kernel's arguments, a letter each: p pointer to float32, b to bytes, h to half floats, i int, f float."""

_C_TYPES: Mapping[str, type] = {
    **dict.fromkeys("pbh", ctypes.c_void_p),
    "i": ctypes.c_int64,
    "f": ctypes.c_float,
}
_ENGINES: list[llvm.ExecutionEngine] = []  # own the code; never freed, as kernels may run until the end


def load_kernels(module: str, signatures: Mapping[str, Signature]) -> dict[str, Call]:
    """Return the kernels of `supersampler.host.kernels.<module>`, compiled.

    Args:
        module: name.
        signatures: of each function that is wanted.
    """
    folder = cache_folder()
    kernels = {}
    for name, kinds in signatures.items():
        path = folder / f"{module}.{name}.{kinds}.o"
        content = _kept(path)
        if content is None:
            content = _compiled(module, name, kinds)
            with suppress(ShotError), replacing(path) as partial:  # a read-only home: compile anew next time
                partial.write_bytes(content)
        kernels[name] = _linked(content, kinds)
    return kernels


def cache_folder() -> Path:
    """Where the kernels for this processor, of these sources, are kept."""
    root = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
    return root / "supersampler" / "kernels" / _made_of()


@cache
def _made_of() -> str:
    made = hashlib.sha256()
    for path in sorted(Path(__file__).parent.rglob("*.py")):
        made.update(path.read_bytes())
    features = llvm.get_host_cpu_features().flatten()
    for part in (version("numba"), version("llvmlite"), platform.machine(), llvm.get_host_cpu_name(), features):
        made.update(part.encode())
    return made.hexdigest()[:16]


def _kept(path: Path) -> bytes | None:
    try:
        return path.read_bytes()
    except OSError:
        return None


def _compiled(module: str, name: str, kinds: Signature) -> bytes:
    from numba import cfunc, types  # late: most processes never compile

    function = getattr(importlib.import_module(f"supersampler.host.kernels.{module}"), name)
    pointers = {"p": types.float32, "b": types.uint8, "h": types.uint16}
    scalars = {"i": types.int64, "f": types.float32}
    arguments = [types.CPointer(pointers[k]) if k in pointers else scalars[k] for k in kinds]
    made = cfunc(types.void(*arguments), error_model="numpy")(function)
    return made.native_name.encode() + b"\n" + made._library._get_compiled_object()  # no public way to it


def _linked(content: bytes, kinds: Signature) -> Call:
    """Put an object into memory, ready to run."""
    symbol, _, code = content.partition(b"\n")
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    machine = llvm.Target.from_default_triple().create_target_machine()
    engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), machine)
    engine.add_object_file(llvm.ObjectFileRef.from_data(code))
    engine.finalize_object()
    _ENGINES.append(engine)
    prototype = ctypes.CFUNCTYPE(None, *(_C_TYPES[k] for k in kinds))
    return prototype(engine.get_function_address(symbol.decode()))
