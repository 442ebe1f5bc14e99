"""Compiles kernels, by numba's and llvmlite's public interfaces alone. Imported only where none is cached.

    python -P -m supersampler.backends.cpu.kernel_compiler FOLDER NAME...    compiles what is not cached there

numba gives LLVM's intermediate code of a kernel, llvmlite an object file of that, which holds no address of
this process. An object needs few symbols, of which `kernel_loader` has its own definitions.
"""

import gc
import importlib
import inspect
import os
import platform
import sys
from collections.abc import Callable
from pathlib import Path

import llvmlite.binding as llvm
from numba import cfunc, config, types

from supersampler.backends.cpu.kernel_cache import Kernel, read_kernel, write_kernel
from supersampler.backends.cpu.kernel_loader import FLOAT, INTEGER, POINTER, SYMBOLS
from supersampler.backends.cpu.kernels.types import Bytes, Floats, Halves, Words

_POINTERS = {Floats: types.float32, Bytes: types.uint8, Halves: types.uint16, Words: types.int32}
_SCALARS = {int: (INTEGER, types.int64), float: (FLOAT, types.float32)}
_OPTIMIZATION = 1  # of LLVM's code generator; higher takes longer and makes no kernel faster


def compile_kernel(name: str) -> Kernel:
    """Compile one kernel; see `load_kernels` for its name.

    Raises:
        NotImplementedError: it calls what `kernel_loader` does not define.
    """
    function = _function(name)
    parameters, arguments = "", []
    for parameter in inspect.signature(function).parameters.values():
        pointed_to = _POINTERS.get(parameter.annotation)
        if pointed_to is None:
            letter, kind = _SCALARS[parameter.annotation]
        else:
            letter, kind = POINTER, types.CPointer(pointed_to)
        parameters += letter
        arguments.append(kind)
    compiled = cfunc(types.void(*arguments), error_model="numpy")(function)
    module = llvm.parse_assembly(compiled.inspect_llvm())
    _check_symbols(module, name)
    return Kernel(name, compiled.native_name, parameters, _target_machine().emit_object(module))


def _function(name: str) -> Callable[..., None]:
    path, *parts = name.split("+")
    module, _, function = path.rpartition(".")
    found = getattr(importlib.import_module(f"supersampler.{module}"), function)
    made: Callable[..., None] = found(*parts) if parts else found
    return made


def _target_machine() -> llvm.TargetMachine:
    """As numba makes code for this processor, so that both agree on its instructions."""
    target = llvm.Target.from_default_triple()
    features = config.CPU_FEATURES
    return target.create_target_machine(
        cpu=config.CPU_NAME or llvm.get_host_cpu_name(),
        features=llvm.get_host_cpu_features().flatten() if features is None else features,
        opt=_OPTIMIZATION,
        reloc="static" if platform.machine().lower() in ("x86_64", "amd64") else "default",
        codemodel="jitdefault",
        jit=True,
    )


def _check_symbols(module: llvm.ModuleRef, name: str) -> None:
    outside = {v.name for v in (*module.functions, *module.global_variables) if v.is_declaration}
    unknown = {symbol for symbol in outside if not symbol.startswith("llvm.")} - {*SYMBOLS}
    if unknown:
        raise NotImplementedError(f"kernel {name} calls {', '.join(sorted(unknown))}")


if __name__ == "__main__":
    gc.disable()  # the process ends soon
    sys.modules["scipy"] = None  # type: ignore[assignment]  # numba would import it, and no kernel needs it
    _folder = Path(sys.argv[1])
    for _name in sys.argv[2:]:
        if read_kernel(_folder, _name) is None:
            write_kernel(_folder, compile_kernel(_name))
    os._exit(0)  # at once: a process waits for this one
